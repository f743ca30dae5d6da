#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "camber/geometry/box.h"
#include "camber/vehicle/shape_prior.h"

namespace camber::internal {

/// A length with its standard deviation, m.
struct MeasuredLength {
  double value = 0.0, sigma = 0.0;
};

/// Where a track was at a time.
struct TrackPlace {
  double time_s = 0.0;
  Eigen::Vector3d in_world = Eigen::Vector3d::Zero();  ///< m
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
};

/// What the views of a track say together.
struct TrackEvidence {
  std::string vehicle_class;
  std::optional<Dimensions> dimensions;  ///< m; none: lengths are in units
  /// Of one that stands: logarithm of what its distances by its size are too far by the way between
  /// its views, and its prior's standard deviation.
  std::optional<double> log_factor;
  double log_factor_sigma = 0.0;
  /// Of one that stands: of its place above the ground under each of its views.
  std::vector<MeasuredLength> heights;
  std::vector<TrackPlace> places;  ///< each by its own view, by time; empty: in units
  double speed_sigma = 0.0;        ///< m/s an axis, of what vehicles do
};

/// Why a track is no vehicle: its size, its height above the road or its motion is, under the
/// declared priors and the stated standard deviations, one that hardly one vehicle in a thousand
/// million has. Estimates have been drawn towards the priors, which errs on a vehicle's side.
/// Empty: it may be one.
std::string why_no_vehicle(const TrackEvidence& evidence, const VehiclePrior& prior);

}  // namespace camber::internal
