#pragma once

#include <vector>

#include "camber/core/progress.h"
#include "camber/core/stopwatch.h"
#include "camber/drive/run_drive.h"

namespace camber {

/// What measure_drive() reports when the last frame is read: its last windows are still open then.
inline constexpr double kWindowsShare = 0.95;

/// Reads the frames one after the other, chooses key frames by their parallax, and appends what the
/// windows about them measure to `log`, which goes on where it ends. Images of few windows are held
/// at once.
/// @throws InterruptedError; UsageError and OutputError as WindowLog.
void measure_drive(const Scene& scene, const std::vector<int>& frame_ids,
                   const DriveOptions& options, WindowLog* log, Timings* timings,
                   const Progress& progress);

}  // namespace camber
