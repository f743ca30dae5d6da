#include "camber/road/grow_road.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <queue>
#include <stdexcept>

#include "camber/core/median.h"
#include "camber/core/random.h"

namespace camber {
namespace {

constexpr double kLeastFall = 0.08;    // of a ray under the direction of travel: ground is near
constexpr double kMostBank = 0.25;     // slope of the ego plane across the direction of travel
constexpr double kCellNoise = 0.01;    // share of an inverse depth, beside its sigma
constexpr int kLeastOnEgoPlane = 12;   // cells
constexpr double kInlierShare = 0.03;  // of the camera's height, off the ego plane
constexpr double kInlierSigmas = 1.5;  // off the ego plane, beside the share
// Of the ego plane: what stands on the driven path, camera heights.
constexpr double kPathHalfWidth = 0.7, kPathLength = 4.0, kLeastAbove = 0.15, kMostAbove = 0.95;
constexpr double kGrowSigmas = 1.0;  // off the neighbour's plane, beside the step height
constexpr double kGrowBend = 0.015;  // m off the neighbour's plane for a metre between the cells
constexpr double kMostApart = 5.0;   // m between cells for which the ground may bend
// Off the cell's plane, a point of the ground: step heights and standard deviations.
constexpr double kLabelSteps = 1.5, kLabelSigmas = 3.0;

struct Cell {
  bool known = false;
  bool road = false;
  Eigen::Vector3d ray = Eigen::Vector3d::Zero();
  double rho = 0.0;
  double sigma = 0.0;
  Eigen::Vector3d plane = Eigen::Vector3d::Zero();  // rho = plane . ray
};

/// Ground grown over cells of an inverse depth grid, from the plane under the camera outwards.
class RoadGrower {
 public:
  RoadGrower(const PinholeCamera& camera, const GridInverseDepth& grid,
             const Eigen::Vector3d& travel, const GrowRoadOptions& options)
      : camera_(camera),
        grid_(grid),
        options_(options),
        columns_(grid.columns / options.cell_columns),
        rows_(grid.rows / options.cell_rows),
        forward_(travel.normalized()),
        down_((Eigen::Vector3d(0, 1, 0) - forward_.y() * forward_).normalized()),
        right_(down_.cross(forward_)) {}

  GrownRoad run();

 private:
  using Entry = std::pair<double, int>;  // inverse depth, cell

  void make_cells();
  std::vector<const Cell*> cells_below() const;
  Eigen::Vector3d search_ego_plane(const std::vector<const Cell*>& near,
                                   double obstacle_weight) const;
  int refit_ego_plane(const std::vector<const Cell*>& near, Eigen::Vector3d* plane) const;
  void seed(const Eigen::Vector3d& plane);
  Eigen::Vector3d local_plane(int r0, int c0, const Eigen::Vector3d& prior) const;
  void grow(const Eigen::Vector3d& ego_normal);
  void label(std::vector<std::uint8_t>* ground) const;

  Cell& cell_at(int r, int c) {
    return cells_[static_cast<std::size_t>(r) * static_cast<std::size_t>(columns_) +
                  static_cast<std::size_t>(c)];
  }
  const Cell& cell_at(int r, int c) const {
    return cells_[static_cast<std::size_t>(r) * static_cast<std::size_t>(columns_) +
                  static_cast<std::size_t>(c)];
  }
  static bool inlier(const Cell& cell, const Eigen::Vector3d& m) {
    const double off = std::abs(cell.rho / m.dot(cell.ray) - 1.0);
    return off < kInlierShare + kInlierSigmas * cell.sigma / cell.rho;
  }

  /// Whether a cell stands on the plane where the camera is about to pass.
  bool is_obstacle(const Cell& cell, const Eigen::Vector3d& m) const {
    const Eigen::Vector3d place = m.norm() / cell.rho * cell.ray;  // camera heights
    const double above = 1.0 - m.dot(place) / m.norm();
    return std::abs(right_.dot(place)) < kPathHalfWidth && forward_.dot(place) < kPathLength &&
           above > kLeastAbove && above < kMostAbove;
  }

  const PinholeCamera& camera_;
  const GridInverseDepth& grid_;
  const GrowRoadOptions& options_;
  int columns_, rows_;
  Eigen::Vector3d forward_, down_, right_;  // of travel, camera frame
  std::vector<Cell> cells_;
  double metres_ = 1.0;               // for a unit of the grid
  std::priority_queue<Entry> queue_;  // ground whose neighbours are still to be looked at
};

/// Cells: the median inverse depth of what is known in them.
void RoadGrower::make_cells() {
  cells_.resize(static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_));
  for (int r = 0; r < rows_; ++r) {
    for (int c = 0; c < columns_; ++c) {
      std::vector<double> values, sigmas;
      for (int y = 0; y < options_.cell_rows; ++y) {
        for (int x = 0; x < options_.cell_columns; ++x) {
          const std::size_t i = static_cast<std::size_t>(r * options_.cell_rows + y) *
                                    static_cast<std::size_t>(grid_.columns) +
                                static_cast<std::size_t>(c * options_.cell_columns + x);
          if (!std::isfinite(grid_.inverse_depth[i])) continue;
          values.push_back(grid_.inverse_depth[i]);
          sigmas.push_back(grid_.sigma[i]);
        }
      }
      Cell& cell = cell_at(r, c);
      const double u = (c * options_.cell_columns + 0.5 * (options_.cell_columns - 1)) * grid_.step;
      const double v = (r * options_.cell_rows + 0.5 * (options_.cell_rows - 1)) * grid_.step;
      cell.ray = camera_.ray({u, v});
      if (2 * values.size() <
          static_cast<std::size_t>(options_.cell_columns * options_.cell_rows)) {
        continue;
      }
      cell.rho = upper_median(&values);
      cell.sigma = upper_median(&sigmas);
      cell.known = cell.rho > 0;
    }
  }
}

/// Cells that may show the ground near the camera.
std::vector<const Cell*> RoadGrower::cells_below() const {
  std::vector<const Cell*> near;
  for (int r = rows_ / 2; r < rows_; ++r) {
    for (int c = columns_ / 8; c < columns_ - columns_ / 8; ++c) {
      const Cell& cell = cell_at(r, c);
      if (cell.known && down_.dot(cell.ray) > kLeastFall) near.push_back(&cell);
    }
  }
  return near;
}

/// The plane below the camera that contains the direction of travel: m = a e_down + b e_right with
/// rho = m . ray. Zero if there is none.
/// @param obstacle_weight  what an obstacle counts against a plane, where a cell on it counts 1.
Eigen::Vector3d RoadGrower::search_ego_plane(const std::vector<const Cell*>& near,
                                             double obstacle_weight) const {
  double best_score = 0.0;
  Eigen::Vector3d best = Eigen::Vector3d::Zero();
  const CounterRandom random(0, 7);
  for (std::uint64_t trial = 0; trial < 400; ++trial) {
    const Cell& p = *near[random.below(2 * trial, near.size())];
    const Cell& q = *near[random.below(2 * trial + 1, near.size())];
    Eigen::Matrix2d a;
    a << down_.dot(p.ray), right_.dot(p.ray), down_.dot(q.ray), right_.dot(q.ray);
    if (std::abs(a.determinant()) < 1e-3) continue;
    const Eigen::Vector2d ab = a.inverse() * Eigen::Vector2d(p.rho, q.rho);
    if (!(ab.x() > 0) || std::abs(ab.y()) > kMostBank * ab.x()) continue;
    const Eigen::Vector3d m = ab.x() * down_ + ab.y() * right_;
    double score = 0.0;
    for (const Cell* cell : near) {
      // Near the middle of the lane counts more than the sides.
      const double weight = 1.0 / (0.3 + std::abs(cell->ray.x() / cell->ray.y()) / 6.0);
      if (inlier(*cell, m)) {
        score += weight;
      } else if (obstacle_weight > 0.0 && is_obstacle(*cell, m)) {
        score -= obstacle_weight * weight;
      }
    }
    if (score > best_score) {
      best_score = score;
      best = m;
    }
  }
  return best;
}

/// Refits the plane, slope free, to the cells on it. @return their number; below kLeastOnEgoPlane
/// there is none.
int RoadGrower::refit_ego_plane(const std::vector<const Cell*>& near,
                                Eigen::Vector3d* plane) const {
  int used = 0;
  for (int iteration = 0; iteration < 5; ++iteration) {
    Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
    Eigen::Vector3d right_side = Eigen::Vector3d::Zero();
    used = 0;
    for (const Cell* cell : near) {
      if (!inlier(*cell, *plane)) continue;
      const double w = 1.0 / (cell->sigma * cell->sigma + std::pow(kCellNoise * cell->rho, 2));
      normal += w * cell->ray * cell->ray.transpose();
      right_side += w * cell->rho * cell->ray;
      ++used;
    }
    if (used < kLeastOnEgoPlane) {
      return used;
    }
    // Weakly held along the direction of travel: the slope within 3 degrees.
    const double mean_weight = normal.trace() / 50.0;
    normal += mean_weight * forward_ * forward_.transpose();
    *plane = normal.ldlt().solve(right_side);
  }
  return used;
}

/// Starts with the cells near the camera that lie on the ego plane.
void RoadGrower::seed(const Eigen::Vector3d& plane) {
  std::vector<int> on_ego_plane;
  double nearest = std::numeric_limits<double>::infinity();
  for (int r = rows_ / 2; r < rows_; ++r) {
    for (int c = columns_ / 8; c < columns_ - columns_ / 8; ++c) {
      const Cell& cell = cell_at(r, c);
      if (!cell.known || down_.dot(cell.ray) < kLeastFall || !inlier(cell, plane)) continue;
      on_ego_plane.push_back(r * columns_ + c);
      nearest = std::min(nearest, metres_ / cell.rho);
    }
  }
  constexpr double kNear = 9.0, kNoFarther = 20.0;  // m
  const double seed_reach = std::max(kNear, std::min(1.25 * nearest, kNoFarther));
  for (const int i : on_ego_plane) {
    Cell& cell = cells_[static_cast<std::size_t>(i)];
    if (metres_ / cell.rho > seed_reach) continue;
    cell.road = true;
    cell.plane = plane;
    queue_.push({cell.rho, i});
  }
}

Eigen::Vector3d RoadGrower::local_plane(int r0, int c0, const Eigen::Vector3d& prior) const {
  const Cell& centre = cell_at(r0, c0);
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
  Eigen::Vector3d right_side = Eigen::Vector3d::Zero();
  for (int r = std::max(0, r0 - 3); r <= std::min(rows_ - 1, r0 + 4); ++r) {
    for (int c = std::max(0, c0 - 5); c <= std::min(columns_ - 1, c0 + 5); ++c) {
      const Cell& cell = cell_at(r, c);
      if (!cell.road) continue;
      const double s = cell.sigma + kCellNoise * cell.rho;
      const double w = 1.0 / (s * s);
      normal += w * cell.ray * cell.ray.transpose();
      right_side += w * cell.rho * cell.ray;
    }
  }
  // The prior holds what a narrow neighbourhood leaves open.
  const double s = 0.05 * centre.rho + centre.sigma;
  Eigen::Matrix3d information = Eigen::Matrix3d::Zero();
  for (const double du : {-0.15, 0.0, 0.15}) {
    for (const double dv : {-0.03, 0.0, 0.03}) {
      const Eigen::Vector3d ray = centre.ray + Eigen::Vector3d(du, dv, 0.0);
      information += 2.0 / (s * s) * ray * ray.transpose();
    }
  }
  normal += information;
  right_side += information * prior;
  return Eigen::Vector3d(normal.ldlt().solve(right_side));
}

/// Grows over neighbours that continue the ground around them, nearest first.
void RoadGrower::grow(const Eigen::Vector3d& ego_normal) {
  while (!queue_.empty()) {
    const int at = queue_.top().second;
    queue_.pop();
    const int r = at / columns_, c = at % columns_;
    Cell& cell = cells_[static_cast<std::size_t>(at)];
    cell.plane = local_plane(r, c, cell.plane);
    const double tilt = angle_between(-cell.plane, ego_normal);
    if (!(tilt < options_.max_tilt)) continue;
    for (const auto& [dr, dc] :
         {std::pair{-1, 0}, std::pair{1, 0}, std::pair{0, -1}, std::pair{0, 1}}) {
      const int nr = r + dr, nc = c + dc;
      if (nr < 0 || nc < 0 || nr >= rows_ || nc >= columns_) continue;
      Cell& next = cell_at(nr, nc);
      if (!next.known || next.road) continue;
      const double expected = cell.plane.dot(next.ray);
      if (!(expected > 0)) continue;
      const double per_rho = metres_ / (next.rho * cell.plane.norm());
      const double off = (next.rho - expected) * per_rho;  // m above the local plane
      const double sigma = next.sigma * per_rho;
      if (sigma > options_.max_sigma) continue;
      const double apart =
          std::min(kMostApart, (next.ray / expected - cell.ray / cell.rho).norm() * metres_);
      if (std::abs(off) > options_.step_height + kGrowSigmas * sigma + kGrowBend * apart) continue;
      next.road = true;
      next.plane = cell.plane;
      queue_.push({next.rho, nr * columns_ + nc});
    }
  }
}

/// Which nodes of the grid lie on their cell's ground.
void RoadGrower::label(std::vector<std::uint8_t>* ground) const {
  for (int r = 0; r < rows_; ++r) {
    for (int c = 0; c < columns_; ++c) {
      const Cell& cell = cell_at(r, c);
      if (!cell.road) continue;
      for (int y = 0; y < options_.cell_rows; ++y) {
        for (int x = 0; x < options_.cell_columns; ++x) {
          const int gx = c * options_.cell_columns + x, gy = r * options_.cell_rows + y;
          const std::size_t i =
              static_cast<std::size_t>(gy) * static_cast<std::size_t>(grid_.columns) +
              static_cast<std::size_t>(gx);
          if (!std::isfinite(grid_.inverse_depth[i]) || !(grid_.inverse_depth[i] > 0)) continue;
          const Eigen::Vector3d ray = camera_.ray(
              {static_cast<double>(gx * grid_.step), static_cast<double>(gy * grid_.step)});
          const double per_rho = metres_ / (grid_.inverse_depth[i] * cell.plane.norm());
          const double off = (grid_.inverse_depth[i] - cell.plane.dot(ray)) * per_rho;
          if (std::abs(off) <
              kLabelSteps * options_.step_height + kLabelSigmas * grid_.sigma[i] * per_rho) {
            (*ground)[i] = 1;
          }
        }
      }
    }
  }
}

GrownRoad RoadGrower::run() {
  GrownRoad out;
  out.ground.assign(grid_.inverse_depth.size(), 0);
  const auto fail = [&](const std::string& reason) {
    out.status = Status::kFailed;
    out.reason = reason;
    return out;
  };
  make_cells();
  const std::vector<const Cell*> near = cells_below();
  if (near.size() < 20) {
    return fail(std::to_string(near.size()) +
                " cells are triangulated below the horizon, at "
                "least 20 are needed");
  }
  Eigen::Vector3d plane;
  int used = 0;
  // Where matches are wrong they may stand on the road itself.
  for (const double obstacle_weight : {1.0, 0.0}) {
    plane = search_ego_plane(near, obstacle_weight);
    used = plane.isZero(0.0) ? 0 : refit_ego_plane(near, &plane);
    if (used >= kLeastOnEgoPlane) break;
  }
  if (plane.isZero(0.0)) {
    return fail("no plane along the direction of travel lies below the camera");
  }
  if (used < kLeastOnEgoPlane) {
    return fail("the plane below the camera is carried by " + std::to_string(used) +
                " cells, at least " + std::to_string(kLeastOnEgoPlane) + " are needed");
  }
  const double height = 1.0 / plane.norm();
  out.ego = {-plane * height, height};
  metres_ = options_.camera_height / height;
  seed(plane);
  if (queue_.empty()) return fail("no cell near the camera lies on the ego plane");
  grow(out.ego.normal);
  label(&out.ground);
  out.status = Status::kOk;
  return out;
}

}  // namespace

void GrowRoadOptions::validate() const {
  const auto require = [](bool good, const char* name, double value, const char* expected) {
    if (!good) {
      throw std::invalid_argument(std::string(name) + " = " + std::to_string(value) +
                                  ", expected " + expected);
    }
  };
  require(camera_height > 0, "camera_height", camera_height, "> 0");
  require(cell_columns >= 2, "cell_columns", cell_columns, ">= 2");
  require(cell_rows >= 2, "cell_rows", cell_rows, ">= 2");
  require(step_height > 0, "step_height", step_height, "> 0");
  require(max_tilt > 0, "max_tilt", max_tilt, "> 0");
  require(max_sigma > 0, "max_sigma", max_sigma, "> 0");
}

GrownRoad grow_road(const PinholeCamera& camera, const GridInverseDepth& grid,
                    const Eigen::Vector3d& travel, const GrowRoadOptions& options) {
  options.validate();
  return RoadGrower(camera, grid, travel, options).run();
}

}  // namespace camber
