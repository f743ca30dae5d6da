#pragma once

#include "camber/road/segment_ground.h"

namespace camber {

/// The same question as segment_ground() put to the Point Cloud Library, to check one against the
/// other: its progressive morphological filter on a grid (Zhang et al., "A progressive
/// morphological filter for removing nonground measurements from airborne LIDAR data", TGRS 2003).
/// Options that are 0 mean here: cell 0.5 m, largest_object 12 m, slope 0.3, tolerance 0.2 m (the
/// height within which ground is seen at the first window); sensor_height is not used. Reflections
/// below the ground are ground to it, and hide what is.
/// @return kFailed also for a cloud whose grid would have more than four million cells.
/// @throws std::invalid_argument if options.validate() fails. Deterministic; one thread.
GroundSegmentation segment_ground_pcl(const RoadCloud& cloud, const GroundOptions& options = {});

}  // namespace camber
