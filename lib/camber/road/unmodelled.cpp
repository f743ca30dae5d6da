#include "camber/road/unmodelled.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <map>
#include <unordered_map>
#include <utility>

namespace camber {
namespace {

constexpr std::size_t kMostPoints = 262144;
constexpr double kCell = 3.0;    // m
constexpr double kFewest = 5.0;  // points of a cell whose scatter is measured
// Share of a point's standard deviation that its neighbours may have in common. Found on the
// forest road, docs/notes/cloud-toolkit.md.
constexpr double kInCommon = 0.2;

struct Cell {
  double count = 0.0, sum = 0.0, squares = 0.0;
};
using Place = std::pair<std::int64_t, std::int64_t>;
struct PlaceHash {
  std::size_t operator()(const Place& place) const {
    return static_cast<std::size_t>(static_cast<std::uint64_t>(place.first) *
                                        0x9E3779B97F4A7C15ull ^
                                    static_cast<std::uint64_t>(place.second));
  }
};
using Cells = std::unordered_map<Place, Cell, PlaceHash>;

/// Mean square of a smooth field under the residuals: that of the cells' means, less the scatter's
/// share of it, and two standard deviations more, for few points hide a bend. Not negative.
double bend_variance(const Cells& unsorted) {
  // In order of place, so that the sums do not depend on how a table holds them.
  const std::map<Place, Cell> cells(unsorted.begin(), unsorted.end());
  double sum = 0.0, weight = 0.0, spread = 0.0;
  for (const auto& [place, cell] : cells) {
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
  std::unordered_map<int, std::pair<PlanePatch*, Cells>> patches;
  for (PlanePatch& patch : surface->patches) patches[patch.id].first = &patch;
  const std::size_t stride = surface->metric ? 1 + cloud.size() / kMostPoints : cloud.size() + 1;
  for (std::size_t i = 0; surface->metric && i < cloud.size(); i += stride) {
    if (labels[i] < 0) continue;
    auto& [patch, cells] = patches.at(labels[i]);
    const UncertainPlane& plane = patch->plane;
    const Eigen::Vector3d x = cloud.origin + cloud.points[i].cast<double>();
    const Eigen::Vector3d offset = x - plane.centroid;
    const auto cell = [&](const Eigen::Vector3d& axis) {
      return static_cast<std::int64_t>(std::floor(offset.dot(axis) / kCell));
    };
    const double residual = plane.plane.signed_distance(x);
    Cell& here = cells[{cell(plane.axis1), cell(plane.axis2)}];
    here.count += 1.0;
    here.sum += residual;
    here.squares += residual * residual;
  }
  for (auto& [id, entry] : patches) {
    const double in_common =
        std::isfinite(entry.first->noise) ? kInCommon * entry.first->noise : 0.0;
    entry.first->unmodelled_sigma = std::sqrt(bend_variance(entry.second) + in_common * in_common);
  }
}

}  // namespace camber
