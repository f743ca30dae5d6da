#pragma once

#include <memory>
#include <vector>

#include "camber/drive/window_measurement.h"
#include "camber/pipeline/reconstruct.h"
#include "camber/pipeline/stages/load.h"

namespace camber {

struct RoadSampleOptions {
  double cell = 0.5;        ///< m, of the road that one sample stands for, > 0
  double reach = 25.0;      ///< m ahead of the camera, > 0
  double half_width = 6.0;  ///< m to each side of the direction of travel, > 0
};

/// The stages of reconstruct() on a window of a drive. Where they give no road, the motion alone is
/// measured; where there is no motion either, the window has no poses, with the reason in `reason`.
/// @param reference  index into `frames`.
/// @param options    handed_down(); of preset kDefault.
/// @throws InterruptedError; InputError as load().
WindowMeasurement measure_window(
    const Scene& scene, const std::vector<std::shared_ptr<const stages::LoadedFrame>>& frames,
    std::size_t reference, const ReconstructOptions& options, const RoadSampleOptions& samples,
    Timings* timings);

/// The motion alone, for frames between those that have a road of their own.
WindowMeasurement measure_motion(
    const Scene& scene, const std::vector<std::shared_ptr<const stages::LoadedFrame>>& frames,
    std::size_t reference, const ReconstructOptions& options, Timings* timings);

}  // namespace camber
