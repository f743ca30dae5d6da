#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "camber/render/canvas.h"

namespace camber {

/// Colours that stay apart for the colour-blind on white (Okabe and Ito), without red, which is
/// kept for truth. Any integer.
Color plot_color(int index);

/// Data of one kind in a plot, in the units of its axes. NaN is a gap.
struct PlotSeries {
  enum class Kind {
    kLine,    ///< x, y
    kPoints,  ///< x, y with bars from low to high, where these are given
    kBand,    ///< x with low and high
    kBoxes,   ///< from (x, low) to (right, high), filled
    kImage,   ///< `image` from (x[0], y[0]), lower left, to (x[1], y[1]); never smoothed
  } kind = Kind::kLine;
  std::string name;  ///< in the legend; empty: not there
  /// Beside the right end; may be empty. Labels too many for the panel's height stand within it,
  /// those that find no room are left out.
  std::string label;
  Color color;
  std::vector<double> x, y, low, high, right;
  double thickness = 2.0;  ///< of lines, at a text size of 18
  bool dashed = false;
  int marker = 0;            ///< of points: 0 disc, 1 square, 2 triangle, 3 diamond, then again
  double marker_size = 1.0;  ///< of points, times the usual
  Image image;               ///< 3 channels, rows from the top
  /// Of lines in SVG: the text shown when each place is pointed at; empty or as many as `x`.
  std::vector<std::string> hover;
};

struct PlotAxis {
  std::string title;                ///< with its unit
  std::optional<double> low, high;  ///< without: from the data
  bool logarithmic = false;         ///< needs values > 0
  bool whole = false;               ///< ticks at whole numbers only
  bool hidden = false;              ///< neither ticks nor grid
  /// Names in place of numbers, at the given values.
  std::vector<std::pair<double, std::string>> names;
};

/// A word at a place of a plot.
struct PlotNote {
  double x = 0.0, y = 0.0;
  std::string text;
  TextAnchor anchor = TextAnchor::kLeft;
};

/// Axes with data.
struct Plot {
  std::string title;  ///< over the panel; may be empty
  PlotAxis x, y;
  std::vector<PlotSeries> series;
  std::vector<PlotNote> notes;
  bool equal_scale =
      false;  ///< the same length for a unit of x and of y, in all such panels of a sheet
};

/// Plots above one another, their left edges aligned.
struct PlotSheet {
  std::string title;  ///< may be empty
  std::vector<Plot> panels;
};

struct PlotStyle {
  int width = 1200;         ///< pixels, 160 to 8192
  int panel_height = 440;   ///< pixels of each panel with its legend and axis, 120 to 8192
  double text_size = 20.0;  ///< pixels, [6, 200]

  void validate() const;  ///< throws std::invalid_argument naming field, value and bound
};

/// Where a panel's axes lie in the drawing, and the values at their ends.
struct PlotAxes {
  Box2 box;  ///< pixels
  double x_low = 0.0, x_high = 0.0, y_low = 0.0, y_high = 0.0;

  /// Of linear axes.
  Eigen::Vector2d pixel(double x, double y) const {
    return {box.x1 + (x - x_low) / (x_high - x_low) * box.width(),
            box.y2 - (y - y_low) / (y_high - y_low) * box.height()};
  }
};

/// The axes of each panel as draw_plots() and plots_svg() place them; an SVG within HTML has them,
/// too: elements of class "axes" with data-box and data-range. @throws as draw_plots().
std::vector<PlotAxes> plot_axes(const PlotSheet& sheet, const PlotStyle& style = {});

/// Draws plots with axes, grid and legends; margins follow from the words, so that none is cut off
/// or covered. Needs no rendering back end. Same input, same pixels.
/// @throws std::invalid_argument for a sheet without panels, vectors of different lengths, bad
///         styles, or a picture higher than 65535 pixels; NoAnswerError for a panel without a
///         finite value.
Image draw_plots(const PlotSheet& sheet, const PlotStyle& style = {});

/// The same as an SVG element. Words keep their size relative to the width.
/// @param standalone  for a file of its own; without, for a place within HTML.
/// @throws as draw_plots().
std::string plots_svg(const PlotSheet& sheet, const PlotStyle& style = {}, bool standalone = true);

}  // namespace camber
