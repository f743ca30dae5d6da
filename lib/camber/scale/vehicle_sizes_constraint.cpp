#include "camber/scale/vehicle_sizes_constraint.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "camber/scale/fusion.h"

namespace camber {
Constraint vehicle_sizes_constraint(const RoadPosterior& road,
                                    const std::vector<Constraint>& vehicles,
                                    const ScaleNoise& noise) {
  Constraint out;
  out.name = "vehicle_sizes";
  out.gate = noise.vehicle_sizes_gate;
  std::vector<ImpliedLogScale> scales;
  for (const Constraint& vehicle : vehicles) {
    const auto scale = implied_log_scale(road, vehicle);
    if (scale && scale->variance < noise.vehicle_size_most * noise.vehicle_size_most) {
      scales.push_back(*scale);
    }
  }
  out.source = fmt::format("{} vehicles", scales.size());
  constexpr std::size_t kLeast = 3;
  if (scales.size() < kLeast) return out;
  // Mean with Cauchy weights, from the median on: one van taken for a car must not decide.
  std::sort(scales.begin(), scales.end(),
            [](const ImpliedLogScale& a, const ImpliedLogScale& b) { return a.mean < b.mean; });
  double mean = scales[scales.size() / 2].mean, information = 0.0;
  for (int iteration = 0; iteration < 10; ++iteration) {
    double sum = 0.0;
    information = 0.0;
    for (const ImpliedLogScale& s : scales) {
      const double squared = (s.mean - mean) * (s.mean - mean) / s.variance;
      const double weight = 1.0 / (1.0 + squared / 4.0) / s.variance;
      sum += weight * s.mean;
      information += weight;
    }
    mean = sum / information;
  }
  double misfit = 0.0;
  for (const ImpliedLogScale& s : scales) {
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
