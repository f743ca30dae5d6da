#pragma once

#include "camber/pipeline/reconstruct.h"
#include "camber/pipeline/stage_runner.h"
#include "camber/pipeline/stages/find_road.h"
#include "camber/pipeline/stages/judge.h"

namespace camber {

/// Everything that the stages find in one window of frames; lengths in metres from `scaled` on.
struct WindowEstimate {
  FoundRoad road;             ///< its frames are those within reach of the reference
  PhotometricGround refined;  ///< `road` with the intensities of all images
  ScaledRoad scaled;
  SurfacePlan plan;
  PlacedVehicles vehicles;
  JudgedRoad judged;  ///< the road with its last word on the metres
  AssembledRoad assembled;
};

/// The options with seed and threads handed down to every stage.
ReconstructOptions handed_down(const ReconstructOptions& options);

/// The stages of preset kDefault, one after the other, on the frames of one window: what
/// reconstruct() asks of a few frames and a drive of each of its windows.
/// @param options  see handed_down().
/// @throws NoAnswerError as the stages do.
WindowEstimate estimate_window(const Scene& scene, LoadedFrames frames,
                               const ReconstructOptions& options, const StageRunner& run);

}  // namespace camber
