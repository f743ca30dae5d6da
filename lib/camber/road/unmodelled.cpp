#include "camber/road/unmodelled.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <map>
#include <unordered_map>
#include <utility>
#include <vector>

namespace camber {
namespace {

constexpr std::size_t kMostPoints = 262144;
constexpr double kCell = 3.0;    // m
constexpr double kFewest = 5.0;  // points of a cell whose scatter is measured
// Share of a point's standard deviation that its neighbours may have in common. Found on the
// forest road, docs/notes/cloud-toolkit.md.
constexpr double kInCommon = 0.23;

struct Cell {
  double count = 0.0, sum = 0.0, squares = 0.0;
};

/// A point's place in a patch, in cells along its axes, and how far it lies off the plane.
struct PlacedResidual {
  std::int64_t u, v;
  double residual;
};

/// The cells with points, in order of their places.
std::vector<Cell> sum_cells(const std::vector<PlacedResidual>& residuals) {
  if (residuals.empty()) return {};
  std::int64_t low_u = residuals[0].u, high_u = low_u, low_v = residuals[0].v, high_v = low_v;
  for (const PlacedResidual& r : residuals) {
    low_u = std::min(low_u, r.u);
    high_u = std::max(high_u, r.u);
    low_v = std::min(low_v, r.v);
    high_v = std::max(high_v, r.v);
  }
  const auto add = [](Cell& cell, double residual) {
    cell.count += 1.0;
    cell.sum += residual;
    cell.squares += residual * residual;
  };
  std::vector<Cell> cells;
  const std::int64_t width = high_v - low_v + 1, height = high_u - low_u + 1;
  constexpr std::int64_t kMost = 1 << 20;
  if (width <= kMost && height <= kMost && width * height <= kMost) {
    cells.resize(static_cast<std::size_t>(width * height));
    for (const PlacedResidual& r : residuals) {
      add(cells[static_cast<std::size_t>((r.u - low_u) * width + r.v - low_v)], r.residual);
    }
    return cells;
  }
  std::map<std::pair<std::int64_t, std::int64_t>, Cell> wide;
  for (const PlacedResidual& r : residuals) add(wide[{r.u, r.v}], r.residual);
  for (const auto& [place, cell] : wide) cells.push_back(cell);
  return cells;
}

/// Mean square of a smooth field under the residuals: that of the cells' means, less the scatter's
/// share of it, and two standard deviations more, for few points hide a bend. Not negative.
double bend_variance(const std::vector<Cell>& cells) {
  double sum = 0.0, weight = 0.0, spread = 0.0;
  for (const Cell& cell : cells) {
    if (cell.count < kFewest) continue;
    const double mean = cell.sum / cell.count;
    const double scatter =
        std::max(cell.squares / cell.count - mean * mean, 0.0) / (cell.count - 1.0);
    sum += cell.count * (mean * mean - scatter);
    // The square of a mean has the variance 2 scatter^2.
    spread += 2.0 * cell.count * cell.count * scatter * scatter;
    weight += cell.count;
  }
  return weight > 0.0 ? (std::max(sum, 0.0) + 2.0 * std::sqrt(spread)) / weight : 0.0;
}

}  // namespace

void measure_unmodelled(const RoadCloud& cloud, const std::vector<int>& labels,
                        RoadSurface* surface) {
  struct Entry {
    PlanePatch* patch = nullptr;
    std::vector<PlacedResidual> residuals;
  };
  std::unordered_map<int, Entry> patches;
  for (PlanePatch& patch : surface->patches) patches[patch.id].patch = &patch;
  const std::size_t stride = surface->metric ? 1 + cloud.size() / kMostPoints : cloud.size() + 1;
  for (std::size_t i = 0; surface->metric && i < cloud.size(); i += stride) {
    if (labels[i] < 0) continue;
    Entry& entry = patches.at(labels[i]);
    const UncertainPlane& plane = entry.patch->plane;
    const Eigen::Vector3d x = cloud.origin + cloud.points[i].cast<double>();
    const Eigen::Vector3d offset = x - plane.centroid;
    const auto cell = [&](const Eigen::Vector3d& axis) {
      return static_cast<std::int64_t>(std::floor(offset.dot(axis) / kCell));
    };
    entry.residuals.push_back(
        {cell(plane.axis1), cell(plane.axis2), plane.plane.signed_distance(x)});
  }
  for (auto& [id, entry] : patches) {
    const double in_common =
        std::isfinite(entry.patch->noise) ? kInCommon * entry.patch->noise : 0.0;
    entry.patch->unmodelled_sigma =
        std::sqrt(bend_variance(sum_cells(entry.residuals)) + in_common * in_common);
  }
}

}  // namespace camber
