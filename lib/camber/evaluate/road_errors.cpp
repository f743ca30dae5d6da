#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <utility>

#include "camber/evaluate/detail/compare_steps.h"

namespace camber::detail {

using Eigen::Vector3d;

namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kDegree = M_PI / 180.0;

struct SplitError {
  double height, along, across, distance, grade, u, v;
};

RoadErrors summarise_errors(const std::vector<SplitError>& errors, const std::string& by,
                            double from, double to) {
  RoadErrors row;
  row.by = by;
  row.from = from;
  row.to = to;
  std::vector<double> heights;
  double sum = 0.0, squares = 0.0, along = 0.0, across = 0.0;
  for (const SplitError& e : errors) {
    const double key = by == "distance" ? e.distance : by == "grade" ? e.grade / kDegree : from;
    if (!(key >= from && key < to)) continue;
    heights.push_back(std::abs(e.height));
    sum += e.height;
    squares += e.height * e.height;
    along += e.along * e.along;
    across += e.across * e.across;
  }
  row.count = heights.size();
  if (heights.empty()) return row;
  const double n = static_cast<double>(heights.size());
  row.height_mean = sum / n;
  row.height_median = median_of(std::move(heights));
  row.height_rms = std::sqrt(squares / n);
  row.along_rms = std::sqrt(along / n);
  row.across_rms = std::sqrt(across / n);
  return row;
}

HeightErrorMap make_map(const std::vector<SplitError>& errors, double cell) {
  HeightErrorMap map;
  map.cell = cell;
  if (errors.empty()) return map;
  double high_u = -kInfinity, high_v = -kInfinity;
  map.u = map.v = kInfinity;
  for (const SplitError& e : errors) {
    map.u = std::min(map.u, e.u);
    map.v = std::min(map.v, e.v);
    high_u = std::max(high_u, e.u);
    high_v = std::max(high_v, e.v);
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
  std::vector<std::pair<std::size_t, double>> entries;
  entries.reserve(errors.size());
  for (const SplitError& e : errors) {
    const std::size_t x = static_cast<std::size_t>((e.u - map.u) / map.cell),
                      y = static_cast<std::size_t>((e.v - map.v) / map.cell);
    entries.emplace_back(y * static_cast<std::size_t>(map.width) + x, e.height);
  }
  std::sort(entries.begin(), entries.end());
  for (std::size_t begin = 0, end = 0; begin < entries.size(); begin = end) {
    while (end < entries.size() && entries[end].first == entries[begin].first) ++end;
    map.error[entries[begin].first] = static_cast<float>(entries[(begin + end) / 2].second);
    map.count[entries[begin].first] = static_cast<int>(end - begin);
  }
  return map;
}

}  // namespace

void add_road_errors(const Shape& truth, const std::vector<Vector3d>& estimated,
                     const CompareOptions& options, CloudComparison* out) {
  const Vector3d up = options.up.normalized();
  const Vector3d along = (options.along - up * up.dot(options.along)).normalized(),
                 left = up.cross(along);
  std::vector<SplitError> errors;
  for (std::size_t i = 0; i < estimated.size(); ++i) {
    if (out->accuracy.counted[i] == 0 || out->accuracy.distances.nearest[i] < 0) continue;
    if (!(out->accuracy.distances.distance[i] <= options.road_limit)) continue;
    Contact c = contact(truth, out->accuracy.distances.nearest[i], estimated[i]);
    if (c.normal.dot(up) < 0.0) c.normal = -c.normal;
    const bool level = c.normal.isZero();  // not known
    if (level) c.normal = up;
    const double upright = c.normal.dot(up);
    if (!(upright > 0.5)) continue;  // walls have no height
    const Vector3d offset = estimated[i] - c.place;
    SplitError e;
    e.height = c.normal.dot(offset) / upright;
    e.along = along.dot(offset);
    e.across = left.dot(offset);
    e.distance = options.viewpoint ? (estimated[i] - *options.viewpoint).norm() : kNaN;
    e.grade = level ? kNaN : std::abs(std::atan2(c.normal.dot(along), upright));
    e.u = along.dot(estimated[i]);
    e.v = left.dot(estimated[i]);
    errors.push_back(e);
  }
  out->road.push_back(summarise_errors(errors, "all", 0.0, kInfinity));
  if (options.viewpoint) {
    const double bins[] = {0.0, 10.0, 20.0, 30.0, 50.0, kInfinity};
    for (int k = 0; k < 5; ++k) {
      out->road.push_back(summarise_errors(errors, "distance", bins[k], bins[k + 1]));
    }
  }
  const double grades[] = {0.0, 2.0, 5.0, 10.0, 15.0, 60.0};
  for (int k = 0; k < 5; ++k) {
    out->road.push_back(summarise_errors(errors, "grade", grades[k], grades[k + 1]));
  }
  out->map = make_map(errors, options.map_cell);
}

}  // namespace camber::detail
