#pragma once

#include <vector>

#include "camber/road/road_strip.h"
#include "camber/road/road_surface.h"

namespace camber {

struct StripSurfaceOptions {
  double length = 5.0;    ///< m of the driven line that one patch covers, > 0
  double width = 4.0;     ///< m across that one patch covers, > 0
  int fewest_cells = 12;  ///< of a patch, >= 3
  void validate() const;  ///< throws std::invalid_argument naming field, value and bound
};

/// Where the patches of a strip's surface lie.
struct StripPatches {
  std::vector<int> of_cell;      ///< by index into strip.cells: the patch's id, -1: none
  std::vector<double> stations;  ///< m, s of their middles, by index into the surface's patches
};

/// A strip as planar patches, side by side and one after another: the middle ones lie about the
/// driven line. Each is a robust plane through the heights of its cells, weighed by their standard
/// deviations. Errors of the cells of a patch come from the same windows: all of them count as one
/// observation. What the cells leave the plane by is PlanePatch::unmodelled_sigma.
/// Frame: the strip's, z up; the driven line is the feet of the cameras. `level`, `level_sigma`,
/// `metric` and `scale_sigma` are the caller's to set.
/// @param where  may be nullptr.
RoadSurface strip_surface(const RoadStrip& strip, const StripSurfaceOptions& options = {},
                          StripPatches* where = nullptr);

}  // namespace camber
