#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "camber/render/picture_space.h"

namespace camber {

/// What a legend explains.
struct LegendEntry {
  enum class Mark { kLine, kDashedLine, kFill, kDot, kEllipse } mark = Mark::kLine;
  Color color;
  std::string text;
};

/// Entries for what is there.
std::vector<LegendEntry> make_legend(const PictureSpace& space, const std::string& cameras);

/// Rows that a legend of this width takes.
int count_legend_rows(double width, const std::vector<LegendEntry>& entries, double text_size);

/// Height of a legend's rows, pixels.
inline double legend_height(int rows, double text_size) { return 1.3 * text_size * rows; }

/// A row of legend entries from `at` (left, middle of the line) to the right; entries that would
/// leave the picture are moved to a further row below.
void draw_legend(Canvas& canvas, const Eigen::Vector2d& at, double right_limit,
                 const std::vector<LegendEntry>& entries, double text_size);

}  // namespace camber
