#pragma once

#include <cmath>
#include <stdexcept>

namespace camber {

/// A rectangle in plan, half-open: x0 <= x < x1 and y0 <= y < y1, so that the tiles of a plan share
/// no point. In the coordinates and units of a file.
struct PlanBounds {
  double x0 = 0.0, y0 = 0.0, x1 = 0.0, y1 = 0.0;

  /// False for what is not finite.
  bool contains(double x, double y) const { return x >= x0 && x < x1 && y >= y0 && y < y1; }
  /// Wider by a margin on every side.
  PlanBounds grown(double margin) const {
    return {x0 - margin, y0 - margin, x1 + margin, y1 + margin};
  }
  void validate() const {  ///< throws std::invalid_argument
    const bool finite =
        std::isfinite(x0) && std::isfinite(y0) && std::isfinite(x1) && std::isfinite(y1);
    if (!finite || !(x0 < x1 && y0 < y1)) {
      throw std::invalid_argument(
          "bounds: found a rectangle without an inside, expected x0 < x1 and y0 < y1");
    }
  }
};

}  // namespace camber
