#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "camber/calibrate/feature_tracks.h"
#include "camber/calibrate/window_bundle.h"

namespace camber {

struct WindowStartOptions {
  double inlier_px =
      2.0;                ///< epipolar and reprojection threshold, of an image of 1242 columns, > 0
  int least_points = 40;  ///< >= 8
  std::uint64_t seed = 0;
};

/// Motion and points of some successive key frames with an assumed lens: two views and resections
/// (estimate_motion()), then the points of all tracks by a linear triangulation (Hartley and
/// Zisserman, Multiple View Geometry, 2nd ed., 12.2). The reference is the middle frame.
/// @param count  key frames, >= 3.
/// @return nothing where no motion explains the tracks with this lens.
std::optional<CalibrationWindow> start_window(const DriveLens& lens,
                                              const std::vector<FeatureTrack>& tracks,
                                              std::size_t first, std::size_t count,
                                              const WindowStartOptions& options);

}  // namespace camber
