#pragma once

#include <filesystem>
#include <limits>
#include <string>
#include <vector>

#include "camber/core/progress.h"
#include "camber/evaluate/trajectory_errors.h"
#include "camber/scene/scene.h"

namespace camber {

/// A frame of a true trajectory.
struct TrueFrame {
  int id = 0;
  double time_s = std::numeric_limits<double>::quiet_NaN();
  SE3 world_from_camera;
};

struct TrueTrajectory {
  std::string name;  ///< as given
  std::vector<TrueFrame> frames;
  bool timed = false;    ///< all frames have a time, ascending
  bool numbered = true;  ///< ids are those of the drive's frames; false: rows of a file with times
};

/// The true poses of a scene, with their frames' times.
/// @throws NoAnswerError where fewer than two frames of the truth have a pose.
TrueTrajectory true_trajectory(const Scene& scene, const std::string& name);

/// A file of poses (formats/trajectory.h: KITTI, TUM, ...) as truth: frames by their row from 0 on.
/// @param times  a file of one time a row, s (KITTI's times.txt), for poses without; may be empty.
/// @throws InputError.
TrueTrajectory read_true_trajectory(const std::filesystem::path& path,
                                    const std::filesystem::path& times);

/// Whether a path is a trajectory: a folder with a drive.json, drive.json itself, a file ending in
/// .tum, or a text file whose first line that is no comment is 8 or 12 numbers.
bool is_trajectory(const std::filesystem::path& path);

/// What an estimate has for the frames of a truth, ready for trajectory_errors().
struct ComparedTrajectory {
  std::string method;
  bool metric = true;
  int frames_taken = 0;
  std::vector<ComparedPose> poses;
  TrajectoryErrorOptions options;  ///< with the lengths that the estimate states
};

/// Reads an estimate and gives its poses to the truth's frames: those of a drive by their id, or by
/// their time where the truth is a file with times; those of a file by time, without times by
/// place.
/// @param path  is_trajectory()
/// @param warn  receives a sentence for poses on no frame of the truth, and for a drive that states
/// another length than its poses have; may be empty.
/// @throws InputError also where the times are others than the truth's, or the poses are of another
/// frame than the camera's.
ComparedTrajectory read_compared_trajectory(const std::filesystem::path& path,
                                            const TrueTrajectory& truth, const LogSink& warn);

}  // namespace camber
