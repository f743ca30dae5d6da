#pragma once

#include <string>
#include <vector>

#include "camber/render/canvas.h"

namespace camber {

/// Viridis without its last, pale tenth (readable on white; safe for the colour-blind).
/// @param share  in [0, 1], clamped; NaN gives grey.
/// Smith and van der Walt, "A Better Default Colormap for Matplotlib", SciPy 2015 (CC0).
Color viridis(double share);

/// Plasma without its darkest and palest tenths, for a second quantity beside viridis. As
/// viridis().
Color plasma(double share);

/// Blue over light grey to orange, for signed values with zero in the middle. As viridis().
Color diverging(double share);

/// A map from [0, 1] to colours.
using ColorScale = Color (*)(double share);

/// Distinct colours for things that differ by number (after Okabe and Ito, without reddish
/// ones: red is kept for truth). Any integer.
Color categorical(int index);

/// Round numbers in [low, high]: multiples of 1, 2 or 5 times a power of ten.
struct Ticks {
  double step = 1.0;
  std::vector<double> values;
  std::vector<std::string> labels;  ///< with as many decimals as the step needs
};

/// @param count  wanted number of steps, >= 1; the answer has about so many.
/// @param origin  what labels count from: they are those of values + origin, which are round.
Ticks make_ticks(double low, double high, int count, double origin = 0.0);

/// The same for a given step > 0.
Ticks multiples_of(double step, double low, double high, double origin = 0.0);

/// A number with a fixed number of decimals; never "-0.0".
std::string format_number(double value, int decimals);

/// "27.7 ± 0.3": a distance with its standard deviation where one is stated (above 0), which is
/// written with one decimal, below 0.095 with two.
std::string format_with_sigma(double value, double sigma);

/// A tick's step with as many decimals as it needs.
std::string format_step(double step);

/// A vertical bar of a colour scale with ticks and a title over it.
/// @param bar  pixels; labels are written to its right.
void draw_color_bar(Canvas& canvas, const Box2& bar, double low, double high,
                    const std::vector<std::string>& title, double text_size, const Color& ink,
                    ColorScale scale = viridis);

}  // namespace camber
