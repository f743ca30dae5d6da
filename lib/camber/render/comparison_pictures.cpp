#include "camber/render/comparison_pictures.h"

#include <algorithm>
#include <cmath>

#include "camber/render/canvas.h"
#include "camber/render/color_map.h"
#include "camber/render/picture_file.h"

namespace camber {
namespace {

const Color kInk{40, 40, 40, 1.0}, kFaint{215, 215, 215, 1.0};
const Color kAccuracy{0, 114, 178, 1.0}, kCompleteness{230, 159, 0, 1.0};

std::vector<double> counted_distances(const OneWay& way) {
  std::vector<double> out;
  for (std::size_t i = 0; i < way.distances.distance.size(); ++i) {
    if (way.counted[i] != 0 && std::isfinite(way.distances.distance[i])) {
      out.push_back(way.distances.distance[i]);
    }
  }
  std::sort(out.begin(), out.end());
  return out;
}

/// Where the curves are worth seeing: up to twice the largest threshold.
double shown_range(const CloudComparison& comparison) {
  double largest = 0.0;
  for (const ThresholdScore& s : comparison.scores) largest = std::max(largest, s.threshold);
  return 2.0 * largest;
}

/// Axes of a plot in a picture of 900 x 560.
struct Axes {
  Image image = make_picture(900, 560, 255);
  double left = 80, right = 870, top = 50, bottom = 490, highest_x = 1.0, highest_y = 1.0;

  Eigen::Vector2d at(double x, double y) const {
    return {left + (right - left) * x / highest_x, bottom - (bottom - top) * y / highest_y};
  }

  void draw(Canvas& canvas, const std::string& title, const std::string& x_name) const {
    const Ticks x = make_ticks(0.0, highest_x, 8), y = make_ticks(0.0, 100.0 * highest_y, 5);
    std::vector<Segment2> lines;
    for (const double value : x.values) lines.emplace_back(at(value, 0), at(value, highest_y));
    for (const double value : y.values) {
      lines.emplace_back(at(0, value / 100.0), at(highest_x, value / 100.0));
    }
    canvas.segments(lines, 1.0, kFaint);
    canvas.polyline({at(0, highest_y), at(0, 0), at(highest_x, 0)}, false, 1.5, kInk);
    for (std::size_t i = 0; i < x.values.size(); ++i) {
      canvas.text(at(x.values[i], 0) + Eigen::Vector2d(0, 18), x.labels[i], 18, kInk,
                  TextAnchor::kCenter);
    }
    for (std::size_t i = 0; i < y.values.size(); ++i) {
      canvas.text(at(0, y.values[i] / 100.0) - Eigen::Vector2d(8, 0), y.labels[i] + " %", 18, kInk,
                  TextAnchor::kRight);
    }
    canvas.text({0.5 * (left + right), bottom + 44}, x_name, 20, kInk, TextAnchor::kCenter);
    canvas.text({left, 24}, title, 22, kInk, TextAnchor::kLeft, true);
    canvas.rectangle({left + 20, top + 12, left + 38, top + 24}, kAccuracy);
    canvas.text({left + 46, top + 18}, "accuracy: estimate to truth", 18, kInk);
    canvas.rectangle({left + 20, top + 36, left + 38, top + 48}, kCompleteness);
    canvas.text({left + 46, top + 42}, "completeness: truth to estimate", 18, kInk);
  }
};

}  // namespace

Image draw_histogram(const CloudComparison& comparison) {
  constexpr int kBars = 40;
  Axes axes;
  axes.highest_x = shown_range(comparison);
  const OneWay* const ways[] = {&comparison.accuracy, &comparison.completeness};
  std::vector<double> shares[2];
  axes.highest_y = 0.0;
  for (int k = 0; k < 2; ++k) {
    const std::vector<double> distances = counted_distances(*ways[k]);
    shares[k].assign(kBars, 0.0);
    for (const double d : distances) {
      const double bar = std::min(kBars - 1.0, std::floor(d / axes.highest_x * kBars));
      shares[k][static_cast<std::size_t>(bar)] += 1.0 / static_cast<double>(distances.size());
    }
    axes.highest_y =
        std::max(axes.highest_y, *std::max_element(shares[k].begin(), shares[k].end()));
  }
  axes.highest_y = std::max(0.01, 1.05 * axes.highest_y);
  Canvas canvas(axes.image);
  const Color colors[] = {kAccuracy, kCompleteness};
  const double width = axes.highest_x / kBars;
  for (int k = 0; k < 2; ++k) {
    for (int i = 0; i < kBars; ++i) {
      const double share = shares[k][static_cast<std::size_t>(i)];
      if (share <= 0.0) continue;
      const Eigen::Vector2d corner = axes.at((i + 0.08 + 0.42 * k) * width, share),
                            foot = axes.at((i + 0.50 + 0.42 * k) * width, 0.0);
      canvas.rectangle({corner.x(), corner.y(), foot.x(), foot.y()}, colors[k]);
    }
  }
  axes.draw(canvas, "Distances", "distance, m (last bar: all beyond)");
  return axes.image;
}

Image draw_cumulative(const CloudComparison& comparison) {
  Axes axes;
  axes.highest_x = shown_range(comparison);
  Canvas canvas(axes.image);
  std::vector<Segment2> marks;
  for (const ThresholdScore& s : comparison.scores) {
    marks.emplace_back(axes.at(s.threshold, 0.0), axes.at(s.threshold, 1.0));
  }
  axes.draw(canvas, "Points within a distance", "distance, m (dashed: thresholds)");
  canvas.dashed(marks, 6, 5, 1.5, kInk.with_alpha(0.6));
  const OneWay* const ways[] = {&comparison.accuracy, &comparison.completeness};
  const Color colors[] = {kAccuracy, kCompleteness};
  for (int k = 0; k < 2; ++k) {
    const std::vector<double> distances = counted_distances(*ways[k]);
    std::vector<Eigen::Vector2d> curve;
    for (int i = 0; i <= 400; ++i) {
      const double x = axes.highest_x * i / 400.0;
      const double within = static_cast<double>(
          std::upper_bound(distances.begin(), distances.end(), x) - distances.begin());
      curve.push_back(axes.at(x, within / static_cast<double>(distances.size())));
    }
    canvas.polyline(curve, false, 2.5, colors[k]);
  }
  return axes.image;
}

Image draw_height_map(const CloudComparison& comparison) {
  const HeightErrorMap& map = comparison.map;
  const double limit = 0.5 * shown_range(comparison);
  // u upwards, v to the left.
  const int across = std::max(1, map.height), ahead = std::max(1, map.width);
  const int scale = std::clamp(900 / std::max(across, ahead), 1, 12);
  Image image = make_picture(across * scale + 40, ahead * scale + 80, 255);
  Canvas canvas(image);
  for (int y = 0; y < map.height; ++y) {
    for (int x = 0; x < map.width; ++x) {
      const float error =
          map.error[static_cast<std::size_t>(y) * static_cast<std::size_t>(map.width) +
                    static_cast<std::size_t>(x)];
      if (!std::isfinite(error)) continue;
      const double share = std::clamp(static_cast<double>(error) / limit, -1.0, 1.0);
      const auto fade = [&](double strength) {
        return static_cast<std::uint8_t>(std::lround(235.0 - 195.0 * std::max(0.0, strength)));
      };
      const std::uint8_t rgb[3] = {fade(-share), fade(std::abs(share)), fade(share)};
      for (int j = 0; j < scale; ++j) {
        for (int i = 0; i < scale; ++i) {
          const std::size_t column = static_cast<std::size_t>((across - 1 - y) * scale + i + 20),
                            row = static_cast<std::size_t>((ahead - 1 - x) * scale + j + 60);
          std::copy_n(
              rgb, 3,
              image.data.begin() + static_cast<std::ptrdiff_t>(
                                       3 * (row * static_cast<std::size_t>(image.width) + column)));
        }
      }
    }
  }
  canvas.text({20, 20}, "height error, cells of " + format_number(map.cell, 2) + " m", 18, kInk);
  canvas.text({20, 42},
              "blue -" + format_number(limit, 2) + " m, red +" + format_number(limit, 2) + " m", 18,
              kInk);
  return image;
}

RoadCloud color_by_distance(const OneWay& way, double largest) {
  RoadCloud cloud = way.points;
  cloud.colors.assign(cloud.size(), {128, 128, 128});
  std::vector<float>& error = cloud.scalars["error"];
  error.resize(cloud.size());
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    error[i] = static_cast<float>(way.distances.distance[i]);
    if (way.counted[i] == 0) continue;
    const Color c = viridis(way.distances.distance[i] / largest);
    cloud.colors[i] = {c.red, c.green, c.blue};
  }
  if (way.along_normal.count > 0) {
    std::vector<float>& signed_error = cloud.scalars["error_along_normal"];
    for (const double d : way.distances.along_normal) signed_error.push_back(static_cast<float>(d));
  }
  return cloud;
}

}  // namespace camber
