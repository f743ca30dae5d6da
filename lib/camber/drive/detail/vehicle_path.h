#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <optional>
#include <vector>

#include "camber/drive/detail/track_rejection.h"
#include "camber/geometry/se3.h"
#include "camber/scene/results.h"

namespace camber::internal {

/// An estimate of a vehicle in the camera of its frame.
struct SeenVehicle {
  const VehicleEstimate* vehicle = nullptr;  ///< not owned
  int frame = 0;                             ///< id
  double time = 0.0;                         ///< s
  SE3 world_from_camera;
  Eigen::Matrix3d information = Eigen::Matrix3d::Zero();  ///< of the bottom centre, camera, 1 / m^2
  bool cut = false;                                       ///< by a side of the picture

  Eigen::Vector3d measured() const { return vehicle->pose.bottom_center(); }
};

constexpr double kOwnRange = 0.04;    ///< relative, of one view beside what its covariance has
constexpr double kSizeSigma = 0.04;   ///< relative, of what the size does to all distances
constexpr double kSpeedSigma = 15.0;  ///< m/s, of vehicles that move, along their heading
constexpr double kViewsAlike = 5.0;   ///< neighbouring windows share their errors
/// Squared Mahalanobis distance, within which two views of one vehicle from one frame to the next
/// are (docs/notes/drives.md); it may have moved in between.
constexpr double kMostWithin = 0.8;

/// Where a vehicle is by all its views: directions, which the pictures show, and distances, which
/// hang on its size and share a factor. Views from several places measure the factor by the way
/// between them.
struct VehiclePath {
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  ///< m, world, at the mean time
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();  ///< m/s; zero: it stands
  double log_factor = 0.0;
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();  ///< of the position
  /// Robust sum of squares in standard deviations, for views that are not alike.
  double cost = 0.0;
  /// Of the views, but for what all paths have in common (Laplace's approximation: MacKay,
  /// "Information Theory, Inference, and Learning Algorithms", 2003, chapter 28).
  double log_evidence = 0.0;
};

/// Where one view has its vehicle.
TrackPlace place_of(const SeenVehicle& view);

/// Squared Mahalanobis distance of two places, between which a vehicle may have moved.
double squared_distance(const TrackPlace& before, const TrackPlace& after);

/// The heading of greatest weight: views that see a vehicle the other way round are turned.
Eigen::Quaterniond mean_rotation(const std::vector<SeenVehicle>& seen);

/// The place of a vehicle that stands; nothing where its views are rather those of one that moves
/// at a constant velocity, either as likely before.
/// @param seen  one view at least.
std::optional<VehiclePath> parked_place(const std::vector<SeenVehicle>& seen);

/// Takes views out of a track where two vehicles explain all better than one, each standing or
/// moving.
/// @param seen  by time.
/// @return the parts; the track itself where nothing is cut.
std::vector<std::vector<SeenVehicle>> divided(const std::vector<SeenVehicle>& seen);

}  // namespace camber::internal
