#include "camber/export/road_raster.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "camber/core/errors.h"
#include "camber/core/threads.h"
#include "camber/export/crg_strip.h"

namespace camber {

using Eigen::Vector2d;
using Eigen::Vector3d;

namespace {

constexpr double kMostCells = 2e7;  // six bands of them take half a gigabyte

/// Cross sections of the strip: where the line is, and how far the strip reaches.
struct Section {
  Vector2d foot, aside;
  double level = 0.0, left = 0.0, right = 0.0;  // m
};

std::vector<Section> sections_of(const HeightSource& ground, const SmoothLine& line, double cell,
                                 const RoadRasterOptions& options) {
  const double apart = 0.5 * cell;
  const SeenWidth width =
      seen_width(ground, line, std::max(cell, 0.25), options.widest, options.num_threads);
  std::vector<Section> sections;
  std::size_t station = 0;
  const auto count = static_cast<std::size_t>(line.length() / apart) + 1;
  for (std::size_t i = 0; i < count; ++i) {
    const double s = static_cast<double>(i) * apart, heading = line.heading(s);
    while (station + 1 < width.stations.size() && width.stations[station + 1] < s) ++station;
    const std::size_t next = std::min(station + 1, width.stations.size() - 1);
    Section section;
    section.foot = line.position(s);
    section.aside = {-std::sin(heading), std::cos(heading)};
    section.level = line.height(s);
    section.left =
        options.left > 0.0 ? options.left : std::max(width.left[station], width.left[next]);
    section.right =
        options.right > 0.0 ? options.right : std::max(width.right[station], width.right[next]);
    sections.push_back(section);
  }
  return sections;
}

/// The raster that holds all sections, without values.
RoadRaster frame_of(const std::vector<Section>& sections, double cell) {
  constexpr double kHuge = std::numeric_limits<double>::infinity();
  Vector2d low(kHuge, kHuge), high(-kHuge, -kHuge);
  for (const Section& section : sections) {
    for (const double v : {section.left, -section.right}) {
      const Vector2d place = section.foot + v * section.aside;
      low = low.cwiseMin(place);
      high = high.cwiseMax(place);
    }
  }
  RoadRaster raster;
  raster.cell = cell;
  const double left = std::floor(low.x() / cell), top = std::ceil(high.y() / cell);
  const double columns = std::ceil(high.x() / cell) - left, rows = top - std::floor(low.y() / cell);
  if (!(columns * rows <= kMostCells)) {
    throw NoAnswerError(
        fmt::format("{} x {} cells of {} m are too many; larger cells (--step) give fewer", columns,
                    rows, cell));
  }
  raster.west = left * cell;
  raster.north = top * cell;
  raster.columns = static_cast<std::size_t>(std::max(columns, 1.0));
  raster.rows = static_cast<std::size_t>(std::max(rows, 1.0));
  return raster;
}

/// For each cell of the strip the level of the line at its nearest section; NaN: outside.
std::vector<double> levels_of(const std::vector<Section>& sections, const RoadRaster& raster) {
  constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
  std::vector<double> levels(raster.columns * raster.rows, kNaN);
  std::vector<double> nearest(levels.size(), std::numeric_limits<double>::infinity());
  const double apart = 0.5 * raster.cell;
  for (const Section& section : sections) {
    const auto right = static_cast<long>(section.right / apart),
               left = static_cast<long>(section.left / apart);
    for (long k = -right; k <= left; ++k) {
      const double v = static_cast<double>(k) * apart;
      const Vector2d place = section.foot + v * section.aside;
      const double x = std::floor((place.x() - raster.west) / raster.cell),
                   y = std::floor((raster.north - place.y()) / raster.cell);
      const auto column =
          static_cast<std::size_t>(std::clamp(x, 0.0, static_cast<double>(raster.columns - 1)));
      const auto row =
          static_cast<std::size_t>(std::clamp(y, 0.0, static_cast<double>(raster.rows - 1)));
      const std::size_t at = row * raster.columns + column;
      if (std::abs(v) >= nearest[at]) continue;
      nearest[at] = std::abs(v);
      levels[at] = section.level;
    }
  }
  return levels;
}

}  // namespace

void RoadRasterOptions::validate() const {
  const auto require = [](bool good, const char* field, double value, const char* bound) {
    if (!good) {
      throw std::invalid_argument(
          fmt::format("RoadRasterOptions::{} is {}, expected {}", field, value, bound));
    }
  };
  require(cell == 0.0 || (cell >= 0.001 && cell <= 100.0), "cell", cell, "0 or 0.001 to 100 m");
  require(left >= 0.0 && left <= 1000.0, "left", left, "0 to 1000 m");
  require(right >= 0.0 && right <= 1000.0, "right", right, "0 to 1000 m");
  require(widest > 0.0 && widest <= 1000.0, "widest", widest, "> 0, at most 1000 m");
}

RoadRaster make_road_raster(const HeightSource& ground, const SmoothLine& line,
                            const ColorSource* colors, const RoadRasterOptions& options) {
  options.validate();
  const double cell = options.cell > 0.0 ? options.cell : grid_step(ground.resolution());
  const std::vector<Section> sections = sections_of(ground, line, cell, options);
  RoadRaster raster = frame_of(sections, cell);
  const std::vector<double> levels = levels_of(sections, raster);
  const std::size_t cells = raster.columns * raster.rows;
  raster.heights.assign(cells, std::numeric_limits<float>::quiet_NaN());
  raster.sigmas = raster.slopes = raster.heights;
  if (colors != nullptr) raster.colors.resize(cells);
  parallel_for(raster.rows, options.num_threads, [&](std::size_t row) {
    for (std::size_t column = 0; column < raster.columns; ++column) {
      const std::size_t at = row * raster.columns + column;
      if (std::isnan(levels[at])) continue;
      const Vector2d place = raster.center(row, column);
      const GroundSample sample = ground.at({place.x(), place.y(), levels[at]});
      if (!std::isfinite(sample.height)) continue;
      raster.heights[at] = static_cast<float>(sample.height);
      raster.sigmas[at] = static_cast<float>(sample.sigma);
      raster.slopes[at] =
          static_cast<float>(std::atan2(sample.normal.head<2>().norm(), sample.normal.z()));
      if (colors != nullptr) raster.colors[at] = colors->at({place.x(), place.y(), sample.height});
    }
  });
  if (std::all_of(raster.heights.begin(), raster.heights.end(),
                  [](float z) { return std::isnan(z); })) {
    throw NoAnswerError("no ground is seen beside the line");
  }
  return raster;
}

}  // namespace camber
