#pragma once

#include "camber/pipeline/reconstruct.h"

namespace camber {

/// The main job on one image: its markings of known size take the place of match, motion and
/// ground; surface, vehicles and assemble are those of reconstruct().
/// @param options  valid, with seed and threads handed down.
/// @throws NoAnswerError, with what is missing; as reconstruct().
Reconstruction reconstruct_image(const Scene& scene, const std::vector<int>& frame_ids,
                                 const ReconstructOptions& options, const Progress& progress);

}  // namespace camber
