#include "camber/synth/family_prior.h"

#include <fmt/format.h>

#include <algorithm>
#include <stdexcept>

#include "camber/synth/car_family.h"

namespace camber {

namespace {

ShapeSample to_sample(const CarModel& car, const FamilyPriorOptions& options,
                      const CounterRandom& random, std::uint64_t index) {
  auto factor = [&](int number, double sigma) {
    return 1.0 + sigma * std::clamp(random.normal(6 * index + number), -2.5, 2.5);
  };
  const Eigen::Vector3d scale(factor(0, options.size_sigma), factor(1, options.size_sigma),
                              factor(2, options.size_sigma));
  ShapeSample out;
  out.dimensions = {car.dimensions.length * scale.x() * factor(3, options.box_sigma),
                    car.dimensions.width * scale.z() * factor(4, options.box_sigma),
                    car.dimensions.height * scale.y() * factor(5, options.box_sigma)};
  for (int i = 0; i < kNumKeypoints; ++i) {
    out.keypoints.col(i) = scale.asDiagonal() * car.keypoints[i];
  }
  return out;
}

}  // namespace

void FamilyPriorOptions::validate() const {
  if (samples < 2) throw std::invalid_argument(fmt::format("samples: {}, must be > 1", samples));
  if (!(annotation_sigma >= 0.0) || !(size_sigma >= 0.0) || !(box_sigma >= 0.0)) {
    throw std::invalid_argument(
        fmt::format("annotation_sigma, size_sigma, box_sigma: {}, {}, {}, must be >= 0",
                    annotation_sigma, size_sigma, box_sigma));
  }
  ShapeLearningOptions{num_coefficients}.validate();
}

VehiclePrior learn_family_prior(const FamilyPriorOptions& options) {
  options.validate();
  const CounterRandom random(options.seed);
  const CounterRandom car_boxes(options.seed, 1), van_boxes(options.seed, 2);
  std::vector<ShapeSample> cars, vans;
  for (std::uint64_t i = 0; static_cast<int>(cars.size()) < options.samples; ++i) {
    const CarModel car = sample_car(random, i);
    if (car.car_class != CarClass::kVan) cars.push_back(to_sample(car, options, car_boxes, i));
  }
  for (std::uint64_t i = 0; static_cast<int>(vans.size()) < options.samples; ++i) {
    vans.push_back(to_sample(sample_car(CarClass::kVan, random, i), options, van_boxes, i));
  }
  VehiclePrior prior;
  prior.source = fmt::format("parametric car family, seed {}, {} samples a shape", options.seed,
                             options.samples);
  const ShapeLearningOptions learning{options.num_coefficients};
  prior.shapes.push_back(learn_shape_prior("car", cars, learning));
  prior.shapes.push_back(learn_shape_prior("van", vans, learning));
  prior.sizes = published_sizes();
  for (ShapePrior& shape : prior.shapes) {
    shape.sigma =
        (shape.sigma.array().square() + options.annotation_sigma * options.annotation_sigma).sqrt();
  }
  return prior;
}

}  // namespace camber
