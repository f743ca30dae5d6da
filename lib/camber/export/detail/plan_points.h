#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <unordered_map>
#include <vector>

namespace camber::detail {

/// Square cells of the plan, numbered in the order in which they are first met. Only those that
/// were met take room.
class PlanCells {
 public:
  struct Cell {
    std::int64_t x = 0, y = 0;
    bool operator==(const Cell& other) const { return x == other.x && y == other.y; }
  };

  /// @param size  m, edge of a cell, > 0
  PlanCells(const Eigen::Vector2d& origin, double size);
  Cell cell_of(const Eigen::Vector2d& place) const;
  std::size_t add(const Cell& cell);         ///< its number
  std::size_t find(const Cell& cell) const;  ///< its number, or kNone
  std::size_t size() const { return numbers_.size(); }

  static constexpr std::size_t kNone = ~std::size_t{0};

 private:
  struct Hash {
    std::size_t operator()(const Cell& cell) const;
  };

  Eigen::Vector2d origin_;
  double edge_;
  std::unordered_map<Cell, std::size_t, Hash> numbers_;
};

/// Points in cells of the plan that hold a few each. Stray points far away cost nothing.
class PlanPoints {
 public:
  PlanPoints() : cells_(Eigen::Vector2d::Zero(), 1.0) {}
  /// @param points  m, finite
  explicit PlanPoints(const std::vector<Eigen::Vector3d>& points);

  /// m, mean over the area that has points; 0: there are none.
  double spacing() const { return spacing_; }

  /// Calls visit(k) for the points k within `radius` of a place.
  template <typename Visit>
  void near(const Eigen::Vector2d& place, double radius, Visit&& visit) const {
    if (points_.empty()) return;
    const PlanCells::Cell low = cells_.cell_of(place.array() - radius),
                          high = cells_.cell_of(place.array() + radius);
    for (PlanCells::Cell cell = low; cell.y <= high.y; ++cell.y) {
      for (cell.x = low.x; cell.x <= high.x; ++cell.x) {
        const std::size_t c = cells_.find(cell);
        if (c == PlanCells::kNone) continue;
        for (std::size_t k = starts_[c]; k < starts_[c + 1]; ++k) {
          if ((points_[k].head<2>() - place).squaredNorm() <= radius * radius) visit(k);
        }
      }
    }
  }
  const Eigen::Vector3d& point(std::size_t k) const { return points_[k]; }
  /// Its place among the points that were given.
  std::size_t index(std::size_t k) const { return indices_[k]; }

 private:
  PlanCells cells_;
  double spacing_ = 0.0;
  std::vector<std::size_t> starts_;  // of each cell's points, and the end
  std::vector<Eigen::Vector3d> points_;
  std::vector<std::size_t> indices_;
};

}  // namespace camber::detail
