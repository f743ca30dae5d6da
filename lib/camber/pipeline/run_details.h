#pragma once

#include <vector>

#include "camber/pipeline/reconstruct.h"

namespace camber {

/// What every preset hands out of a run whose road is assembled, with a warning of the frames that
/// were asked for and are not in it.
Reconstruction handed_out(const std::vector<int>& frame_ids, const ReconstructOptions& options,
                          LoadedFrames& frames, AssembledRoad road);

/// Puts the options and what the stages found out beside their results into a run's document.
void describe_run(const ReconstructOptions& options, const std::vector<int>& frame_ids,
                  const LoadedFrames& frames, const PhotometricGround& ground,
                  const ScaledRoad& scaled, RunDocument* document);

}  // namespace camber
