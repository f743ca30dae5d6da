#pragma once

#include <optional>
#include <vector>

#include "camber/calibrate/drive_lens.h"
#include "camber/calibrate/window_bundle.h"
#include "camber/scene/scene.h"

namespace camber {

/// An angle or a length with its standard deviation.
struct MountingNumber {
  double value = 0.0, sigma = 0.0;
  int windows = 0;  ///< that it was seen in
};

/// How a camera is mounted on its vehicle. Angles in rad: pitch is positive where the optical axis
/// rises against the road, yaw where it looks to the right of the way straight on, roll where the
/// image's right side is down against the road.
struct Mounting {
  std::optional<MountingNumber> pitch, yaw, roll;
  std::optional<MountingNumber> height;  ///< m, above the road; by what is known of metres
  /// Names of the sources of the height (CameraSource), those that bring most first; commas
  /// between.
  std::string height_by;
};

/// The road under one window by its points: inverse depth is affine in the ray over a plane,
/// n . r = -h / depth for r with z = 1.
struct WindowRoad {
  Eigen::Vector3d normal;  ///< unit, up, reference camera
  double height = 0.0;     ///< of the reference camera above this plane, units of the window
  int points = 0;          ///< that agree
  double depth = 0.0;      ///< their median, units of the window
};

/// A robust plane through the points before the vehicle; nothing where too few agree on one.
std::optional<WindowRoad> road_of_window(const CalibrationWindow& window);

/// Direction of travel at each key frame but the last, unit, in the camera half-way to the next,
/// with how far it turned until then (rad, right is positive).
struct TravelStep {
  Eigen::Vector3d direction;
  double turn = 0.0;
};
std::vector<TravelStep> travel_steps(const CalibrationWindow& window);

/// The mounting by the direction of travel where the drive is straight (pitch, yaw), and by the
/// road's planes (roll).
/// @param covariance  of the lens: errors of cx and cy are errors of yaw and pitch.
Mounting estimate_mounting(const std::vector<WindowBundle>& windows, const DriveLens& lens,
                           const DriveLens::Matrix& covariance);

/// Metres from each key frame to the next.
struct MetresAlong {
  std::vector<double> steps;  ///< m; NaN: not known
  double sigma = 0.0;         ///< relative, of all of them together
  bool by_positions = false;  ///< else by speeds
};

/// Of the speeds that the scene's frames have; nothing where no step is known.
/// @param key_ids  frame ids, ascending.
std::optional<MetresAlong> metres_by_speed(const Scene& scene, const std::vector<int>& key_ids);

/// Of the positions on the map, of scenes without speeds: the way over the ground from half a
/// second before a frame to half a second after. Fixes near in time have most of their errors in
/// common: they differ by half a metre at most. Nothing where the vehicle is not plainly faster.
std::optional<MetresAlong> metres_by_positions(const Scene& scene, const std::vector<int>& key_ids);

/// How high the camera is above the road: its height in the window's unit, times the metres per
/// unit of the path through its key frames.
/// @param focal_sigma  relative: a wrong focal length stretches the path and not the height.
std::optional<MountingNumber> estimate_height(const std::vector<WindowBundle>& windows,
                                              const MetresAlong& metres, double focal_sigma);

}  // namespace camber
