#include "camber/synth/family_prior.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "camber/synth/car_family.h"

namespace camber {

namespace {

using Root = Eigen::Matrix<double, kNumSideKeypoints, kNumSideKeypoints>;

/// Square root of the correlation of displacements over a side's keypoints.
Root design_root(CarClass car_class, double reach) {
  const CarModel car = make_car(car_class);
  Root correlation;
  for (int i = 0; i < kNumSideKeypoints; ++i) {
    for (int j = 0; j < kNumSideKeypoints; ++j) {
      const double squared = (car.keypoints[i] - car.keypoints[j]).squaredNorm();
      correlation(i, j) = std::exp(-0.5 * squared / (reach * reach)) + (i == j ? 1e-9 : 0.0);
    }
  }
  return correlation.llt().matrixL();
}

ShapeSample to_sample(const CarModel& car, const FamilyPriorOptions& options, const Root& design,
                      const CounterRandom& random, std::uint64_t index) {
  constexpr std::uint64_t kNumbers = 64;  // drawn for a car
  std::uint64_t counter = kNumbers * index;
  auto draw = [&] { return std::clamp(random.normal(counter++), -2.5, 2.5); };
  auto factor = [&](double sigma) { return 1.0 + sigma * draw(); };
  const double sx = factor(options.size_sigma), sy = factor(options.size_sigma);
  const Eigen::Vector3d scale(sx, sy, factor(options.size_sigma));
  ShapeSample out;
  const double bl = factor(options.box_sigma), bw = factor(options.box_sigma);
  out.dimensions = {car.dimensions.length * scale.x() * bl, car.dimensions.width * scale.z() * bw,
                    car.dimensions.height * scale.y() * factor(options.box_sigma)};
  Eigen::Matrix<double, kNumSideKeypoints, 3> shift;
  for (int axis = 0; axis < 3; ++axis) {
    for (int i = 0; i < kNumSideKeypoints; ++i) shift(i, axis) = options.design_sigma * draw();
  }
  shift = (design * shift).eval();
  for (int i = 0; i < kNumKeypoints; ++i) {
    const double side = i < kNumSideKeypoints ? 1.0 : -1.0;
    const Eigen::Vector3d shared = shift.row(i % kNumSideKeypoints).transpose();
    out.keypoints.col(i) = scale.asDiagonal() * car.keypoints[i] +
                           Eigen::Vector3d(shared.x(), shared.y(), side * shared.z());
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
  if (!(design_sigma >= 0.0) || !(design_reach > 0.0)) {
    throw std::invalid_argument(fmt::format(
        "design_sigma, design_reach: {}, {}, must be >= 0 and > 0", design_sigma, design_reach));
  }
  ShapeLearningOptions{num_coefficients}.validate();
}

VehiclePrior learn_family_prior(const FamilyPriorOptions& options) {
  options.validate();
  const CounterRandom random(options.seed);
  const CounterRandom car_boxes(options.seed, 1), van_boxes(options.seed, 2);
  const Root car_design = design_root(CarClass::kHatchback, options.design_reach);
  const Root van_design = design_root(CarClass::kVan, options.design_reach);
  std::vector<ShapeSample> cars, vans;
  for (std::uint64_t i = 0; static_cast<int>(cars.size()) < options.samples; ++i) {
    const CarModel car = sample_car(random, i);
    if (car.car_class != CarClass::kVan)
      cars.push_back(to_sample(car, options, car_design, car_boxes, i));
  }
  for (std::uint64_t i = 0; static_cast<int>(vans.size()) < options.samples; ++i) {
    vans.push_back(
        to_sample(sample_car(CarClass::kVan, random, i), options, van_design, van_boxes, i));
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
