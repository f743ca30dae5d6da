#pragma once

#include "camber/calibrate/calibrate_drive.h"
#include "camber/pipeline/network_choice.h"

namespace camber {

/// The vehicles by which a drive is calibrated: boxes of the chosen detector, of the one that ships
/// where none is chosen and the scene has no box; then keypoints. A segmenter is not run.
/// @param pixels  images in memory, as stages::LoadOptions has them.
VehicleFinder vehicle_finder(const NetworkChoice& networks, int num_threads,
                             const FramePixelSource& pixels = {});

}  // namespace camber
