#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cstddef>
#include <limits>
#include <vector>

/// Heights over the plan, and what the ground is found with on them: sliding extremes (erosion and
/// dilation by squares), slopes.
namespace camber::detail {

inline constexpr float kNoHeight = std::numeric_limits<float>::infinity();  ///< of an empty cell

inline std::size_t as_size(int i) { return static_cast<std::size_t>(i); }

/// A grid of heights over the plan, rows of `width`.
struct HeightGrid {
  int width = 0, height = 0;
  std::vector<float> z;

  HeightGrid() = default;
  HeightGrid(int w, int h, float value) : width(w), height(h), z(as_size(w) * as_size(h), value) {}
  std::size_t at(int x, int y) const { return as_size(y) * as_size(width) + as_size(x); }
  float* row(int y) { return z.data() + at(0, y); }
  const float* row(int y) const { return z.data() + at(0, y); }
};

/// The least, or greatest, height within squares of 2 * radius + 1 cells. Beyond the border there
/// is nothing, and cells of kNoHeight do not count; where nothing counts, erode() leaves kNoHeight
/// and dilate() its negative. @param space  memory for the work
void erode(const HeightGrid& in, int radius, HeightGrid& out, std::vector<float>& space);
void dilate(const HeightGrid& in, int radius, HeightGrid& out, std::vector<float>& space);

/// Slope of a surface over `reach` cells to both sides, m a cell.
inline Eigen::Vector2f gradient(const HeightGrid& surface, int x, int y, int reach) {
  const int xl = std::max(x - reach, 0), xr = std::min(x + reach, surface.width - 1);
  const int yl = std::max(y - reach, 0), yr = std::min(y + reach, surface.height - 1);
  Eigen::Vector2f out(0.0f, 0.0f);
  if (xr > xl) {
    out.x() =
        (surface.z[surface.at(xr, y)] - surface.z[surface.at(xl, y)]) / static_cast<float>(xr - xl);
  }
  if (yr > yl) {
    out.y() =
        (surface.z[surface.at(x, yr)] - surface.z[surface.at(x, yl)]) / static_cast<float>(yr - yl);
  }
  return out;
}

}  // namespace camber::detail
