#pragma once

#include <algorithm>
#include <vector>

#include "camber/scale/lane_marking_detection.h"

namespace camber::detail {

constexpr float kLeastContrast = 8.0F;  // intensities, of paint

/// A bar brighter than the ground on both sides, in one row.
struct Bar {
  float u = 0.0F;         // middle, px
  float contrast = 0.0F;  // over the brighter side, intensities
  float noise = 0.0F;     // standard deviation of contrasts around it
};

/// Bars of one width, row by row.
class BarFinder {
 public:
  BarFinder(const GrayImage& image, const PinholeCamera& camera, const GroundRaster& ground,
            double width)
      : image_(image), camera_(camera), ground_(ground), width_(width) {}

  /// Running sums of one row.
  std::vector<float> sums(int v) const;

  double inverse_depth(int u, int v) const {
    if (v < ground_.top || v >= camera_.height || u < 0 || u >= camera_.width) return 0.0;
    return ground_.inverse_depth[index(u, v)];
  }

  bool visible(int u, int v) const {
    if (v < ground_.top || v >= camera_.height || u < 0 || u >= camera_.width) return false;
    return ground_.visible[index(u, v)] != 0;
  }

  double width_px(double rho) const { return std::max(1.2, width_ * camera_.fx * rho); }

  /// Contrast of a bar centred on u against the brighter of its sides; NaN beyond the image.
  /// @param sum  sums() of the row
  float contrast(const std::vector<float>& sum, double u, double bar) const;

  /// Local maxima of the contrast in one row that stand out of the texture around them; of many
  /// bars side by side, which are their own texture, all.
  std::vector<Bar> row(int v, bool repeated) const;

 private:
  std::size_t index(int u, int v) const {
    return static_cast<std::size_t>(v - ground_.top) * static_cast<std::size_t>(camera_.width) +
           static_cast<std::size_t>(u);
  }
  const GrayImage& image_;
  const PinholeCamera& camera_;
  const GroundRaster& ground_;
  double width_;
};

/// Bars of all rows from `top` down, one entry a row.
std::vector<std::vector<Bar>> find_bars(const BarFinder& finder, int top, int height, bool repeated,
                                        int num_threads);

}  // namespace camber::detail
