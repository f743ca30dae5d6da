#include <algorithm>
#include <limits>
#include <numeric>

#include "camber/export/detail/plan_points.h"

namespace camber::detail {

using Eigen::Vector2d;
using Eigen::Vector3d;

namespace {

constexpr double kLeastCell = 1e-3;  // m
constexpr double kCellsOfSpacing = 3.0;
constexpr int kLeastRounds = 3, kMostRounds = 64;  // each takes a far stray's share of the cell off
constexpr double kSettled = 0.9;

}  // namespace

std::size_t PlanCells::Hash::operator()(const Cell& cell) const {
  std::uint64_t h = static_cast<std::uint64_t>(cell.x) * 0x9E3779B97F4A7C15ull;
  h = (h ^ (h >> 29) ^ static_cast<std::uint64_t>(cell.y)) * 0xC2B2AE3D27D4EB4Full;
  return static_cast<std::size_t>(h ^ (h >> 32));
}

PlanCells::PlanCells(const Vector2d& origin, double size) : origin_(origin), edge_(size) {}

PlanCells::Cell PlanCells::cell_of(const Vector2d& place) const {
  constexpr double kMost = 4503599627370496.0;  // 2^52
  const auto number = [&](double offset) {
    return static_cast<std::int64_t>(std::clamp(std::floor(offset / edge_), -kMost, kMost));
  };
  return {number(place.x() - origin_.x()), number(place.y() - origin_.y())};
}

std::size_t PlanCells::find(const Cell& cell) const {
  const auto found = numbers_.find(cell);
  return found == numbers_.end() ? kNone : found->second;
}

std::size_t PlanCells::add(const Cell& cell) {
  return numbers_.try_emplace(cell, numbers_.size()).first->second;
}

PlanPoints::PlanPoints(const std::vector<Vector3d>& points) : PlanPoints() {
  if (points.empty()) return;
  Vector2d low = points.front().head<2>(), high = low;
  for (const Vector3d& x : points) {
    low = low.cwiseMin(x.head<2>());
    high = high.cwiseMax(x.head<2>());
  }
  const auto count = static_cast<double>(points.size());
  const Vector2d size = (high - low).cwiseMax(kLeastCell);
  double edge = kCellsOfSpacing * std::sqrt(size.x() * size.y() / count);
  // Occupied area by cells that hold a few points each, then the spacing within it. The first cells
  // are too large where most of the box is empty.
  for (int round = 0; round < kMostRounds; ++round) {
    edge = std::max(edge, kLeastCell);
    PlanCells cells(low, edge);
    for (const Vector3d& x : points) cells.add(cells.cell_of(x.head<2>()));
    spacing_ = edge * std::sqrt(static_cast<double>(cells.size()) / count);
    const double next = kCellsOfSpacing * spacing_;
    const bool settled = next > kSettled * edge;
    edge = next;
    if (settled && round + 1 >= kLeastRounds) break;
  }
  cells_ = PlanCells(low, std::max(edge, kLeastCell));
  std::vector<std::size_t> cell_of;
  cell_of.reserve(points.size());
  for (const Vector3d& x : points) cell_of.push_back(cells_.add(cells_.cell_of(x.head<2>())));
  starts_.assign(cells_.size() + 1, 0);
  for (const std::size_t c : cell_of) ++starts_[c + 1];
  std::partial_sum(starts_.begin(), starts_.end(), starts_.begin());
  points_.resize(points.size());
  indices_.resize(points.size());
  std::vector<std::size_t> next = starts_;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const std::size_t k = next[cell_of[i]]++;
    points_[k] = points[i];
    indices_[k] = i;
  }
}

}  // namespace camber::detail
