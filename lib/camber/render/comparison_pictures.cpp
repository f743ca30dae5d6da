#include "camber/render/comparison_pictures.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "camber/render/canvas.h"
#include "camber/render/color_map.h"
#include "camber/render/picture_file.h"
#include "camber/render/plot.h"

namespace camber {
namespace {

const Color kInk{40, 40, 40, 1.0};

std::vector<double> counted_distances(const DirectedDistances& directed) {
  std::vector<double> out;
  for (std::size_t i = 0; i < directed.distances.distance.size(); ++i) {
    if (directed.counted[i] != 0 && std::isfinite(directed.distances.distance[i])) {
      out.push_back(directed.distances.distance[i]);
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

const PlotStyle kStyle{1000, 560, 18.0};
const char* const kNames[] = {"accuracy: estimate to truth", "completeness: truth to estimate"};

const char* unit_of(const CloudComparison& comparison) { return comparison.metric ? "m" : "units"; }

/// A panel with a map and, to its right, the bar of its colours from -limit to limit.
Image map_with_bar(Plot plot, int along, int across, double limit,
                   const std::vector<std::string>& words) {
  PlotStyle style = kStyle;
  style.panel_height =
      std::clamp(120 + static_cast<int>(0.9 * style.width * across / along), 330, 1200);
  const Image panel = draw_plots({"", {std::move(plot)}}, style);
  // Room for the colour bar to the right.
  constexpr int kBar = 150;
  Image image = make_picture(panel.width + kBar, panel.height, 255);
  for (int y = 0; y < panel.height; ++y) {
    std::copy_n(
        panel.row(y), 3 * static_cast<std::size_t>(panel.width),
        &image.data[3 * static_cast<std::size_t>(y) * static_cast<std::size_t>(image.width)]);
  }
  Canvas canvas(image);
  const double bottom = std::min(panel.height - 60.0, 400.0);
  draw_color_bar(canvas, {panel.width + 10.0, 84.0, panel.width + 32.0, bottom}, -limit, limit,
                 words, kStyle.text_size, kInk, diverging);
  return image;
}

}  // namespace

Image draw_histogram(const CloudComparison& comparison) {
  constexpr int kBars = 40;
  const double range = shown_range(comparison), width = range / kBars;
  const DirectedDistances* const directions[] = {&comparison.accuracy, &comparison.completeness};
  Plot plot;
  plot.title = "Distances";
  plot.x.title = std::string("distance, ") + unit_of(comparison) + " (last bar: all beyond)";
  plot.y.title = "share of points, %";
  plot.x.low = plot.y.low = 0.0;
  plot.x.high = range;
  for (int k = 0; k < 2; ++k) {
    PlotSeries bars;
    bars.kind = PlotSeries::Kind::kBoxes;
    bars.name = kNames[k];
    bars.color = plot_color(k);
    bars.low.assign(kBars, 0.0);
    bars.high.assign(kBars, 0.0);
    for (int i = 0; i < kBars; ++i) {
      bars.x.push_back((i + 0.08 + 0.42 * k) * width);
      bars.right.push_back((i + 0.50 + 0.42 * k) * width);
    }
    const std::vector<double> distances = counted_distances(*directions[k]);
    for (const double d : distances) {
      const double bar = std::min(kBars - 1.0, std::floor(d / width));
      bars.high[static_cast<std::size_t>(bar)] += 100.0 / static_cast<double>(distances.size());
    }
    plot.series.push_back(bars);
  }
  return draw_plots({"", {plot}}, kStyle);
}

Image draw_cumulative(const CloudComparison& comparison) {
  Plot plot;
  plot.title = "Points within a distance";
  plot.x.title = std::string("distance, ") + unit_of(comparison);
  plot.y.title = "share of points, %";
  plot.x.low = plot.y.low = 0.0;
  plot.x.high = shown_range(comparison);
  plot.y.high = 100.0;
  const DirectedDistances* const directions[] = {&comparison.accuracy, &comparison.completeness};
  for (int k = 0; k < 2; ++k) {
    const std::vector<double> distances = counted_distances(*directions[k]);
    PlotSeries curve;
    curve.name = kNames[k];
    curve.color = plot_color(k);
    curve.thickness = 2.5;
    for (int i = 0; i <= 400; ++i) {
      const double x = *plot.x.high * i / 400.0;
      const double within = static_cast<double>(
          std::upper_bound(distances.begin(), distances.end(), x) - distances.begin());
      curve.x.push_back(x);
      curve.y.push_back(100.0 * within / static_cast<double>(distances.size()));
    }
    plot.series.push_back(curve);
  }
  PlotSeries marks;
  marks.name = "thresholds";
  marks.color = {40, 40, 40, 0.6};
  marks.dashed = true;
  marks.thickness = 1.5;
  for (const ThresholdScore& s : comparison.scores) {
    for (const double share : {0.0, 100.0, std::numeric_limits<double>::quiet_NaN()}) {
      marks.x.push_back(s.threshold);
      marks.y.push_back(share);
    }
  }
  plot.series.push_back(marks);
  return draw_plots({"", {plot}}, kStyle);
}

Image draw_height_map(const CloudComparison& comparison) {
  const HeightErrorMap& map = comparison.map;
  const double limit = 0.5 * shown_range(comparison);
  const int across = std::max(1, map.height), along = std::max(1, map.width);
  const double cell = map.cell > 0.0 ? map.cell : 1.0;
  PlotSeries cells;
  cells.kind = PlotSeries::Kind::kImage;
  cells.x = {map.u, map.u + along * cell};
  cells.y = {map.v, map.v + across * cell};
  cells.image = make_picture(along, across, 255);
  for (int y = 0; y < map.height; ++y) {
    for (int x = 0; x < map.width; ++x) {
      const float error =
          map.error[static_cast<std::size_t>(y) * static_cast<std::size_t>(map.width) +
                    static_cast<std::size_t>(x)];
      if (!std::isfinite(error)) continue;
      const Color c = diverging(0.5 + 0.5 * static_cast<double>(error) / limit);
      std::uint8_t* out = &cells.image.data[3 * (static_cast<std::size_t>(across - 1 - y) *
                                                     static_cast<std::size_t>(along) +
                                                 static_cast<std::size_t>(x))];
      out[0] = c.red;
      out[1] = c.green;
      out[2] = c.blue;
    }
  }
  Plot plot;
  const std::string unit = unit_of(comparison);
  plot.title = "Height error, cells of " + format_number(cell, 2) + " " + unit;
  plot.x.title = (map.of_axes ? "x, " : "along the road, ") + unit;
  plot.y.title = (map.of_axes ? "y, " : "to the left, ") + unit;
  plot.x.low = cells.x[0];
  plot.x.high = cells.x[1];
  plot.y.low = cells.y[0];
  plot.y.high = cells.y[1];
  plot.equal_scale = true;
  plot.series = {std::move(cells)};
  return map_with_bar(std::move(plot), along, across, limit,
                      {"estimate above (+)", "the truth, " + unit});
}

RoadCloud color_by_distance(const DirectedDistances& directed, double largest) {
  RoadCloud cloud = directed.points;
  cloud.colors.assign(cloud.size(), {128, 128, 128});
  std::vector<float>& error = cloud.scalars["error"];
  error.resize(cloud.size());
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    error[i] = static_cast<float>(directed.distances.distance[i]);
    if (directed.counted[i] == 0) continue;
    const Color c = viridis(directed.distances.distance[i] / largest);
    cloud.colors[i] = {c.red, c.green, c.blue};
  }
  if (directed.along_normal.count > 0) {
    std::vector<float>& signed_error = cloud.scalars["error_along_normal"];
    for (const double d : directed.distances.along_normal)
      signed_error.push_back(static_cast<float>(d));
  }
  return cloud;
}

namespace {

/// m, where the colours of changes end: 95 % of the significant ones, or twice the limit.
double change_range(const CloudChange& change) {
  std::vector<double> sizes;
  for (const CoreChange& core : change.cores) {
    if (core.significant) sizes.push_back(std::abs(core.distance));
  }
  double range = 2.0 * change.median_limit;
  if (!sizes.empty()) {
    std::sort(sizes.begin(), sizes.end());
    range = std::max(range, sizes[(sizes.size() * 19) / 20]);
  }
  return std::max(range, 1e-6);
}

Color change_color(const CoreChange& core, double range) {
  if (!core.significant) return {190, 190, 190, 1.0};
  return diverging(0.5 + 0.5 * core.distance / range);
}

}  // namespace

RoadCloud change_cloud(const CloudChange& change) {
  RoadCloud out;
  out.frame = CloudFrame::kZUp;
  out.metric = change.metric;
  const double range = change_range(change);
  if (!change.cores.empty()) out.origin = change.cores.front().point.array().round();
  for (const CoreChange& core : change.cores) {
    out.points.push_back((core.point - out.origin).cast<float>());
    out.normals.push_back(core.normal.cast<float>());
    out.scalars["change"].push_back(static_cast<float>(core.distance));
    out.scalars["detection_limit"].push_back(static_cast<float>(core.detection_limit));
    out.scalars["sigma_change"].push_back(static_cast<float>(core.sigma));
    out.labels["significant"].push_back(core.significant ? 1 : 0);
    const Color c = change_color(core, range);
    out.colors.push_back({c.red, c.green, c.blue});
  }
  return out;
}

Image draw_change_histogram(const CloudChange& change) {
  constexpr int kBars = 41;
  const double range = 1.5 * change_range(change), width = 2.0 * range / kBars;
  Plot plot;
  const std::string unit = change.metric ? "m" : "units";
  plot.title = "Change, later less earlier: median detection limit at 95 % " +
               format_number(change.median_limit, 4) + " " + unit;
  plot.x.title = "change, " + unit + " (+ is gain; the outer bars hold all beyond)";
  plot.y.title = "share of core points, %";
  plot.x.low = -range;
  plot.x.high = range;
  plot.y.low = 0.0;
  for (const bool significant : {false, true}) {
    PlotSeries bars;
    bars.kind = PlotSeries::Kind::kBoxes;
    bars.name = significant ? "significant" : "within the detection limit";
    bars.color = significant ? plot_color(1) : Color{150, 150, 150, 1.0};
    bars.low.assign(kBars, 0.0);
    bars.high.assign(kBars, 0.0);
    for (int i = 0; i < kBars; ++i) {
      bars.x.push_back(-range + (i + (significant ? 0.52 : 0.06)) * width);
      bars.right.push_back(bars.x.back() + 0.42 * width);
    }
    for (const CoreChange& core : change.cores) {
      if (!std::isfinite(core.detection_limit) || core.significant != significant) continue;
      const double bar = std::clamp(std::floor((core.distance + range) / width), 0.0, kBars - 1.0);
      bars.high[static_cast<std::size_t>(bar)] += 100.0 / static_cast<double>(change.measured);
    }
    plot.series.push_back(bars);
  }
  return draw_plots({"", {plot}}, kStyle);
}

Image draw_change_map(const CloudChange& change) {
  constexpr double kMostPixels = 1000.0;
  Eigen::Vector2d low = Eigen::Vector2d::Constant(std::numeric_limits<double>::infinity());
  Eigen::Vector2d high = -low;
  for (const CoreChange& core : change.cores) {
    low = low.cwiseMin(core.point.head<2>());
    high = high.cwiseMax(core.point.head<2>());
  }
  const double cell =
      std::max({change.used.core_spacing, (high - low).maxCoeff() / kMostPixels, 1e-9});
  const int across = static_cast<int>((high.y() - low.y()) / cell) + 1;
  const int along = static_cast<int>((high.x() - low.x()) / cell) + 1;
  PlotSeries cells;
  cells.kind = PlotSeries::Kind::kImage;
  cells.x = {low.x(), low.x() + along * cell};
  cells.y = {low.y(), low.y() + across * cell};
  cells.image = make_picture(along, across, 255);
  const double range = change_range(change);
  for (const bool significant : {false, true}) {
    for (const CoreChange& core : change.cores) {
      if (!std::isfinite(core.detection_limit) || core.significant != significant) continue;
      const int x = static_cast<int>((core.point.x() - low.x()) / cell);
      const int y = static_cast<int>((core.point.y() - low.y()) / cell);
      const Color c = change_color(core, range);
      std::uint8_t* out = &cells.image.data[3 * (static_cast<std::size_t>(across - 1 - y) *
                                                     static_cast<std::size_t>(along) +
                                                 static_cast<std::size_t>(x))];
      out[0] = c.red;
      out[1] = c.green;
      out[2] = c.blue;
    }
  }
  Plot plot;
  const std::string unit = change.metric ? "m" : "units";
  plot.title = "Significant change (grey: within the detection limit)";
  plot.x.title = "east (x), " + unit;
  plot.y.title = "north (y), " + unit;
  plot.x.low = cells.x[0];
  plot.x.high = cells.x[1];
  plot.y.low = cells.y[0];
  plot.y.high = cells.y[1];
  plot.equal_scale = true;
  plot.series = {std::move(cells)};
  return map_with_bar(std::move(plot), along, across, range, {"gain (+) and", "loss (-), " + unit});
}

}  // namespace camber
