#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "camber/core/status.h"
#include "camber/geometry/plane.h"
#include "camber/geometry/se3.h"
#include "camber/scene/results.h"

namespace camber {

/// The road at one place as a window sees it, camera frame of the window's reference, m.
struct RoadSample {
  Eigen::Vector3f point = Eigen::Vector3f::Zero();
  float sigma = 0.0F;                          ///< m, standard deviation of the height
  std::uint8_t label = 0;                      ///< 1 road, 2 pavement, 0 not known
  std::array<std::uint8_t, 3> color{0, 0, 0};  ///< red, green, blue
};

/// What a window of a few frames measures of a drive. Windows are written down as they are made and
/// not changed; everything of a drive is estimated from them.
struct WindowMeasurement {
  int reference = 0;        ///< frame id
  std::vector<int> frames;  ///< ids, ascending, the reference among them
  /// Translations in baselines: the longest has length 1. Empty: no motion was found, see `reason`.
  std::vector<SE3> frame_from_reference;
  /// As MotionEstimate::covariance, of every frame but the reference.
  Eigen::MatrixXd covariance;
  /// Logarithm of the metres per baseline; none: the window knows no metres.
  std::optional<double> log_scale;
  double scale_sigma = 0.0;           ///< of it, the window's own
  double common_scale_sigma = 0.0;    ///< of it, shared by all windows of the camera
  bool metric = true;                 ///< false: log_scale is in nominal camera heights
  std::string reason;                 ///< why something is missing, or what is doubtful
  std::optional<UncertainPlane> ego;  ///< of the reference, m (by log_scale)
  std::vector<RoadSample> road;
  std::vector<VehicleFrame> vehicles;  ///< of its frames that have any, ascending
  /// Detections of this window's frames that are one vehicle.
  struct TrackedDetection {
    int frame = 0, id = 0, track = -1;
  };
  std::vector<TrackedDetection> tracked;

  std::size_t index_of_reference() const;
};

/// One window as bytes, the same for equal windows. Numbers are exact.
std::vector<std::uint8_t> encode(const WindowMeasurement& window);
/// @throws std::invalid_argument for bytes that encode() did not give.
WindowMeasurement decode_window(const std::vector<std::uint8_t>& bytes);

}  // namespace camber
