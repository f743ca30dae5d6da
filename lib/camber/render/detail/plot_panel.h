#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "camber/render/color_map.h"
#include "camber/render/detail/plot_paper.h"
#include "camber/render/plot.h"

namespace camber::detail {

/// Of finite values.
struct PlotRange {
  double low = std::numeric_limits<double>::infinity();
  double high = -std::numeric_limits<double>::infinity();

  void add(double value) {
    if (!std::isfinite(value)) return;
    low = std::min(low, value);
    high = std::max(high, value);
  }
  void add(const std::vector<double>& values) {
    for (const double value : values) add(value);
  }
  bool empty() const { return !(low <= high); }
};

inline constexpr double kPlotLineHeight = 1.35;  ///< of the text size
inline constexpr double kPlotLabelPitch = 1.15;  ///< of labels below one another

/// Ticks of an axis, about `count`.
Ticks ticks_of(const PlotAxis& axis, const PlotRange& range, int count);

/// The text size at which a line is no longer than there is room.
double fitted_size(const std::string& line, double size, double room, bool bold = false);

/// One panel: data ranges, ticks and the place of its axes.
class Panel {
 public:
  /// @throws std::invalid_argument for series that do not fit; NoAnswerError without finite values.
  Panel(const Plot& plot, const PlotStyle& style);

  /// Space left of the axes that labels and title need.
  double left_margin(const PlotStyle& style) const;

  double right_margin() const;

  void place(const Box2& area);

  /// Pixels for a unit at which both ranges fit.
  double scale() const;
  /// Lengthens the ranges around their middles.
  void set_scale(double pixels);

  PlotAxes axes() const { return {axes_, x_.low, x_.high, y_.low, y_.high}; }

  void draw(Paper& paper) const;
  /// Strips to point at, from top to bottom, one a place of a line that has texts for it.
  void draw_hover(SvgPaper& paper) const;

 private:
  double width(const std::string& line) const;
  int y_count(double height) const;
  int x_count() const;

  PlotRange range(const PlotAxis& axis, bool along_x) const;

  static void widen(const PlotAxis& axis, PlotRange* range, double share);

  double pixel_x(double x) const;
  double pixel_y(double y) const;
  Eigen::Vector2d at(double x, double y) const { return {pixel_x(x), pixel_y(y)}; }
  Eigen::Vector2d clamped(double x, double y) const;

  void draw_series(Paper& paper, const PlotSeries& s) const;
  void marker(Paper& paper, const Eigen::Vector2d& p, const PlotSeries& s) const;

  double entry_width(const PlotSeries& s) const { return 2.2 * text_ + width(s.name); }
  std::vector<std::vector<const PlotSeries*>> plan_legend(double left, double right) const;
  void draw_legend(Paper& paper) const;
  /// Words beside the right ends, pushed apart where they would meet.
  void draw_labels(Paper& paper) const;

  const Plot& plot_;
  double text_;
  bool labels_inside_ = false;
  PlotRange x_, y_;
  Box2 area_, axes_;
  std::vector<std::vector<const PlotSeries*>> legend_rows_;
};

}  // namespace camber::detail
