#pragma once

#include "camber/pipeline/reconstruct.h"

namespace camber {

/// reconstruct() by the paper's method (preset kPaper). Options are handed down already.
Reconstruction reconstruct_paper(const Scene& scene, const std::vector<int>& frame_ids,
                                 const ReconstructOptions& options, const Progress& progress);

}  // namespace camber
