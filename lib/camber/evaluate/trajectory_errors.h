#pragma once

#include <limits>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "camber/geometry/se3.h"

namespace camber {

/// A frame of a drive as truth and estimate have it, each in a world of its own.
struct ComparedPose {
  int id = 0;
  SE3 truth;                    ///< world_from_camera, m
  std::optional<SE3> estimate;  ///< world_from_camera; none: the estimate has no pose of the frame
};

/// A stretch of an estimate with the standard deviation of its length.
struct StatedLength {
  int first = 0, last = 0;                                  ///< frame ids
  double sigma = std::numeric_limits<double>::quiet_NaN();  ///< relative, total; NaN: not stated
};

struct TrajectoryErrorOptions {
  /// m, of the sub-paths; those of KITTI's odometry benchmark.
  std::vector<double> sub_paths{100, 200, 300, 400, 500, 600, 700, 800};
  int every = 10;              ///< frames from the start of one sub-path to that of the next, >= 1
  double short_drive = 150.0;  ///< m; shorter ones are judged by half their length, too
  int window = 50;             ///< steps of a window, >= 1
  int window_every = 10;       ///< frames from window to window, >= 1
  double least_length = 1.0;   ///< m; shorter windows have no scale: the camera stands
  double close_window = 0.02;  ///< log; share of windows closer than this
  double length_sigma = std::numeric_limits<double>::quiet_NaN();  ///< relative, stated, of all
  double common_sigma = std::numeric_limits<double>::quiet_NaN();  ///< relative, shared by windows
  /// The estimate's own windows; empty: `window` steps one every `window_every` frames from the
  /// first frame with a pose on.
  std::vector<StatedLength> windows;

  void validate() const;  ///< @throws std::invalid_argument
};

/// Means over sub-paths of one or several lengths; NaN where there is none.
struct SubPathErrors {
  double length = 0.0;  ///< m, of one length; 0: several
  int count = 0;        ///< sub-paths that were judged
  int unanswered = 0;   ///< sub-paths without a pose at one of their ends
  double translation = std::numeric_limits<double>::quiet_NaN();  ///< share of the length
  double rotation = std::numeric_limits<double>::quiet_NaN();     ///< rad per m
};

/// KITTI's measure with sub-paths that start every n frames.
struct OdometryErrors {
  int every = 1;
  SubPathErrors all;                     ///< all lengths together, each sub-path counts alike
  std::vector<SubPathErrors> by_length;  ///< those with a sub-path
  std::optional<SubPathErrors> half;     ///< sub-paths of half the drive; short drives only
};

struct WindowError {
  int first = 0, last = 0;   ///< frame ids
  double true_length = 0.0;  ///< m
  double length = 0.0;       ///< estimated
  double error = 0.0;        ///< logarithm of estimated over true length
  double sigma = std::numeric_limits<double>::quiet_NaN();  ///< relative, stated
};

/// Scale by windows. Shares and means are NaN where there is no window.
struct WindowErrors {
  std::vector<WindowError> windows;
  int unanswered = 0;                  ///< windows with a frame at an end that has no pose
  int stationary = 0;                  ///< windows in which the camera hardly moves
  double mean = 0.0, deviation = 0.0;  ///< of the logarithms
  double p95 = 0.0;                    ///< of their absolute values
  double close = 0.0;                  ///< share within options.close_window
  int with_sigma = 0;                  ///< windows that state one
  double within_2_sigma = 0.0;         ///< share of those
  /// Root of the mean square of (error less the mean) over the windows' own part of sigma; NaN
  /// where fewer than two windows have such a part.
  double own_spread = 0.0;
};

/// Positions and steps of all frames with a pose, under one alignment with the truth.
struct AlignedErrors {
  double scale = 1.0;  ///< of the estimate, by the alignment
  double ate_rmse = 0.0, ate_mean = 0.0, ate_median = 0.0, ate_max = 0.0;  ///< m
  double rpe_translation = 0.0;  ///< m, root mean square over steps
  double rpe_rotation = 0.0;     ///< rad, likewise
};

struct TrajectoryErrors {
  int frames = 0, posed = 0;  ///< with a truth, and of these with an estimate
  double true_length = 0.0;   ///< m, sum of the steps from posed frame to posed frame
  double length = 0.0;        ///< estimated, likewise
  double length_error = 0.0;  ///< logarithm of the ratio; NaN without motion
  double length_sigma = std::numeric_limits<double>::quiet_NaN();  ///< relative, stated
  OdometryErrors every_nth, every_frame;
  WindowErrors windows;
  AlignedErrors unaligned;   ///< worlds joined at the first frame with a pose
  AlignedErrors rigid;       ///< Umeyama, without scale
  AlignedErrors with_scale;  ///< Umeyama (PAMI 1991)
};

/// Errors of a trajectory: the measure of KITTI's odometry benchmark (Geiger, Lenz and Urtasun,
/// CVPR 2012: lengths by the truth's steps from frame to frame, errors over the nominal length),
/// scale by windows, absolute and relative errors (Sturm et al., IROS 2012).
/// @param poses  in the order of the drive.
/// @throws NoAnswerError for fewer than two frames with a pose;
/// std::invalid_argument for bad options.
TrajectoryErrors trajectory_errors(const std::vector<ComparedPose>& poses,
                                   const TrajectoryErrorOptions& options = {});

/// Why an estimate's poses seem to be of another frame than the camera's: the inverse poses or
/// turned axes by which its steps would go where the true ones go; empty where they do so as they
/// are, or by neither.
std::string remark_on_frame(const std::vector<ComparedPose>& poses);

/// The errors of one estimate under its name.
struct EvaluatedTrajectory {
  std::string truth, estimate;  ///< as given
  std::string method;           ///< "drive", or the form of a file: "TUM", "KITTI", ...
  bool metric = true;           ///< false: lengths are up to scale
  int frames_taken = 0;         ///< by the estimate, with or without truth
  TrajectoryErrors errors;
};

/// For a terminal, or Markdown tables.
std::string trajectory_text(const std::vector<EvaluatedTrajectory>& trajectories, bool markdown);
nlohmann::json to_json(const EvaluatedTrajectory& trajectory);

}  // namespace camber
