#include "camber/render/color_map.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <opencv2/imgproc.hpp>

namespace camber {

namespace {

std::array<Color, 256> color_table(int map) {
  cv::Mat grey(1, 256, CV_8U), bgr;
  for (int i = 0; i < 256; ++i) grey.at<std::uint8_t>(0, i) = static_cast<std::uint8_t>(i);
  cv::applyColorMap(grey, bgr, map);
  std::array<Color, 256> colors;
  for (int i = 0; i < 256; ++i) {
    const cv::Vec3b& c = bgr.at<cv::Vec3b>(0, i);
    colors[i] = {c[2], c[1], c[0], 1.0};
  }
  return colors;
}

}  // namespace

Color plasma(double share) {
  static const std::array<Color, 256> table = color_table(cv::COLORMAP_PLASMA);
  if (!std::isfinite(share)) return {128, 128, 128, 1.0};
  return table[std::lround(255.0 * (0.1 + 0.8 * std::clamp(share, 0.0, 1.0)))];
}

Color diverging(double share) {
  if (!std::isfinite(share)) return {128, 128, 128, 1.0};
  constexpr double kStops[5][3] = {
      {22, 72, 150}, {110, 165, 215}, {222, 222, 222}, {240, 165, 80}, {178, 84, 0}};
  const double at = 4.0 * std::clamp(share, 0.0, 1.0);
  const int i = std::min(3, static_cast<int>(at));
  std::uint8_t mixed[3];
  for (int c = 0; c < 3; ++c) {
    const double value = kStops[i][c] + (at - i) * (kStops[i + 1][c] - kStops[i][c]);
    mixed[c] = static_cast<std::uint8_t>(std::lround(value));
  }
  return {mixed[0], mixed[1], mixed[2], 1.0};
}

Color viridis(double share) {
  static const std::array<Color, 256> table = color_table(cv::COLORMAP_VIRIDIS);
  if (!std::isfinite(share)) return {128, 128, 128, 1.0};
  return table[std::lround(0.9 * 255.0 * std::clamp(share, 0.0, 1.0))];
}

Color categorical(int index) {
  static constexpr std::array<std::array<std::uint8_t, 3>, 6> kColors = {{{230, 159, 0},
                                                                          {86, 180, 233},
                                                                          {0, 158, 115},
                                                                          {204, 121, 167},
                                                                          {240, 228, 66},
                                                                          {150, 110, 235}}};
  const int count = static_cast<int>(kColors.size());
  const auto& c = kColors[((index % count) + count) % count];
  return {c[0], c[1], c[2], 1.0};
}

std::string format_number(double value, int decimals) {
  char text[64];
  std::snprintf(text, sizeof(text), "%.*f", decimals, value);
  const std::string out = text;
  if (out[0] == '-' && out.find_first_not_of("-0.") == std::string::npos) return out.substr(1);
  return out;
}

std::string format_with_sigma(double value, double sigma) {
  const std::string text = format_number(value, 1);
  return sigma > 0.0 ? text + " ± " + format_number(sigma, sigma < 0.095 ? 2 : 1) : text;
}

std::string format_step(double step) {
  return format_number(step,
                       std::clamp(static_cast<int>(std::ceil(-std::log10(step) - 1e-9)), 0, 12));
}

Ticks make_ticks(double low, double high, int count, double origin) {
  Ticks ticks;
  if (!std::isfinite(low) || !std::isfinite(high)) return ticks;
  const double span = std::max(high - low, 1e-9 * std::max(1.0, std::abs(low)));
  const double rough = span / std::max(1, count);
  const double power = std::pow(10.0, std::floor(std::log10(rough)));
  double best = power;
  for (const double factor : {1.0, 2.0, 5.0, 10.0}) {
    if (std::abs(std::log(factor * power / rough)) < std::abs(std::log(best / rough))) {
      best = factor * power;
    }
  }
  return multiples_of(best, low, high, origin);
}

Ticks multiples_of(double step, double low, double high, double origin) {
  Ticks ticks;
  ticks.step = step;
  const int decimals = std::clamp(static_cast<int>(std::ceil(-std::log10(step) - 1e-9)), 0, 12);
  const auto first = static_cast<long long>(std::ceil((low + origin) / step - 1e-6));
  const auto last = static_cast<long long>(std::floor((high + origin) / step + 1e-6));
  for (long long i = first; i <= last; ++i) {
    const double labelled = static_cast<double>(i) * step;
    ticks.values.push_back(labelled - origin);
    ticks.labels.push_back(format_number(labelled, decimals));
  }
  return ticks;
}

void draw_color_bar(Canvas& canvas, const Box2& bar, double low, double high,
                    const std::vector<std::string>& title, double text_size, const Color& ink,
                    ColorScale scale) {
  const int rows = std::max(1, static_cast<int>(std::lround(bar.height())));
  for (int row = 0; row < rows; ++row) {
    const double share = 1.0 - (row + 0.5) / rows;
    const double y = bar.y1 + row;
    canvas.segments({{{bar.x1, y}, {bar.x2, y}}}, 1.0, scale(share));
  }
  canvas.polyline({{bar.x1, bar.y1}, {bar.x2, bar.y1}, {bar.x2, bar.y2}, {bar.x1, bar.y2}}, true,
                  std::max(1.0, text_size / 16.0), ink);
  const Ticks ticks = make_ticks(low, high, 5);
  for (std::size_t i = 0; i < ticks.values.size(); ++i) {
    const double share = (ticks.values[i] - low) / std::max(high - low, 1e-12);
    const double y = bar.y2 - share * bar.height();
    canvas.segments({{{bar.x2, y}, {bar.x2 + 0.35 * text_size, y}}},
                    std::max(1.0, text_size / 16.0), ink);
    canvas.text({bar.x2 + 0.6 * text_size, y}, ticks.labels[i], text_size, ink);
  }
  for (std::size_t i = 0; i < title.size(); ++i) {
    const double y = bar.y1 - text_size * (1.15 * static_cast<double>(title.size() - i) - 0.1);
    canvas.text({bar.x1, y}, title[i], text_size, ink);
  }
}

}  // namespace camber
