#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <string>
#include <vector>

#include "camber/core/status.h"
#include "camber/drive/window_measurement.h"
#include "camber/geometry/se3.h"

namespace camber {

/// Noise of the smoother, where it was measured: docs/notes/drives.md.
struct TrajectoryNoise {
  /// Windows overlap: the same pictures measure a step several times with nearly the same error.
  /// Factor on the covariance of a window's motion, >= 1.
  double motion_inflation = 5.0;
  double rotation_floor = 1e-4;      ///< rad, of a relative pose, > 0
  double translation_floor = 0.003;  ///< of the longest baseline, > 0
  /// Degrees of freedom of Student's distribution of a window's own error of the scale: a window
  /// that took another layer for the road is outvoted by its neighbours.
  double scale_freedom = 3.0;
  double scale_floor = 0.01;  ///< relative, of a window's own scale, > 0
  /// Relative: a window that knows its scale worse has no vote on the drive's, > 0. On a film whose
  /// coder repeats the asphalt such windows are off by many of their standard deviations.
  double weakest_scale = 0.15;
  /// Correlation of the own errors of two windows one frame apart; n frames apart its n-th power.
  /// In [0, 1).
  double scale_correlation = 0.6;
  /// How far the windows' scales are off each other is a measure of how good they are; their stated
  /// standard deviations count as so many windows that are off as stated, > 0.
  double windows_as_stated = 10.0;
  double motion_freedom = 4.0;  ///< the same of a window's motion
  /// Spectral density of the acceleration along the way, m^2 / s^3, > 0: a vehicle's speed is a
  /// random walk (Bar-Shalom, Li, Kirubarajan, "Estimation with Applications to Tracking and
  /// Navigation", 2001, section 6.2.2). 0.7 m/s^2 that lasts for 2 s.
  double acceleration_density = 2.0;
  /// s: errors of a GNSS receiver's positions last so long (assumed), > 0.
  double position_correlation = 10.0;
};

/// Positions of a GNSS receiver along a drive, on a map in metres (east, north, height).
struct MapPositions {
  struct At {
    std::size_t place = 0;  ///< of the frame among those of the drive
    Eigen::Vector3d position = Eigen::Vector3d::Zero();
    double sigma = 0.0, height_sigma = 0.0;  ///< m; of each plan coordinate; infinite: no height
  };
  std::vector<At> at;                                              ///< by ascending places
  Eigen::Vector3d antenna = Eigen::Vector3d::Zero();               ///< m, camera frame
  Eigen::Matrix3d level_from_world = Eigen::Matrix3d::Identity();  ///< z is the map's
};

/// What a map knows of a drive.
struct DriveOnMap {
  MapPositions positions;
  double log_scale = 0.0;     ///< logarithm by which the windows' own lengths are too short
  double common_sigma = 0.0;  ///< relative, once that is known: of what all windows share
};

struct TrajectoryPose {
  int frame = 0;  ///< id
  Status status = Status::kNotRun;
  std::string reason;  ///< empty for kOk
  SE3 world_from_camera;
  /// Of (rotation vector, rad; translation, m) in the camera's own frame, against the first frame,
  /// without what all windows share of the scale.
  Eigen::Matrix<double, 6, 6> covariance = Eigen::Matrix<double, 6, 6>::Zero();
  bool measured = false;  ///< false: held or interpolated, no window shows it
  /// m, standard deviations without what all windows share of the scale: of the way from the first
  /// frame, and of that from the frame before to the frame after.
  double way_sigma = 0.0, beside_sigma = 0.0;
};

/// Weight of a window's scale below which the drive contradicts it: it took something else for the
/// road.
constexpr double kLeastWindowWeight = 0.2;

struct Trajectory {
  bool metric = false;
  std::vector<TrajectoryPose> poses;  ///< of every frame taken, ascending
  double common_sigma = 0.0;          ///< relative: what all windows share of the scale
  /// By reference frame: how far each window's own scale is from the smoothed one, in standard
  /// deviations, and the weight in (0, 1] of one so far off.
  struct WindowScale {
    int reference = 0;
    double residual_sigma = 0.0, weight = 1.0;
    double log_scale = 0.0;  ///< smoothed
  };
  std::vector<WindowScale> scales;

  /// The whole, and every kWindow steps, one every kEvery frames.
  struct Stretch {
    int first = 0, last = 0;  ///< frame ids
    double length = 0.0;      ///< m, sum of the steps
    double own_sigma = 0.0;   ///< m, without common_sigma
    double sigma() const;     ///< m
    double common = 0.0;      ///< common_sigma, relative
  };
  static constexpr std::size_t kWindow = 50, kEvery = 10;
  Stretch whole;
  std::vector<Stretch> windows;
  const TrajectoryPose* find(int frame) const;
};

/// The trajectory that all windows of a drive agree on best: a maximum a posteriori estimate over
/// the poses of all frames and the scale of each window. The windows' relative poses are known by
/// their motion up to their scale, their scales by the road; both with heavy tails. The world is
/// the first frame's camera.
/// @param frame_ids  every frame taken, ascending.
/// @param windows    in the order of their references. One whose motion is not finite, or not in
///                   baselines, is left out.
/// @param times      s, of every frame; empty: nothing is known of speeds.
/// @param still      ids of frames since the one before which the camera stands, by the pictures.
/// @param map        positions hold the trajectory where it would drift; how the map lies in the
///                   world (a turn about the vertical and a shift) is estimated, too. Null: none.
/// @throws NoAnswerError if the equations of the windows have no solution.
Trajectory smooth_trajectory(const std::vector<int>& frame_ids,
                             const std::vector<WindowMeasurement>& windows,
                             const TrajectoryNoise& noise = {},
                             const std::vector<double>& times = {}, const DriveOnMap* map = nullptr,
                             const std::vector<int>& still = {});

}  // namespace camber
