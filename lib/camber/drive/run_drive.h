#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "camber/core/progress.h"
#include "camber/drive/drive_tracks.h"
#include "camber/drive/measure_window.h"
#include "camber/drive/trajectory.h"
#include "camber/drive/window_log.h"
#include "camber/pipeline/reconstruct.h"
#include "camber/road/road_strip.h"
#include "camber/scene/drive_document.h"

namespace camber {

struct DriveOptions {
  ReconstructOptions window;  ///< of the stages in each window; seed and threads too
  RoadSampleOptions samples;
  TrajectoryNoise noise;
  RoadStripOptions strip;
  int each_side = 2;  ///< key frames to each side of a window's reference, 1 to 4
  /// Key frames from one window's reference to the next, >= 1; at most 2 each_side - 1 are, so that
  /// neighbours share a step.
  int every = 3;
  void validate() const;  ///< throws std::invalid_argument
};

struct DriveResult {
  Trajectory trajectory;
  DriveDocument document;         ///< drive.json: lengths, mounting, every frame
  Eigen::Vector3d up{0, -1, 0};   ///< unit, world (the first frame's camera)
  bool level_by_gravity = false;  ///< `up` is gravity's; false: the mean of the road's normals
  RoadStrip strip;
  DriveTracks tracks;
  Timings timings;
};

/// Reads the frames one after the other, measures windows of them and writes these to `log`; then
/// estimates the whole drive from the log. Memory is that of a window's images and of what the
/// windows measured, whatever the length of the drive.
/// @param frame_ids  ascending ids of the scene.
/// @throws NoAnswerError where the camera never moves; InterruptedError: the log holds what was
///         done, and another call with it goes on from there.
DriveResult run_drive(const Scene& scene, const std::vector<int>& frame_ids,
                      const DriveOptions& options, WindowLog* log, const Progress& progress = {});

}  // namespace camber
