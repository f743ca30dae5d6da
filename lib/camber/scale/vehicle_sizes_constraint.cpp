#include "camber/scale/vehicle_sizes_constraint.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <optional>

namespace camber {
namespace {

struct LogScale {
  double mean = 0.0, variance = 0.0;
};

/// What one vehicle measures of the scale if the ground's shape is right.
std::optional<LogScale> log_scale_of(const RoadPosterior& road, const Constraint& vehicle) {
  const auto pixels = static_cast<Eigen::Index>(vehicle.pixels.size());
  Eigen::VectorXd inverse_depths(pixels);
  for (Eigen::Index i = 0; i < pixels; ++i) {
    inverse_depths[i] = road.inverse_depth(vehicle.pixels[static_cast<std::size_t>(i)]);
  }
  // Metric inverse depths fall as the scale grows.
  Eigen::VectorXd by_log_scale = -(vehicle.by_inverse_depth * inverse_depths);
  if (vehicle.by_log_scale.size() > 0) by_log_scale += vehicle.by_log_scale;
  const Eigen::MatrixXd spread = vehicle.covariance + road.covariance(road.of_constraint(vehicle));
  const Eigen::VectorXd weighted = spread.ldlt().solve(by_log_scale);
  const double information = weighted.dot(by_log_scale);
  if (!(information > 0.0)) return std::nullopt;
  return LogScale{weighted.dot(vehicle.residual) / information, 1.0 / information};
}

}  // namespace

Constraint vehicle_sizes_constraint(const RoadPosterior& road,
                                    const std::vector<Constraint>& vehicles,
                                    const ScaleNoise& noise) {
  Constraint out;
  out.name = "vehicle_sizes";
  out.gate = noise.vehicle_sizes_gate;
  std::vector<LogScale> scales;
  for (const Constraint& vehicle : vehicles) {
    const auto scale = log_scale_of(road, vehicle);
    if (scale && scale->variance < noise.vehicle_size_most * noise.vehicle_size_most) {
      scales.push_back(*scale);
    }
  }
  out.source = fmt::format("{} vehicles", scales.size());
  constexpr std::size_t kLeast = 3;
  if (scales.size() < kLeast) return out;
  // Mean with Cauchy weights, from the median on: one van taken for a car must not decide.
  std::sort(scales.begin(), scales.end(),
            [](const LogScale& a, const LogScale& b) { return a.mean < b.mean; });
  double mean = scales[scales.size() / 2].mean, information = 0.0;
  for (int iteration = 0; iteration < 10; ++iteration) {
    double sum = 0.0;
    information = 0.0;
    for (const LogScale& s : scales) {
      const double squared = (s.mean - mean) * (s.mean - mean) / s.variance;
      const double weight = 1.0 / (1.0 + squared / 4.0) / s.variance;
      sum += weight * s.mean;
      information += weight;
    }
    mean = sum / information;
  }
  double misfit = 0.0;
  for (const LogScale& s : scales) {
    misfit += std::min(9.0, (s.mean - mean) * (s.mean - mean) / s.variance);
  }
  misfit /= static_cast<double>(scales.size() - 1);
  out.residual = Eigen::VectorXd::Constant(1, mean);
  out.by_log_scale = Eigen::VectorXd::Ones(1);
  out.covariance = Eigen::MatrixXd::Constant(
      1, 1, std::max(1.0, misfit) / information + std::pow(noise.vehicle_population, 2));
  return out;
}

}  // namespace camber
