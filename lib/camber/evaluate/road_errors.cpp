#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <numeric>
#include <string>
#include <utility>
#include <vector>

#include "camber/core/median.h"
#include "camber/core/threads.h"
#include "camber/evaluate/detail/compare_steps.h"

namespace camber::detail {

using Eigen::Vector3d;

namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kDegree = M_PI / 180.0;

/// Errors of a point; NaN if it is not split. Bins: -1 for none.
struct SplitError {
  double height = kNaN, u = 0.0, v = 0.0;
  std::int8_t by_distance = -1, by_grade = -1;
};

constexpr double kDistances[] = {0.0, 10.0, 20.0, 30.0, 50.0, kInfinity};  // m
constexpr double kGrades[] = {0.0, 2.0, 5.0, 10.0, 15.0, 60.0};            // deg
constexpr int kBins = 5;                                                   // of either

/// Which of the bins a value lies in; -1: none.
std::int8_t bin_of(const double (&bounds)[kBins + 1], double value) {
  for (int k = 0; k < kBins; ++k) {
    if (value >= bounds[k] && value < bounds[k + 1]) return static_cast<std::int8_t>(k);
  }
  return -1;
}

/// Sums over the points of a row.
struct Sums {
  std::size_t count = 0;
  double height = 0.0, squares = 0.0, along = 0.0, across = 0.0;

  void add(const Sums& other) {
    count += other.count;
    height += other.height;
    squares += other.squares;
    along += other.along;
    across += other.across;
  }
};

/// All points, then the bins by distance, then those by grade.
using RowSums = std::array<Sums, 1 + 2 * kBins>;

RoadErrors make_row(const Sums& sums, std::vector<double> heights, const std::string& by,
                    double from, double to) {
  RoadErrors row;
  row.by = by;
  row.from = from;
  row.to = to;
  row.count = sums.count;
  if (sums.count == 0) return row;
  const double n = static_cast<double>(sums.count);
  row.height_mean = sums.height / n;
  row.height_median = upper_median(std::move(heights));
  row.height_rms = std::sqrt(sums.squares / n);
  row.along_rms = std::sqrt(sums.along / n);
  row.across_rms = std::sqrt(sums.across / n);
  return row;
}

HeightErrorMap make_map(const std::vector<SplitError>& errors, double cell) {
  HeightErrorMap map;
  map.cell = cell;
  double high_u = -kInfinity, high_v = -kInfinity;
  map.u = map.v = kInfinity;
  for (const SplitError& e : errors) {
    if (std::isnan(e.height)) continue;
    map.u = std::min(map.u, e.u);
    map.v = std::min(map.v, e.v);
    high_u = std::max(high_u, e.u);
    high_v = std::max(high_v, e.v);
  }
  if (!(high_u >= map.u)) {  // of no point at all
    map.u = map.v = 0.0;
    return map;
  }
  // A map that a picture can hold.
  while (std::max(high_u - map.u, high_v - map.v) / map.cell > 4000.0) map.cell *= 2.0;
  map.u = map.cell * std::floor(map.u / map.cell);
  map.v = map.cell * std::floor(map.v / map.cell);
  map.width = static_cast<int>((high_u - map.u) / map.cell) + 1;
  map.height = static_cast<int>((high_v - map.v) / map.cell) + 1;
  const std::size_t cells =
      static_cast<std::size_t>(map.width) * static_cast<std::size_t>(map.height);
  map.error.assign(cells, std::numeric_limits<float>::quiet_NaN());
  map.count.assign(cells, 0);
  // The heights of each cell one behind the other.
  const auto cell_of = [&](const SplitError& e) {
    const std::size_t x = static_cast<std::size_t>((e.u - map.u) / map.cell),
                      y = static_cast<std::size_t>((e.v - map.v) / map.cell);
    return y * static_cast<std::size_t>(map.width) + x;
  };
  std::vector<std::size_t> ends(cells + 1, 0);
  for (const SplitError& e : errors) {
    if (!std::isnan(e.height)) ++ends[cell_of(e) + 1];
  }
  std::partial_sum(ends.begin(), ends.end(), ends.begin());
  std::vector<double> heights(ends.back());
  for (const SplitError& e : errors) {
    if (!std::isnan(e.height)) heights[ends[cell_of(e)]++] = e.height;
  }
  for (std::size_t at = 0, begin = 0; at < cells; begin = ends[at++]) {
    if (ends[at] == begin) continue;
    const auto place = [&](std::size_t i) {
      return heights.begin() + static_cast<std::ptrdiff_t>(i);
    };
    const auto middle = place((begin + ends[at]) / 2);
    std::nth_element(place(begin), middle, place(ends[at]));
    map.error[at] = static_cast<float>(*middle);
    map.count[at] = static_cast<int>(ends[at] - begin);
  }
  return map;
}

}  // namespace

void add_road_errors(const Shape& truth, const RoadCloud& estimated, const CompareOptions& options,
                     CloudComparison* out) {
  const Vector3d up = options.up.normalized();
  const Vector3d along = (options.along - up * up.dot(options.along)).normalized(),
                 left = up.cross(along);
  const ShapeDistances& distances = out->accuracy.distances;
  std::vector<SplitError> errors(estimated.size());
  constexpr std::size_t kBlock = 65536, kAhead = 16;
  std::vector<RowSums> sums((errors.size() + kBlock - 1) / kBlock);
  const auto split = [&](std::size_t i, RowSums& rows) {
    if (out->accuracy.counted[i] == 0 || distances.nearest[i] < 0) return;
    if (!(distances.distance[i] <= options.road_limit)) return;
    const Vector3d place = true_point(estimated, i);
    Contact c = contact(truth, distances.nearest[i], place);
    if (c.normal.dot(up) < 0.0) c.normal = -c.normal;
    const bool level = c.normal.isZero();  // not known
    if (level) c.normal = up;
    const double upright = c.normal.dot(up);
    if (!(upright > 0.5)) return;  // walls have no height
    const Vector3d offset = place - c.place;
    SplitError& e = errors[i];
    e.height = c.normal.dot(offset) / upright;
    e.u = along.dot(place);
    e.v = left.dot(place);
    if (options.viewpoint) {
      e.by_distance = bin_of(kDistances, (place - *options.viewpoint).norm());
    }
    if (!level) {
      e.by_grade = bin_of(kGrades, std::abs(std::atan2(c.normal.dot(along), upright)) / kDegree);
    }
    const double a = along.dot(offset), b = left.dot(offset);
    const Sums own{1, e.height, e.height * e.height, a * a, b * b};
    rows[0].add(own);
    if (e.by_distance >= 0) rows[static_cast<std::size_t>(1 + e.by_distance)].add(own);
    if (e.by_grade >= 0) rows[static_cast<std::size_t>(1 + kBins + e.by_grade)].add(own);
  };
  parallel_for(sums.size(), options.num_threads, [&](std::size_t block) {
    const std::size_t end = std::min(errors.size(), (block + 1) * kBlock);
    for (std::size_t i = block * kBlock; i < end; ++i) {
      if (i + kAhead < end) fetch_contact(truth, distances.nearest[i + kAhead]);
      split(i, sums[block]);
    }
  });
  RowSums total;
  for (const RowSums& block : sums) {
    for (std::size_t row = 0; row < total.size(); ++row) total[row].add(block[row]);
  }
  const auto heights = [&](auto&& belongs) {
    std::vector<double> values;
    for (const SplitError& e : errors) {
      if (!std::isnan(e.height) && belongs(e)) values.push_back(std::abs(e.height));
    }
    return values;
  };
  // The rows and the map side by side.
  std::vector<std::function<RoadErrors()>> rows = {[&] {
    return make_row(total[0], heights([](const SplitError&) { return true; }), "all", 0.0,
                    kInfinity);
  }};
  for (int k = 0; options.viewpoint && k < kBins; ++k) {
    rows.push_back([&, k] {
      return make_row(total[static_cast<std::size_t>(1 + k)],
                      heights([&](const SplitError& e) { return e.by_distance == k; }), "distance",
                      kDistances[k], kDistances[k + 1]);
    });
  }
  for (int k = 0; k < kBins; ++k) {
    rows.push_back([&, k] {
      return make_row(total[static_cast<std::size_t>(1 + kBins + k)],
                      heights([&](const SplitError& e) { return e.by_grade == k; }), "grade",
                      kGrades[k], kGrades[k + 1]);
    });
  }
  out->road.resize(rows.size());
  parallel_for(rows.size() + 1, options.num_threads, [&](std::size_t row) {
    if (row == 0) {
      out->map = make_map(errors, options.map_cell);
      out->map.of_axes = along == Vector3d::UnitX() && up == Vector3d::UnitZ();
    } else {
      out->road[row - 1] = rows[row - 1]();
    }
  });
}

}  // namespace camber::detail
