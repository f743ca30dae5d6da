#include "camber/road/segment_ground.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "camber/core/target_clones.h"
#include "camber/core/threads.h"
#include "camber/road/detail/ground_cells.h"
#include "camber/road/detail/ground_surface.h"
#include "camber/road/detail/height_grid.h"

namespace camber {
namespace {

using detail::as_size;
using detail::CellPoint;
using detail::gradient;
using detail::GroundCells;
using detail::GroundRules;
using detail::GroundSurface;
using detail::HeightGrid;
using detail::kNoHeight;
using detail::PlanBounds;
using detail::PlanFrame;
using detail::PointDensity;

/// Heights of points above a surface that is bilinear between the middles of cells.
CAMBER_TARGET_CLONES("avx2")
void measure_above(const CellPoint* points, std::size_t count, const HeightGrid& ground,
                   float* above) {
  const float* const z = ground.z.data();
  const int width = ground.width, last_x = ground.width - 1, last_y = ground.height - 1;
  const float most_x = static_cast<float>(last_x), most_y = static_cast<float>(last_y);
  for (std::size_t i = 0; i < count; ++i) {
    float x = points[i].u - 0.5f, y = points[i].v - 0.5f;
    x = x > 0.0f ? x : 0.0f;
    y = y > 0.0f ? y : 0.0f;
    x = x < most_x ? x : most_x;
    y = y < most_y ? y : most_y;
    const int x0 = static_cast<int>(x), y0 = static_cast<int>(y);
    const int right = x0 < last_x ? 1 : 0, up = y0 < last_y ? width : 0;
    const float fx = x - static_cast<float>(x0), fy = y - static_cast<float>(y0);
    const float* const near = z + y0 * width + x0;
    const float* const far = near + up;
    const float surface = (1.0f - fy) * ((1.0f - fx) * near[0] + fx * near[right]) +
                          fy * ((1.0f - fx) * far[0] + fx * far[right]);
    above[i] = points[i].h - surface;
  }
}

/// Labels the points by their height above the surface.
class Labeller {
 public:
  Labeller(const GroundCells& cells, const HeightGrid& ground, bool from_air, float tolerance,
           float narrow)
      : cells_(cells),
        ground_(ground),
        from_air_(from_air),
        tolerance_(tolerance),
        narrow_(narrow) {}

  /// Labels the points of the occupied cells [first, last). @return how many are ground
  std::size_t label(std::size_t first, std::size_t last, std::vector<int>& labels) {
    if (first == last) return 0;
    first_point_ = cells_.start[as_size(cells_.occupied[first])];
    const int end = cells_.start[as_size(cells_.occupied[last - 1]) + 1];
    above_.resize(as_size(end - first_point_));
    near_.resize(above_.size() + 1);
    measure_above(cells_.points.data() + first_point_, above_.size(), ground_, above_.data());
    std::size_t found = 0;
    for (std::size_t k = first; k < last; ++k) found += label_cell(cells_.occupied[k], labels);
    return found;
  }

 private:
  std::size_t label_cell(int cell, std::vector<int>& labels) {
    const std::size_t at = as_size(cell);
    const int x = cell % cells_.width, y = cell / cells_.width;
    float tolerance = tolerance_;
    if (from_air_) tolerance += 0.7f * gradient(ground_, x, y, 1).norm();
    // Points near the surface, and where points rise from it, by sixteenths of the cell.
    const float left = static_cast<float>(x), front = static_cast<float>(y);
    const float lowest = -kDeepest - tolerance, highest = tolerance + 0.4f;
    std::size_t count = 0;
    int rising[16] = {};
    for (int i = cells_.start[at]; i < cells_.start[at + 1]; ++i) {
      const float above = above_[as_size(i - first_point_)];
      if (!(above > lowest && above < highest)) continue;
      const CellPoint& p = cells_.points[as_size(i)];
      const int column = std::clamp(static_cast<int>(4.0f * (p.u - left)), 0, 3);
      const int row = std::clamp(static_cast<int>(4.0f * (p.v - front)), 0, 3);
      near_[count] = {above, p.index, 4 * row + column, row / 2 * 2 + column / 2};
      rising[4 * row + column] += above >= tolerance ? 1 : 0;
      count += above < tolerance + kHighest ? 1 : 0;
    }
    if (count == 0) return 0;
    float shift[4] = {};
    find_shifts(count, tolerance, shift);
    std::size_t found = 0;
    for (std::size_t i = 0; i < count; ++i) {
      const Near& p = near_[i];
      const float r = p.above - shift[p.quarter];
      if (!(r > -tolerance && r < tolerance)) continue;
      // The foot of what rises here.
      if (!from_air_ && r > narrow_ && rising[p.sixteenth] >= 2) continue;
      labels[as_size(p.index)] = 1;
      ++found;
    }
    return found;
  }

  static constexpr float kDeepest = 0.45f, kHighest = 0.12f;  // m, of shifts

  struct Near {
    float above;
    int index, sixteenth, quarter;
  };

  /// What the surface misses between the middles of cells (kerbs, ditches, crests): the mean height
  /// of the lowest points of each quarter, if they are enough.
  void find_shifts(std::size_t count, float tolerance, float* shift) const {
    float lowest[4] = {kNoHeight, kNoHeight, kNoHeight, kNoHeight}, sum[4] = {}, low[4] = {},
          all[4] = {};
    for (std::size_t i = 0; i < count; ++i) {
      const Near& p = near_[i];
      const bool used = (p.above > -kDeepest) & (p.above < tolerance);
      const float above = used ? p.above : kNoHeight;
      lowest[p.quarter] = above < lowest[p.quarter] ? above : lowest[p.quarter];
      all[p.quarter] += used ? 1.0f : 0.0f;
    }
    for (std::size_t i = 0; i < count; ++i) {
      const Near& p = near_[i];
      const bool used = (p.above > -kDeepest) & (p.above < tolerance) &
                        (p.above <= lowest[p.quarter] + 1.5f * tolerance);
      sum[p.quarter] += used ? p.above : 0.0f;
      low[p.quarter] += used ? 1.0f : 0.0f;
    }
    for (std::size_t q = 0; q < 4; ++q) {
      if (low[q] >= 3.0f && low[q] >= 0.4f * all[q]) {
        shift[q] = std::clamp(sum[q] / low[q], -kDeepest, kHighest);
      }
    }
  }

  const GroundCells& cells_;
  const HeightGrid& ground_;
  bool from_air_;
  float tolerance_, narrow_;
  int first_point_ = 0;
  std::vector<float> above_;  // of each point of some cells
  std::vector<Near> near_;    // of one cell
};

/// The cloud in cells, and whether it was scanned from the air.
struct SortedCloud {
  GroundCells cells;
  PlanBounds bounds;
  double cell = 1.0;  // m
  GroundRules rules;
};

/// @param all     bounds of the `finite` usable points
SortedCloud sort_cloud(const RoadCloud& cloud, const PlanFrame& frame, const PlanBounds& all,
                       std::size_t finite, const GroundOptions& options) {
  const double most = std::max(131072.0, 4.0 * static_cast<double>(finite));
  SortedCloud out;
  double& cell = out.cell;
  if (options.cell > 0.0) cell = options.cell;
  PlanBounds& bounds = out.bounds;
  bounds = detail::choose_bounds(cloud, frame, all, most, &cell);
  out.cells = detail::sort_by_cell(cloud, frame, bounds, cell, options.num_threads);
  // Scans from the air see about as many points everywhere, others many near by and none behind
  // things.
  const PointDensity density = detail::measure_density(out.cells);
  GroundRules& rules = out.rules;
  const bool sparse = density.median < 4.0;
  const bool even =
      density.median > 0.5 * density.mean && std::min(bounds.width(), bounds.height()) > 60.0;
  rules.from_air = density.share > 0.5 && (sparse || even) && finite > 500;
  if (rules.from_air) {
    rules.largest_object = 30.0f;
    rules.slope = 0.35f;
    rules.step = 0.5f;
    rules.step_per_metre = 0.2f;
    rules.refine = 0.5f;
    if (options.cell == 0.0) {
      const double before = cell;
      const PlanBounds old = bounds;
      cell = std::clamp(1.5 / std::sqrt(density.median), 1.0, 4.0);
      bounds = detail::choose_bounds(cloud, frame, all, most, &cell);
      if (cell != before || !(bounds == old)) {
        out.cells = GroundCells();  // not both at once
        out.cells = detail::sort_by_cell(cloud, frame, bounds, cell, options.num_threads);
      }
    }
  }
  return out;
}

/// The ground under the sensor, where nothing, or only the vehicle that carries it, is seen.
/// @param height  m, of the sensor above it
void add_ground_under_sensor(const RoadCloud& cloud, const PlanFrame& frame,
                             const PlanBounds& bounds, double cell, double height,
                             GroundCells* cells, detail::LowestHeights* lowest) {
  const Eigen::Vector3d sensor = -cloud.origin;
  const double u = (frame.e1.dot(sensor) - bounds.low[0]) / cell,
               v = (frame.e2.dot(sensor) - bounds.low[1]) / cell;
  const float h = static_cast<float>(frame.up.dot(sensor) - height);
  if (!(u >= 0.0 && v >= 0.0 && u < cells->width && v < cells->height)) return;
  const int c = static_cast<int>(v) * cells->width + static_cast<int>(u);
  if (std::abs(lowest->heights.z[as_size(c)] - h) < 0.5f) return;
  lowest->heights.z[as_size(c)] = h;
  lowest->support[as_size(c)] = 1000;
  const auto place = std::lower_bound(cells->occupied.begin(), cells->occupied.end(), c);
  if (place == cells->occupied.end() || *place != c) cells->occupied.insert(place, c);
}

}  // namespace

void GroundOptions::validate() const {
  const auto require = [](bool good, const char* name, double value, const char* expected) {
    if (good) return;
    throw std::invalid_argument(std::string(name) + " = " + std::to_string(value) + ", expected " +
                                expected);
  };
  require(up.allFinite() && up.norm() > 0.0, "up", up.norm(), "a direction");
  require(!std::isinf(sensor_height), "sensor_height", sensor_height, "a number of metres");
  require(std::isfinite(cell) && cell >= 0.0, "cell", cell, "0 m or more");
  require(std::isfinite(largest_object) && largest_object >= 0.0, "largest_object", largest_object,
          "0 m or more");
  require(std::isfinite(slope) && slope >= 0.0, "slope", slope, "0 or more");
  require(std::isfinite(tolerance) && tolerance >= 0.0, "tolerance", tolerance, "0 m or more");
}

GroundSegmentation segment_ground(const RoadCloud& cloud, const GroundOptions& options) {
  options.validate();
  GroundSegmentation out;
  out.labels.assign(cloud.size(), 0);

  const PlanFrame frame(options.up);
  std::size_t finite = 0;
  const PlanBounds all = detail::find_bounds(cloud, frame, options.num_threads, &finite);
  if (finite < 3) {
    out.status = Status::kFailed;
    out.reason = "found " + std::to_string(finite) + " finite points, expected at least 3";
    return out;
  }

  SortedCloud sorted = sort_cloud(cloud, frame, all, finite, options);
  GroundCells& cells = sorted.cells;
  GroundRules& rules = sorted.rules;
  if (options.largest_object > 0.0) {
    rules.largest_object = static_cast<float>(options.largest_object);
  }
  if (options.slope > 0.0) rules.slope = static_cast<float>(options.slope);
  out.from_air = rules.from_air;
  out.cell = sorted.cell;
  out.largest_object = rules.largest_object;
  out.slope = rules.slope;

  detail::LowestHeights lowest = detail::find_lowest(cells, options.num_threads);
  if (std::isfinite(options.sensor_height)) {
    add_ground_under_sensor(cloud, frame, sorted.bounds, sorted.cell, options.sensor_height, &cells,
                            &lowest);
  }
  detail::drop_low(cells, rules, lowest);
  const GroundSurface ground =
      detail::fit_ground_surface(cells, rules, lowest.heights, options.num_threads);

  float tolerance = rules.from_air ? 0.4f : std::clamp(0.08f + 2.5f * ground.noise, 0.08f, 0.4f);
  float narrow = std::min(tolerance, 0.02f + 1.5f * ground.noise);
  if (options.tolerance > 0.0) tolerance = narrow = static_cast<float>(options.tolerance);
  out.tolerance = tolerance;
  const std::vector<std::size_t> runs = detail::cell_runs(cells);
  std::vector<std::size_t> found(runs.size() - 1, 0);
  parallel_for(found.size(), options.num_threads, [&](std::size_t run) {
    Labeller labeller(cells, ground.heights, rules.from_air, tolerance, narrow);
    found[run] = labeller.label(runs[run], runs[run + 1], out.labels);
  });
  for (const std::size_t number : found) out.ground += number;
  if (out.ground == 0) {
    out.status = Status::kFailed;
    out.reason = "no point lies on the ground's surface";
    return out;
  }
  out.status = Status::kOk;
  return out;
}

}  // namespace camber
