#include "camber/road/segment_ground.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <stdexcept>

#include "camber/core/target_clones.h"
#include "camber/core/threads.h"
#include "camber/road/detail/cell_lanes.h"
#include "camber/road/detail/ground_cells.h"
#include "camber/road/detail/ground_surface.h"
#include "camber/road/detail/height_grid.h"

namespace camber {
namespace {

using detail::as_size;
using detail::CellPoint;
using detail::F8;
using detail::gradient;
using detail::GroundCells;
using detail::GroundRules;
using detail::GroundSurface;
using detail::HeightGrid;
using detail::I8;
using detail::kLanes;
using detail::kNoHeight;
using detail::PlanBounds;
using detail::PlanFrame;
using detail::PointDensity;

constexpr int kSide = 4;  // parts of a cell along an axis, where points may rise from the ground
constexpr float kDeepest = 0.45f, kHighest = 0.12f;  // m, of shifts
constexpr float kRise = 0.4f;                        // m, over the tolerance
constexpr double kMostCells = 268435456.0;           // of a grid by a plan

/// Heights of the surface in the middles of a cell and of the eight about it, m, rows by v.
struct CellSurface {
  float z[3][3];
};

/// @param cell  not at the grid's border, where there are no points
CellSurface surface_of(const HeightGrid& ground, int cell) {
  const int x = cell % ground.width, y = cell / ground.width;
  CellSurface out;
  for (int dy = 0; dy < 3; ++dy) std::memcpy(out.z[dy], ground.row(y + dy - 1) + x - 1, 12);
  return out;
}

/// What the labels of a cell's points hang on.
struct CellHeights {
  std::vector<float> above;        // m, over the surface
  std::vector<std::int32_t> part;  // of the cell, kSide * row + column
  float shift[4];                  // m, of the surface, by quarters of the cell
  bool rises;                      // whether any point stands up to kRise above what is ground

  /// There is room for whole lanes.
  void make_room(std::size_t count) {
    if (above.size() >= count + kLanes) return;
    above.resize(count + kLanes);
    part.resize(count + kLanes);
  }
};

/// Measures a cell's points over the surface, which is bilinear between the middles of cells, and
/// what that misses there (kerbs, ditches, crests): of each quarter of the cell the mean height of
/// the lowest points, if they are enough; else 0.
/// @param out  with room for `count`
CAMBER_TARGET_CLONES("avx2")
void measure_cell(const CellPoint* points, std::size_t count, const CellSurface& surface,
                  float tolerance, CellHeights& out) {
  constexpr std::size_t kQuarters = 4;
  const F8 none = {}, infinite = none + kNoHeight, one = none + 1.0f;
  float* const above = out.above.data();
  std::int32_t* const parts = out.part.data();
  I8 rises = {};
  F8 lowest[kQuarters] = {infinite, infinite, infinite, infinite}, all[kQuarters] = {};
  for (std::size_t i = 0; i < count; i += kLanes) {
    detail::PointLanes p;
    detail::load_lanes(points + i, count - i, p);
    const F8 u = p.u, v = p.v;
    F8 left = 0.5f - u, right = u - 0.5f, front = 0.5f - v, back = v - 0.5f;
    left = left > none ? left : none;
    right = right > none ? right : none;
    front = front > none ? front : none;
    back = back > none ? back : none;
    const F8 middle = 1.0f - left - right;
    const auto& z = surface.z;
    const F8 ground =
        front * (left * z[0][0] + middle * z[0][1] + right * z[0][2]) +
        (1.0f - front - back) * (left * z[1][0] + middle * z[1][1] + right * z[1][2]) +
        back * (left * z[2][0] + middle * z[2][1] + right * z[2][2]);
    const F8 height = p.there ? p.h - ground : infinite;
    I8 column = __builtin_convertvector(u * static_cast<float>(kSide), I8);
    I8 row = __builtin_convertvector(v * static_cast<float>(kSide), I8);
    column = column < kSide ? column : kSide - 1;
    row = row < kSide ? row : kSide - 1;
    const I8 part = row * kSide + column;
    std::memcpy(above + i, &height, sizeof height);
    std::memcpy(parts + i, &part, sizeof part);
    const I8 used = (height > -kDeepest) & (height < tolerance);
    rises |= (height >= tolerance) & (height < tolerance + kRise);
    const I8 quarter = (row & 2) | (column >> 1);
    for (std::size_t q = 0; q < kQuarters; ++q) {
      const I8 here = used & (quarter == static_cast<std::int32_t>(q));
      const F8 found = here ? height : infinite;
      lowest[q] = found < lowest[q] ? found : lowest[q];
      all[q] += here ? one : none;
    }
  }
  out.rises = false;
  for (std::size_t i = 0; i < kLanes; ++i) out.rises |= rises[i] != 0;
  float bound[kQuarters];
  for (std::size_t q = 0; q < kQuarters; ++q) {
    bound[q] = std::min(detail::least_of_lanes(lowest[q]) + 1.5f * tolerance, tolerance);
  }
  F8 sum[kQuarters] = {}, low[kQuarters] = {};
  for (std::size_t i = 0; i < count; i += kLanes) {
    F8 height;
    I8 part;
    std::memcpy(&height, above + i, sizeof height);
    std::memcpy(&part, parts + i, sizeof part);
    const I8 used = (height > -kDeepest) & (height < tolerance);
    const I8 quarter = ((part >> 2) & 2) | ((part >> 1) & 1);
    for (std::size_t q = 0; q < kQuarters; ++q) {
      const I8 here = used & (quarter == static_cast<std::int32_t>(q)) & (height <= bound[q]);
      sum[q] += here ? height : none;
      low[q] += here ? one : none;
    }
  }
  for (std::size_t q = 0; q < kQuarters; ++q) {
    const float number = detail::sum_of_lanes(low[q]);
    const bool enough = number >= 3.0f && number >= 0.4f * detail::sum_of_lanes(all[q]);
    const float mean = detail::sum_of_lanes(sum[q]) / std::max(number, 1.0f);
    out.shift[q] = enough ? std::min(std::max(mean, -kDeepest), kHighest) : 0.0f;
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

  /// Labels the points of an occupied cell. @return how many are ground
  std::size_t label(int cell, std::vector<int>& labels) {
    const std::size_t at = as_size(cell);
    float tolerance = tolerance_;
    if (from_air_) {
      const int x = cell % cells_.width, y = cell / cells_.width;
      tolerance += 0.7f * gradient(ground_, x, y, 1).norm();
    }
    const CellPoint* const points = cells_.points.data() + cells_.start[at];
    const std::size_t count = as_size(cells_.start[at + 1] - cells_.start[at]);
    heights_.make_room(count);
    measure_cell(points, count, surface_of(ground_, cell), tolerance, heights_);
    const float* const above = heights_.above.data();
    const std::int32_t* const part = heights_.part.data();
    int rising[kSide * kSide] = {};
    const bool feet = heights_.rises && !from_air_;
    for (std::size_t i = 0; feet && i < count; ++i) {
      rising[part[i]] += above[i] >= tolerance && above[i] < tolerance + kRise ? 1 : 0;
    }
    std::size_t found = 0;
    for (std::size_t i = 0; i < count; ++i) {
      const float r = above[i] - heights_.shift[(part[i] >> 2 & 2) | (part[i] >> 1 & 1)];
      if (!(r > -tolerance && r < tolerance)) continue;
      // The foot of what rises here.
      if (feet && r > narrow_ && rising[part[i]] >= 2) continue;
      labels[as_size(points[i].index)] = 1;
      ++found;
    }
    return found;
  }

 private:
  const GroundCells& cells_;
  const HeightGrid& ground_;
  bool from_air_;
  float tolerance_, narrow_;
  CellHeights heights_;  // of one cell
};

/// The cloud in cells, and whether it was scanned from the air.
struct SortedCloud {
  GroundCells cells;
  PlanBounds bounds;
  double cell = 1.0;  // m
  GroundRules rules;
};

constexpr double kFinest = 1.0 / 64.0;  // m, multiples of which cells are by themselves

GroundRules rules_of(bool from_air) {
  GroundRules rules;
  if (!from_air) return rules;
  rules.from_air = true;
  rules.largest_object = 30.0f;
  rules.slope = 0.35f;
  rules.step = 0.5f;
  rules.step_per_metre = 0.2f;
  rules.refine = 0.5f;
  return rules;
}

GroundRules rules_of(const GroundPlan& plan) {
  GroundRules rules = rules_of(plan.from_air);
  rules.largest_object = static_cast<float>(plan.largest_object);
  rules.slope = static_cast<float>(plan.slope);
  return rules;
}

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
  const bool sparse = density.median < 4.0;
  const bool even =
      density.median > 0.5 * density.mean && std::min(bounds.width(), bounds.height()) > 60.0;
  out.rules = rules_of(density.share > 0.5 && (sparse || even) && finite > 500);
  if (out.rules.from_air && options.cell == 0.0) {
    const double before = cell;
    const PlanBounds old = bounds;
    cell = std::clamp(std::ceil(1.5 / std::sqrt(density.median) / kFinest) * kFinest, 1.0, 4.0);
    bounds = detail::choose_bounds(cloud, frame, all, most, &cell);
    if (cell != before || !(bounds == old)) {
      out.cells = GroundCells();  // not both at once
      out.cells = detail::sort_by_cell(cloud, frame, bounds, cell, options.num_threads);
    }
  }
  if (options.largest_object > 0.0) {
    out.rules.largest_object = static_cast<float>(options.largest_object);
  }
  if (options.slope > 0.0) out.rules.slope = static_cast<float>(options.slope);
  return out;
}

/// The ground under the sensor, where nothing, or only the vehicle that carries it, is seen.
/// @param height  m, of the sensor above it
void add_ground_under_sensor(const RoadCloud& cloud, const PlanFrame& frame, double height,
                             GroundCells* cells, detail::LowestHeights* lowest) {
  const Eigen::Vector3d sensor = -cloud.origin;
  const double u = (frame.e1.dot(sensor) - cells->corner[0]) / cells->cell,
               v = (frame.e2.dot(sensor) - cells->corner[1]) / cells->cell;
  const float h = static_cast<float>(frame.up.dot(sensor) - height);
  const double margin = 1.0;  // as all cells that are looked at have it
  if (!(u >= margin && v >= margin && u < cells->width - margin && v < cells->height - margin)) {
    return;
  }
  const int c = static_cast<int>(v) * cells->width + static_cast<int>(u);
  if (std::abs(lowest->heights.z[as_size(c)] - h) < 0.5f) return;
  lowest->heights.z[as_size(c)] = h;
  lowest->support[as_size(c)] = 1000;
  const auto place = std::lower_bound(cells->occupied.begin(), cells->occupied.end(), c);
  if (place == cells->occupied.end() || *place != c) cells->occupied.insert(place, c);
}

void require(bool good, const char* name, double value, const char* expected) {
  if (good) return;
  throw std::invalid_argument(std::string(name) + " = " + std::to_string(value) + ", expected " +
                              expected);
}

}  // namespace

void GroundPlan::validate() const {
  const double parts = cell / kFinest;
  require(std::isfinite(cell) && cell > 0.0 && cell <= 1e6 && parts == std::round(parts),
          "plan.cell", cell, "a multiple of 1/64 m up to 1e6 m");
  require(std::isfinite(largest_object) && largest_object > 0.0 && largest_object <= 256.0 * cell,
          "plan.largest_object", largest_object, "more than 0 m and at most 256 cells");
  require(std::isfinite(slope) && slope > 0.0, "plan.slope", slope, "more than 0");
  require(std::isfinite(tolerance) && tolerance > 0.0, "plan.tolerance", tolerance,
          "more than 0 m");
  require(std::isfinite(foot_tolerance) && foot_tolerance > 0.0, "plan.foot_tolerance",
          foot_tolerance, "more than 0 m");
}

double GroundPlan::reach() const { return detail::ground_reach(rules_of(*this), cell) * cell; }

double GroundPlan::alignment() const {
  return detail::trend_sizes(rules_of(*this), cell).spacing() * cell;
}

void GroundOptions::validate() const {
  require(up.allFinite() && up.norm() > 0.0, "up", up.norm(), "a direction");
  require(!std::isinf(sensor_height), "sensor_height", sensor_height, "a number of metres");
  require(std::isfinite(cell) && cell >= 0.0, "cell", cell, "0 m or more");
  require(std::isfinite(largest_object) && largest_object >= 0.0, "largest_object", largest_object,
          "0 m or more");
  require(std::isfinite(slope) && slope >= 0.0, "slope", slope, "0 or more");
  require(std::isfinite(tolerance) && tolerance >= 0.0, "tolerance", tolerance, "0 m or more");
  if (plan) plan->validate();
}

GroundSegmentation segment_ground(const RoadCloud& cloud, const GroundOptions& options) {
  options.validate();
  GroundSegmentation out;
  out.labels.assign(cloud.size(), 0);

  const PlanFrame frame(options.up);
  std::size_t finite = 0;
  const PlanBounds all = detail::find_bounds(cloud, frame, options.num_threads, &finite);
  // A part of a cloud may hold one point, as its whole may in a place apart.
  const std::size_t least = options.plan ? 1 : 3;
  if (finite < least) {
    out.status = Status::kFailed;
    out.reason = "found " + std::to_string(finite) + " finite points, expected at least " +
                 std::to_string(least);
    return out;
  }

  SortedCloud sorted;
  if (options.plan) {
    const double size = options.plan->cell;
    if (!((all.width() / size + 1.0) * (all.height() / size + 1.0) < kMostCells)) {
      out.status = Status::kFailed;
      out.reason = "the points lie too far apart for cells of " + std::to_string(size) + " m";
      return out;
    }
    sorted = {detail::sort_by_cell(cloud, frame, all, size, options.num_threads), all, size,
              rules_of(*options.plan)};
  } else {
    sorted = sort_cloud(cloud, frame, all, finite, options);
  }
  GroundCells& cells = sorted.cells;
  const GroundRules& rules = sorted.rules;
  out.from_air = rules.from_air;
  out.cell = sorted.cell;
  out.largest_object = rules.largest_object;
  out.slope = rules.slope;
  detail::extend(cells, frame, cloud.origin, detail::grid_margin(rules, sorted.cell),
                 detail::trend_sizes(rules, sorted.cell).spacing());

  detail::LowestHeights lowest = detail::find_lowest(cells, options.num_threads);
  if (std::isfinite(options.sensor_height)) {
    add_ground_under_sensor(cloud, frame, options.sensor_height, &cells, &lowest);
  }
  detail::drop_low(cells, rules, lowest);
  const GroundSurface ground =
      detail::fit_ground_surface(cells, rules, lowest.heights, options.num_threads);

  float tolerance = rules.from_air ? 0.4f : std::clamp(0.08f + 2.5f * ground.noise, 0.08f, 0.4f);
  float narrow = std::min(tolerance, 0.02f + 1.5f * ground.noise);
  if (options.tolerance > 0.0) tolerance = narrow = static_cast<float>(options.tolerance);
  if (options.plan) {
    tolerance = static_cast<float>(options.plan->tolerance);
    narrow = static_cast<float>(options.plan->foot_tolerance);
  }
  out.foot_tolerance = narrow;
  out.tolerance = tolerance;
  const std::vector<std::size_t> runs = detail::cell_runs(cells);
  std::vector<std::size_t> found(runs.size() - 1, 0), with_ground(runs.size() - 1, 0);
  parallel_for(found.size(), options.num_threads, [&](std::size_t run) {
    Labeller labeller(cells, ground.heights, rules.from_air, tolerance, narrow);
    for (std::size_t k = runs[run]; k < runs[run + 1]; ++k) {
      const std::size_t number = labeller.label(cells.occupied[k], out.labels);
      found[run] += number;
      with_ground[run] += number > 0 ? 1 : 0;
    }
  });
  std::size_t area = 0;
  for (std::size_t run = 0; run < found.size(); ++run) {
    out.ground += found[run];
    area += with_ground[run];
  }
  out.ground_area_share = static_cast<double>(area) / static_cast<double>(cells.occupied.size());
  if (out.ground == 0) {
    out.status = Status::kFailed;
    out.reason = "no point lies on the ground's surface";
    return out;
  }
  out.status = Status::kOk;
  return out;
}

}  // namespace camber
