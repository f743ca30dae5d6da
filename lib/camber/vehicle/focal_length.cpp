#include "camber/vehicle/focal_length.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "camber/core/threads.h"

namespace camber {
namespace {

/// A support plane after all depths are multiplied by a factor.
SupportPlane stretched(const SupportPlane& support, double factor) {
  SupportPlane out = support;
  Plane& plane = out.plane.plane;
  plane.normal.z() /= factor;
  const double length = plane.normal.norm();
  plane.normal /= length;
  plane.offset /= length;
  out.plane.centroid.z() *= factor;
  Eigen::Vector3d along = support.plane.axis1;
  along.z() *= factor;
  UncertainPlane::make_axes(plane.normal, along, &out.plane.axis1, &out.plane.axis2);
  return out;
}

PinholeCamera with_focal_length(const PinholeCamera& camera, double factor) {
  PinholeCamera out = camera;
  out.fx *= factor;
  out.fy *= factor;
  return out;
}

}  // namespace

FocalLengthEvidence focal_length_evidence(const PinholeCamera& camera,
                                          const std::vector<VehicleDetection>& detections,
                                          const std::vector<SupportPlane>& supports,
                                          const std::vector<VehicleEstimate>& estimates,
                                          const VehicleFitOptions& options, int num_threads,
                                          std::optional<double> other_factor) {
  if (supports.size() != detections.size() || estimates.size() != detections.size()) {
    throw std::invalid_argument(fmt::format("{} detections, {} supports, {} estimates",
                                            detections.size(), supports.size(), estimates.size()));
  }
  const HypothesisGates& noise = options.noise.hypotheses;
  FocalLengthEvidence out;
  const auto compare = [&](double factor) {
    // A far vehicle stands on a plane that is known by little: what is wrong with it would count
    // for another focal length. Far or near by the shorter of the two depths: which of the focal
    // lengths is the true one is not known.
    std::vector<std::size_t> used;
    for (std::size_t i = 0; i < detections.size(); ++i) {
      const double depth = std::min(1.0, factor) * estimates[i].pose.center().z();
      if (std::isfinite(estimates[i].keypoint_cost) && depth < noise.focal_length_farthest) {
        used.push_back(i);
      }
    }
    const double most = noise.focal_length_most;
    const PinholeCamera other = with_focal_length(camera, factor);
    std::vector<double> gains(used.size());
    parallel_for(used.size(), num_threads, [&](std::size_t k) {
      const std::size_t i = used[k];
      const VehicleEstimate again =
          fit_vehicle(other, detections[i], stretched(supports[i], factor), options);
      const double gain = estimates[i].keypoint_cost - again.keypoint_cost;
      gains[k] = std::isfinite(gain) ? std::clamp(gain, -most, most) : -most;
    });
    double sum = 0.0;
    for (const double gain : gains) sum += gain;
    if (out.vehicles == 0 || sum > out.gain) out.vehicles = static_cast<int>(used.size());
    if (sum > out.gain) {
      out.gain = sum;
      out.factor = factor;
    }
    return sum;
  };
  // Coarsely to both sides, then farther and nearer on the better one.
  for (const double factor : {1.0 / M_SQRT2, M_SQRT2}) compare(factor);
  if (out.gain > 0.0) {
    const double coarse = out.factor;
    for (const double power : {0.5, 2.0}) compare(std::pow(coarse, power));
  }
  if (other_factor) out.log_ratio_of_other = compare(*other_factor);
  return out;
}

FocalLengthProfile focal_length_profile(const PinholeCamera& camera,
                                        const VehicleDetection& detection,
                                        const SupportPlane& support,
                                        const std::vector<double>& factors,
                                        const VehicleFitOptions& options) {
  constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
  FocalLengthProfile out;
  for (const double factor : factors) {
    const SupportPlane plane = stretched(support, factor);
    const VehicleEstimate fit =
        fit_vehicle(with_focal_length(camera, factor), detection, plane, options);
    const Eigen::Vector3d& up = plane.plane.plane.normal;
    const bool answered = std::isfinite(fit.keypoint_cost) && fit.covariance.allFinite();
    out.costs.push_back(fit.keypoint_cost);
    out.heights.push_back(answered ? -up.dot(fit.pose.bottom_center()) : kNone);
    // How the plane leans moves its foot below the camera.
    Eigen::RowVector3d by_tilt = plane.plane.height_jacobian(Eigen::Vector3d::Zero());
    by_tilt(2) = 0.0;
    const double variance = up.dot(fit.covariance.topLeftCorner<3, 3>() * up) +
                            by_tilt.dot(by_tilt * plane.plane.covariance);
    out.height_sigmas.push_back(answered ? std::sqrt(variance) : kNone);
    out.depths.push_back(answered ? fit.pose.center().z() : kNone);
  }
  return out;
}

}  // namespace camber
