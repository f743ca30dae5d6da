#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include "camber/core/status.h"
#include "camber/geometry/box.h"
#include "camber/geometry/pinhole_camera.h"
#include "camber/geometry/plane.h"

namespace camber {

inline constexpr int kNumKeypoints = 36;

/// What hides a keypoint.
enum class KeypointVisibility : std::uint8_t {
  kVisible = 0,
  kHiddenByCar = 1,    ///< by the car itself, whatever else stands before it
  kHiddenByOther = 2,  ///< by something else alone
  kOutside = 3,        ///< of the image or of the crop
};

/// One network keypoint: pixel and the network's own confidence (NaN: none given).
struct KeypointObservation {
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  double confidence = std::numeric_limits<double>::quiet_NaN();
  /// px, standard deviation along each axis as the network states it; NaN: not stated.
  double sigma = std::numeric_limits<double>::quiet_NaN();
};

/// One vehicle in one image, as a detector gives it.
struct VehicleDetection {
  int id = 0;                         ///< unique within its frame
  std::string vehicle_class = "car";  ///< "car", "van", "truck", ...
  int track = -1;                     ///< joins frames; -1: unknown
  Box2 box;                           ///< pixels
  double score = 1.0;
  std::vector<KeypointObservation> keypoints;  ///< empty, or kNumKeypoints rows
  bool has_plane = false;                      ///< a local plane is given with the detection
  Plane given_plane;                           ///< camera frame of this image
};

/// The ground under a vehicle as a fit takes it.
struct SupportPlane {
  UncertainPlane plane;         ///< camera frame of the image, metres
  std::string source;           ///< "patch ID", "ego", "given" or "level"
  Status status = Status::kOk;  ///< of the patch
  /// m: an error of the plane's height that its covariance, by which it is weighed against the
  /// vehicle's own evidence, leaves out. It is in what is stated of the vehicle alone.
  double unmodelled_height = 0.0;
};

/// Keypoints of which nothing is known: NaN.
inline std::array<Eigen::Vector3d, kNumKeypoints> unknown_keypoints() {
  std::array<Eigen::Vector3d, kNumKeypoints> out;
  out.fill(Eigen::Vector3d::Constant(std::numeric_limits<double>::quiet_NaN()));
  return out;
}

/// A vehicle in the camera frame of its own image, metres (or up to scale).
struct VehicleEstimate {
  int id = 0;
  std::string vehicle_class;
  int track = -1;  ///< joins frames; -1: unknown
  Box2 box;
  Status status = Status::kNotRun;
  std::string reason;
  OrientedBox pose;  ///< full box, on its plane
  std::array<Eigen::Vector3d, kNumKeypoints> keypoints = unknown_keypoints();  ///< camera frame, m
  Plane plane;                                                           ///< the ground under it
  double plane_sigma_height = std::numeric_limits<double>::quiet_NaN();  ///< m, at the contact
  std::string plane_source;
  std::vector<double> shape;  ///< prior coefficients; empty: mean
  /// Centre x y z (m), rotation vector in the vehicle's frame (rad), length height width (m).
  /// NaN: none is stated; zeros state certainty.
  Eigen::Matrix<double, 9, 9> covariance =
      Eigen::Matrix<double, 9, 9>::Constant(std::numeric_limits<double>::quiet_NaN());
  double reprojection_rmse_px = std::numeric_limits<double>::quiet_NaN();
  /// Minus log posterior density of pose, size and shape at the maximum of one view's keypoints, up
  /// to a constant of the detection. NaN: none was found that enough of them agree with.
  double keypoint_cost = std::numeric_limits<double>::quiet_NaN();
};

}  // namespace camber
