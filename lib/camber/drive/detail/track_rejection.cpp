#include "camber/drive/detail/track_rejection.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

namespace camber::internal {
namespace {

// Squared distances in standard deviations: of a normal distribution in one and in three dimensions
// two in a thousand million lie beyond.
constexpr double kImprobable = 36.0;
constexpr double kImprobableIn3 = 42.6;
/// Of the steps of a track: fewer are views of another vehicle that were joined by mistake.
constexpr double kMostJumps = 1.0 / 3.0;

double squared_distance(const Eigen::Vector3d& off, const Eigen::Matrix3d& covariance) {
  const Eigen::LDLT<Eigen::Matrix3d> factors(covariance);
  if (factors.info() != Eigen::Success || !factors.isPositive()) return 0.0;
  const double out = off.dot(factors.solve(off));
  return std::isfinite(out) ? out : 0.0;
}

std::string by_size(const TrackEvidence& evidence, const VehiclePrior& prior) {
  if (evidence.dimensions) {
    const SizePrior size = prior.size(evidence.vehicle_class);
    const Dimensions& d = *evidence.dimensions;
    const Eigen::Vector3d off = Eigen::Vector3d(d.length, d.width, d.height) - size.mean;
    if (squared_distance(off, size.covariance) > kImprobableIn3) {
      return fmt::format("{:.1f} x {:.1f} x {:.1f} m are no size of a {}", d.length, d.width,
                         d.height, evidence.vehicle_class);
    }
  }
  if (evidence.log_factor) {
    const double off = *evidence.log_factor / evidence.log_factor_sigma;
    if (off * off > kImprobable) {
      return fmt::format("by the way between its views it has {:.2f} of the size of a {}",
                         std::exp(-*evidence.log_factor), evidence.vehicle_class);
    }
  }
  return {};
}

/// Views share their errors: their weighted mean is no better than one of them.
std::string by_height(const TrackEvidence& evidence) {
  double weights = 0.0, sum = 0.0;
  std::size_t count = 0;
  for (const MeasuredLength& height : evidence.heights) {
    const double weight = 1.0 / (height.sigma * height.sigma);
    if (!std::isfinite(weight) || !std::isfinite(height.value)) continue;
    weights += weight;
    sum += weight * height.value;
    ++count;
  }
  if (count == 0) return {};
  const double mean = sum / weights, variance = static_cast<double>(count) / weights;
  if (mean * mean <= kImprobable * variance) return {};
  return fmt::format("it is {:.1f} m {} the road", std::abs(mean), mean > 0.0 ? "above" : "below");
}

/// Whether no vehicle gets from one place to another in that time.
bool is_jump(const TrackPlace& a, const TrackPlace& b, double speed_sigma) {
  const double way = speed_sigma * (b.time_s - a.time_s);
  const Eigen::Matrix3d covariance =
      a.covariance + b.covariance + way * way * Eigen::Matrix3d::Identity();
  return squared_distance(b.in_world - a.in_world, covariance) > kImprobableIn3;
}

std::string by_motion(const TrackEvidence& evidence) {
  if (evidence.places.empty()) return {};
  const TrackPlace &first = evidence.places.front(), &last = evidence.places.back();
  if (last.time_s > first.time_s && is_jump(first, last, evidence.speed_sigma)) {
    return fmt::format("it moves at {:.0f} m/s",
                       (last.in_world - first.in_world).norm() / (last.time_s - first.time_s));
  }
  std::size_t steps = 0, jumps = 0;
  for (std::size_t i = 1; i < evidence.places.size(); ++i) {
    const TrackPlace &a = evidence.places[i - 1], &b = evidence.places[i];
    if (!(b.time_s > a.time_s)) continue;
    ++steps;
    jumps += is_jump(a, b, evidence.speed_sigma) ? 1 : 0;
  }
  if (steps == 0 || static_cast<double>(jumps) <= kMostJumps * static_cast<double>(steps)) {
    return {};
  }
  return fmt::format("it jumps, in {} of {} steps", jumps, steps);
}

}  // namespace

std::string why_no_vehicle(const TrackEvidence& evidence, const VehiclePrior& prior) {
  std::string out = by_size(evidence, prior);
  if (out.empty()) out = by_height(evidence);
  if (out.empty()) out = by_motion(evidence);
  return out;
}

}  // namespace camber::internal
