#include "camber/road/detail/ground_cells.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace camber::detail {

PlanFrame::PlanFrame(const Eigen::Vector3d& direction) : up(direction.normalized()) {
  const Eigen::Vector3d along =
      std::abs(up.x()) < 0.7 ? Eigen::Vector3d::UnitX() : Eigen::Vector3d::UnitZ();
  e1 = (along - up * up.dot(along)).normalized();
  e2 = up.cross(e1);
  axes.row(0) = e1.cast<float>();
  axes.row(1) = e2.cast<float>();
  axes.row(2) = up.cast<float>();
}

PlanBounds choose_bounds(const RoadCloud& cloud, const PlanFrame& frame, const PlanBounds& all,
                         double most, double* cell) {
  const auto squares = [&](const PlanBounds& b) {
    return (b.width() / *cell + 1.0) * (b.height() / *cell + 1.0);
  };
  if (squares(all) <= most) return all;
  PlanBounds bounds = all;
  std::vector<float> values[2];
  for (std::size_t i = 0; i < cloud.size(); i += std::max<std::size_t>(1, cloud.size() / 100000)) {
    const Eigen::Vector3f q = frame(cloud.points[i]);
    if (!usable(q)) continue;
    values[0].push_back(q.x());
    values[1].push_back(q.y());
  }
  for (int axis = 0; axis < 2 && !values[0].empty(); ++axis) {
    const auto quantile = [&](double share) {
      std::vector<float>& v = values[axis];
      const auto at =
          v.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(v.size() - 1));
      std::nth_element(v.begin(), at, v.end());
      return *at;
    };
    const float low = quantile(0.005), high = quantile(0.995);
    const float margin = 0.5f * (high - low) + 10.0f;
    bounds.low[axis] = std::max(bounds.low[axis], low - margin);
    bounds.high[axis] = std::min(bounds.high[axis], high + margin);
  }
  while (squares(bounds) > most) *cell *= 1.25;
  return bounds;
}

GroundCells sort_by_cell(const RoadCloud& cloud, const PlanFrame& frame, const PlanBounds& bounds,
                         double size) {
  GroundCells cells;
  cells.cell = static_cast<float>(size);
  cells.width = static_cast<int>(bounds.width() / size) + 1;
  cells.height = static_cast<int>(bounds.height() / size) + 1;
  cells.start.assign(cells.count() + 1, 0);
  const float inverse = 1.0f / cells.cell;
  const auto place = [&](const Eigen::Vector3f& p, CellPoint* out) {
    const Eigen::Vector3f q = frame(p);
    if (!(usable(q) && q.x() >= bounds.low[0] && q.x() <= bounds.high[0] &&
          q.y() >= bounds.low[1] && q.y() <= bounds.high[1])) {
      return -1;
    }
    out->u = (q.x() - bounds.low[0]) * inverse;
    out->v = (q.y() - bounds.low[1]) * inverse;
    out->h = q.z();
    return std::min(static_cast<int>(out->v), cells.height - 1) * cells.width +
           std::min(static_cast<int>(out->u), cells.width - 1);
  };
  CellPoint point{};
  for (const Eigen::Vector3f& p : cloud.points) {
    const int c = place(p, &point);
    if (c >= 0) ++cells.start[as_size(c) + 1];
  }
  for (std::size_t c = 0; c < cells.count(); ++c) {
    if (cells.start[c + 1] > 0) cells.occupied.push_back(static_cast<int>(c));
    cells.start[c + 1] += cells.start[c];
  }
  cells.points.resize(as_size(cells.start.back()));
  std::vector<int> next(cells.start.begin(), cells.start.end() - 1);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const int c = place(cloud.points[i], &point);
    if (c < 0) continue;
    point.index = static_cast<int>(i);
    cells.points[as_size(next[as_size(c)]++)] = point;
  }
  return cells;
}

PointDensity measure_density(const GroundCells& cells) {
  const int w = (cells.width + 1) / 2, h = (cells.height + 1) / 2;
  std::vector<int> counts(as_size(w) * as_size(h), 0), occupied;
  for (const int c : cells.occupied) {
    counts[as_size(c / cells.width / 2) * as_size(w) + as_size(c % cells.width / 2)] +=
        cells.start[as_size(c) + 1] - cells.start[as_size(c)];
  }
  for (const int count : counts) {
    if (count > 0) occupied.push_back(count);
  }
  const auto middle = occupied.begin() + static_cast<std::ptrdiff_t>(occupied.size() / 2);
  std::nth_element(occupied.begin(), middle, occupied.end());
  const double area = 4.0 * static_cast<double>(cells.cell) * cells.cell;
  const double squares = static_cast<double>(occupied.size());
  return {*middle / area, static_cast<double>(cells.points.size()) / (squares * area),
          squares / static_cast<double>(counts.size())};
}

}  // namespace camber::detail
