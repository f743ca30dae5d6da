#pragma once

#include <optional>
#include <vector>

#include "camber/render/loaded_result.h"
#include "camber/render/plot.h"

namespace camber {

/// One vehicle as several results place it, from the side and from above, to scale: wireframes (or
/// boxes) in a colour a result, the true box in red, the road towards it from the dense truth where
/// the first result has that, else from its surface, and the ray from the camera.
/// @param results  of one scene, not empty, not null; the first needs its `scene`, with truth.
/// @param frame    id.
/// @param vehicle  id of the true vehicle; without: the one on which the results differ most.
/// @throws NoAnswerError without truth, or if no true vehicle is matched and answered by all.
PlotSheet vehicle_comparison(const std::vector<const LoadedResult*>& results, int frame,
                             std::optional<int> vehicle);

}  // namespace camber
