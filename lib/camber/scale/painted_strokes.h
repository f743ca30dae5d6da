#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "camber/image/image.h"

namespace camber {

/// A stroke of paint between its two edges in one row of pixels.
struct StrokeRow {
  int row = 0;
  double left = 0.0, right = 0.0;  ///< columns of the edges, px
};

/// A bar brighter than what lies on both sides, followed over rows: nothing is assumed of where the
/// ground lies. Ends are those of its middle line.
struct PaintedStroke {
  std::vector<StrokeRow> rows;        ///< from below, at least kLeastRows
  Eigen::Vector2d near_end, far_end;  ///< half of the contrast where the end is seen
  /// Whether the paint ends there in view: not at the image's border, nor at what hides it.
  bool near_seen = false, far_seen = false;
  double contrast = 0.0;  ///< intensities, median over the rows

  static constexpr int kLeastRows = 4;

  /// Fitted edges (straight, curved where there are many rows) at a row.
  StrokeRow at(double row) const;
  Eigen::Vector2d middle(double row) const {
    const StrokeRow edges = at(row);
    return {0.5 * (edges.left + edges.right), row};
  }

  Eigen::Vector3d left_fit, right_fit;  ///< columns by powers of (row - fit_row)
  double fit_row = 0.0;
};

/// Finds bright strokes that run up the image, of any width from 1.5 px to an eighth of its width.
/// @param visible  one byte a pixel, non-zero where ground is seen and nothing hides it.
/// @param top      first row that is looked at.
/// @return nearest first. The same for any number of threads.
/// @throws std::invalid_argument if `visible` and the image differ in size.
std::vector<PaintedStroke> detect_painted_strokes(const GrayImage& image,
                                                  const std::vector<std::uint8_t>& visible, int top,
                                                  int num_threads = 0);

}  // namespace camber
