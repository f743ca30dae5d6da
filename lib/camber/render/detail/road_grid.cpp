#include "camber/render/detail/road_grid.h"

#include <algorithm>
#include <cmath>
#include <map>

namespace camber {
namespace {

using Line = RoadGrid::Line;

/// The parts of a patch on which one coordinate of the reference camera (0: x, 2: z) has a value.
std::vector<Line> cut(const std::vector<Eigen::Vector3d>& rim, int axis, double value) {
  std::vector<Eigen::Vector3d> hits;
  for (std::size_t i = 0; i < rim.size(); ++i) {
    const Eigen::Vector3d &a = rim[i], &b = rim[(i + 1) % rim.size()];
    if ((a[axis] < value) == (b[axis] < value)) continue;
    hits.emplace_back(a + (value - a[axis]) / (b[axis] - a[axis]) * (b - a));
  }
  const int other = 2 - axis;
  std::sort(hits.begin(), hits.end(), [other](const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
    return a[other] < b[other];
  });
  std::vector<Line> out;
  for (std::size_t i = 0; i + 1 < hits.size(); i += 2) out.emplace_back(hits[i], hits[i + 1]);
  return out;
}

/// The parts of a line that none of the lines before it covers, by one coordinate: patches overlap.
std::vector<Line> uncovered(const Line& line, int axis, const std::vector<Line>& before) {
  std::vector<Line> parts = {line};
  for (const Line& other : before) {
    const double low = other.first[axis], high = other.second[axis];
    std::vector<Line> left;
    for (const Line& part : parts) {
      const double from = part.first[axis], to = part.second[axis];
      if (!(low < to && from < high)) {
        left.push_back(part);
        continue;
      }
      const auto at = [&](double value) {
        return Eigen::Vector3d(part.first +
                               (value - from) / (to - from) * (part.second - part.first));
      };
      if (from < low) left.emplace_back(part.first, at(low));
      if (to > high) left.emplace_back(at(high), part.second);
    }
    parts = std::move(left);
  }
  return parts;
}

}  // namespace

RoadGrid road_grid(const RoadSurface& surface, const SE3& camera_from_reference) {
  constexpr double kFarthest = 200.0, kFineReach = 12.0;
  RoadGrid out;
  std::map<int, Eigen::Vector3d> ends;
  std::map<std::pair<int, int>, std::vector<Line>> drawn;  // by axis and value
  const auto move = [&](const Line& line) {
    return Line(camera_from_reference * line.first, camera_from_reference * line.second);
  };
  for (const PlanePatch& patch : surface.patches) {
    const std::vector<Eigen::Vector3d>& rim = patch.boundary;
    if (rim.size() < 3 || !std::all_of(rim.begin(), rim.end(),
                                       [](const Eigen::Vector3d& p) { return p.allFinite(); })) {
      continue;
    }
    for (const int axis : {0, 2}) {
      const auto by_axis = [axis](const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
        return a[axis] < b[axis];
      };
      const double low = (*std::min_element(rim.begin(), rim.end(), by_axis))[axis];
      const double high = (*std::max_element(rim.begin(), rim.end(), by_axis))[axis];
      const int first = static_cast<int>(std::ceil(std::max(low, -kFarthest)));
      const int last = static_cast<int>(std::floor(std::min(high, kFarthest)));
      for (int at = first; at <= last; ++at) {
        if (axis == 2 && at > kFineReach && at % 5 != 0) continue;
        const bool coarse = axis == 2 && at % 10 == 0 && at > 0;
        std::vector<Line>& before = drawn[{axis, at}];
        for (const Line& line : cut(rim, axis, at)) {
          for (const Line& part : uncovered(line, 2 - axis, before)) {
            (coarse ? out.coarse : out.fine).push_back(move(part));
          }
          before.push_back(line);
          if (!coarse) continue;
          const auto end = ends.emplace(at, line.second).first;
          if (line.second.x() > end->second.x()) end->second = line.second;
        }
      }
    }
  }
  for (const auto& [distance, end] : ends) {
    out.labels.emplace_back(distance, camera_from_reference * end);
  }
  return out;
}

}  // namespace camber
