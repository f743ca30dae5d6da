#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstddef>
#include <memory>
#include <vector>

#include "camber/cloud/road_cloud.h"
#include "camber/road/detail/height_grid.h"

/// A cloud's points in an up-aligned frame, sorted by the cells of a grid over the plan.
namespace camber::detail {

/// An up-aligned frame: plan coordinates u, v and the height, m, relative to the cloud's origin.
struct PlanFrame {
  Eigen::Vector3d e1, e2, up;
  Eigen::Matrix3f axes;

  /// @param direction  up, of any length
  explicit PlanFrame(const Eigen::Vector3d& direction);
  Eigen::Vector3f operator()(const Eigen::Vector3f& p) const { return axes * p; }
};

inline constexpr float kFarthest = 1e9f;  ///< m, sum of coordinates that a grid can hold

/// Whether a point's coordinates are finite and of a size that a grid can hold.
inline bool usable(const Eigen::Vector3f& q) {
  return std::abs(q.x()) + std::abs(q.y()) + std::abs(q.z()) < kFarthest;
}

/// Of the plan coordinates, m.
struct PlanBounds {
  float low[2] = {kNoHeight, kNoHeight}, high[2] = {-kNoHeight, -kNoHeight};
  double width() const { return static_cast<double>(high[0]) - low[0]; }
  double height() const { return static_cast<double>(high[1]) - low[1]; }
  bool operator==(const PlanBounds& other) const {
    return low[0] == other.low[0] && low[1] == other.low[1] && high[0] == other.high[0] &&
           high[1] == other.high[1];
  }
};

struct CellPoint {
  float u, v;  // in cells from its cell's corner
  float h;     // m, along up
  int index;   // into the cloud
};

/// Points whose memory is not cleared before they are written: of large clouds that takes as long
/// as all else that is done with a point.
class CellPoints {
 public:
  void resize(std::size_t size) {
    points_.reset(new CellPoint[size]);
    size_ = size;
  }
  std::size_t size() const { return size_; }
  CellPoint* data() { return points_.get(); }
  const CellPoint* data() const { return points_.get(); }
  CellPoint& operator[](std::size_t i) { return points_[i]; }
  const CellPoint& operator[](std::size_t i) const { return points_[i]; }

 private:
  std::unique_ptr<CellPoint[]> points_;
  std::size_t size_ = 0;
};

/// The points in an up-aligned frame, sorted by cell.
struct GroundCells {
  float cell = 1.0f;              // m
  double corner[2] = {0.0, 0.0};  // m, of the first cell, plan frame
  int width = 0, height = 0;
  std::vector<int> start;  // of each cell in `points`; one more than cells
  CellPoints points;
  std::vector<int> occupied;  // cells with points (or a given height), ascending

  std::size_t count() const { return as_size(width) * as_size(height); }
};

/// Bounds of the usable points, and their number.
PlanBounds find_bounds(const RoadCloud& cloud, const PlanFrame& frame, int num_threads,
                       std::size_t* usable);

/// Bounds of the points with few of them left out, so that a grid of squares of a given size
/// has at most `most` of them; where that is not enough, the size grows.
/// @param all   bounds of all points
/// @param cell  m, side of a square
PlanBounds choose_bounds(const RoadCloud& cloud, const PlanFrame& frame, const PlanBounds& all,
                         double most, double* cell);

/// The grid's corner is a whole number of cells from the zero of the cloud's true coordinates, so
/// that grids of parts of a cloud fit each other; a point's place in its cell does not hang on the
/// corner where coordinates and size are multiples of a power of two.
/// The same for any number of threads. @param size  m, side of a cell
GroundCells sort_by_cell(const RoadCloud& cloud, const PlanFrame& frame, const PlanBounds& bounds,
                         double size, int num_threads);

/// Adds empty cells about the grid: at least `margin` on each side, and so many that its corner is
/// a multiple of `multiple` cells from the zero of the true coordinates, and its sides are.
/// @param origin  of the cloud
void extend(GroundCells& cells, const PlanFrame& frame, const Eigen::Vector3d& origin, int margin,
            int multiple);

/// Runs of occupied cells with some thousand points each, to be looked at side by side: where each
/// begins in `occupied`, and the end.
std::vector<std::size_t> cell_runs(const GroundCells& cells);

/// Median and mean over occupied squares of 2 x 2 cells of the points a square metre, and the share
/// of squares that are occupied.
struct PointDensity {
  double median = 0.0, mean = 0.0, share = 0.0;
};

PointDensity measure_density(const GroundCells& cells);

}  // namespace camber::detail
