#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <limits>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "camber/core/status.h"
#include "camber/geometry/se3.h"

namespace camber {

/// A number with its standard deviation; NaN: not known.
struct DriveNumber {
  double value = std::numeric_limits<double>::quiet_NaN();
  double sigma = std::numeric_limits<double>::quiet_NaN();
};

/// One frame of a drive.
struct DriveFrame {
  int id = 0;
  double time_s = std::numeric_limits<double>::quiet_NaN();
  std::optional<SE3> world_from_camera;  ///< m; none: no pose is known
  /// Of the pose: rotation vector (rad), translation (m), in the camera.
  std::optional<Eigen::Matrix<double, 6, 6>> covariance;
  DriveNumber s;                         ///< m, along the driven line
  DriveNumber height;                    ///< m, of the camera above the road
  DriveNumber pitch, roll, grade, bank;  ///< rad
  DriveNumber speed;                     ///< m/s
  Status status = Status::kNotRun;
  std::string reason;
};

/// A stretch of a drive whose length is stated by itself.
struct DriveWindow {
  int first = 0, last = 0;                                         ///< frame ids
  double length = std::numeric_limits<double>::quiet_NaN();        ///< m, sum of its frames' steps
  double length_sigma = std::numeric_limits<double>::quiet_NaN();  ///< m
};

/// What a receiver's positions on a map measured of a drive.
struct DrivePositions {
  int frames = 0;          ///< that have one
  double log_scale = 0.0;  ///< logarithm of lengths on the map over those by the images alone
  double sigma = 0.0;      ///< of it, by the positions
  /// How far that is from the images' own metres; NaN: these are none.
  double disagreement_sigmas = std::numeric_limits<double>::quiet_NaN();
};

/// drive.json. The world is the camera of the first frame that has a pose.
struct DriveDocument {
  bool metric = true;
  double length = std::numeric_limits<double>::quiet_NaN();        ///< m, sum of the frames' steps
  double length_sigma = std::numeric_limits<double>::quiet_NaN();  ///< m
  /// Relative: the part of the lengths' standard deviations that all windows share.
  double common_sigma = std::numeric_limits<double>::quiet_NaN();
  DriveNumber pitch, roll;  ///< rad, of the camera's mounting
  DriveNumber height;       ///< m, likewise
  std::optional<DrivePositions> positions;
  std::vector<DriveWindow> windows;
  std::vector<DriveFrame> frames;  ///< every frame taken, ids ascending
};

/// Numbers that are not finite become null.
nlohmann::json to_json(const DriveDocument& document);

/// @throws InputError "file: JSON path: found, expected". Only `frames` with their ids are
/// required.
DriveDocument read_drive(const std::filesystem::path& path);

}  // namespace camber
