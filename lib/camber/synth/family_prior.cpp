#include "camber/synth/family_prior.h"

#include <fmt/format.h>

#include <stdexcept>

#include "camber/synth/car_family.h"

namespace camber {

namespace {

ShapeSample to_sample(const CarModel& car) {
  ShapeSample out;
  out.dimensions = car.dimensions;
  for (int i = 0; i < kNumKeypoints; ++i) out.keypoints.col(i) = car.keypoints[i];
  return out;
}

}  // namespace

void FamilyPriorOptions::validate() const {
  if (samples < 2) throw std::invalid_argument(fmt::format("samples: {}, must be > 1", samples));
  if (!(annotation_sigma >= 0.0) || !(box_sigma >= 0.0)) {
    throw std::invalid_argument(fmt::format("annotation_sigma, box_sigma: {}, {}, must be >= 0",
                                            annotation_sigma, box_sigma));
  }
  ShapeLearningOptions{num_coefficients}.validate();
}

VehiclePrior learn_family_prior(const FamilyPriorOptions& options) {
  options.validate();
  const CounterRandom random(options.seed);
  std::vector<ShapeSample> cars, vans;
  for (std::uint64_t i = 0; static_cast<int>(cars.size()) < options.samples; ++i) {
    const CarModel car = sample_car(random, i);
    if (car.car_class != CarClass::kVan) cars.push_back(to_sample(car));
  }
  for (std::uint64_t i = 0; static_cast<int>(vans.size()) < options.samples; ++i) {
    vans.push_back(to_sample(sample_car(CarClass::kVan, random, i)));
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
    for (int i = 0; i < 3; ++i) {
      const double sigma = options.box_sigma * shape.parameters_mean[i];
      shape.parameters_covariance(i, i) += sigma * sigma;
    }
  }
  return prior;
}

}  // namespace camber
