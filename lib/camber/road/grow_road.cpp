#include "camber/road/grow_road.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <queue>
#include <stdexcept>

#include "camber/core/random.h"

namespace camber {
namespace {

struct Cell {
  bool known = false;
  bool road = false;
  Eigen::Vector3d ray = Eigen::Vector3d::Zero();
  double rho = 0.0;
  double sigma = 0.0;
  Eigen::Vector3d plane = Eigen::Vector3d::Zero();  // rho = plane . ray
};

double median_of(std::vector<double>& values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
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
  GrownRoad out;
  out.ground.assign(grid.inverse_depth.size(), 0);
  const auto fail = [&](const std::string& reason) {
    out.status = Status::kFailed;
    out.reason = reason;
    return out;
  };

  // Cells: the median inverse depth of what is known in them.
  const int columns = grid.columns / options.cell_columns, rows = grid.rows / options.cell_rows;
  std::vector<Cell> cells(static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows));
  const auto cell_at = [&](int r, int c) -> Cell& {
    return cells[static_cast<std::size_t>(r) * static_cast<std::size_t>(columns) +
                 static_cast<std::size_t>(c)];
  };
  for (int r = 0; r < rows; ++r) {
    for (int c = 0; c < columns; ++c) {
      std::vector<double> values, sigmas;
      for (int y = 0; y < options.cell_rows; ++y) {
        for (int x = 0; x < options.cell_columns; ++x) {
          const std::size_t i = static_cast<std::size_t>(r * options.cell_rows + y) *
                                    static_cast<std::size_t>(grid.columns) +
                                static_cast<std::size_t>(c * options.cell_columns + x);
          if (!std::isfinite(grid.inverse_depth[i])) continue;
          values.push_back(grid.inverse_depth[i]);
          sigmas.push_back(grid.sigma[i]);
        }
      }
      Cell& cell = cell_at(r, c);
      const double u = (c * options.cell_columns + 0.5 * (options.cell_columns - 1)) * grid.step;
      const double v = (r * options.cell_rows + 0.5 * (options.cell_rows - 1)) * grid.step;
      cell.ray = camera.ray({u, v});
      if (2 * values.size() < static_cast<std::size_t>(options.cell_columns * options.cell_rows)) {
        continue;
      }
      cell.rho = median_of(values);
      cell.sigma = median_of(sigmas);
      cell.known = cell.rho > 0;
    }
  }

  // Ego patch: m = a e_down + b e_right with rho = m . ray contains the direction of travel.
  const Eigen::Vector3d forward = travel.normalized();
  const Eigen::Vector3d down = (Eigen::Vector3d(0, 1, 0) - forward.y() * forward).normalized();
  const Eigen::Vector3d right = down.cross(forward);
  std::vector<const Cell*> near;
  for (int r = rows / 2; r < rows; ++r) {
    for (int c = columns / 8; c < columns - columns / 8; ++c) {
      const Cell& cell = cell_at(r, c);
      if (cell.known && down.dot(cell.ray) > 0.08) near.push_back(&cell);
    }
  }
  if (near.size() < 20) {
    return fail(std::to_string(near.size()) +
                " cells are triangulated below the horizon, at "
                "least 20 are needed");
  }
  const auto inlier = [&](const Cell& cell, const Eigen::Vector3d& m) {
    const double off = std::abs(cell.rho / m.dot(cell.ray) - 1.0);
    return off < 0.03 + 1.5 * cell.sigma / cell.rho;  // of the camera's height
  };
  double best_score = 0.0;
  Eigen::Vector3d best = Eigen::Vector3d::Zero();
  const CounterRandom random(0, 7);
  for (std::uint64_t trial = 0; trial < 400; ++trial) {
    const Cell& p = *near[random.below(2 * trial, near.size())];
    const Cell& q = *near[random.below(2 * trial + 1, near.size())];
    Eigen::Matrix2d a;
    a << down.dot(p.ray), right.dot(p.ray), down.dot(q.ray), right.dot(q.ray);
    if (std::abs(a.determinant()) < 1e-3) continue;
    const Eigen::Vector2d ab = a.inverse() * Eigen::Vector2d(p.rho, q.rho);
    if (!(ab.x() > 0) || std::abs(ab.y()) > 0.25 * ab.x()) continue;
    const Eigen::Vector3d m = ab.x() * down + ab.y() * right;
    double score = 0.0;
    for (const Cell* cell : near) {
      // Near the middle of the lane counts more than the sides.
      if (inlier(*cell, m)) score += 1.0 / (0.3 + std::abs(cell->ray.x() / cell->ray.y()) / 6.0);
    }
    if (score > best_score) {
      best_score = score;
      best = m;
    }
  }
  if (!(best_score > 0))
    return fail("no plane along the direction of travel lies below the camera");
  // Refit, slope free.
  for (int iteration = 0; iteration < 5; ++iteration) {
    Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
    Eigen::Vector3d right_side = Eigen::Vector3d::Zero();
    int used = 0;
    for (const Cell* cell : near) {
      if (!inlier(*cell, best)) continue;
      const double w = 1.0 / (cell->sigma * cell->sigma + std::pow(0.01 * cell->rho, 2));
      normal += w * cell->ray * cell->ray.transpose();
      right_side += w * cell->rho * cell->ray;
      ++used;
    }
    if (used < 12) {
      return fail("the plane below the camera is carried by " + std::to_string(used) +
                  " cells, at least 12 are needed");
    }
    // Weakly held along the direction of travel: the slope within 3 degrees.
    const double mean_weight = normal.trace() / 50.0;
    normal += mean_weight * forward * forward.transpose();
    best = normal.ldlt().solve(right_side);
  }
  const double height = 1.0 / best.norm();
  out.ego = {-best * height, height};
  const double metres = options.camera_height / height;

  // Growing, nearest first.
  using Entry = std::pair<double, int>;  // inverse depth, cell
  std::priority_queue<Entry> queue;
  std::vector<std::uint8_t> tried(cells.size(), 0);
  std::vector<int> on_ego_plane;
  double nearest = std::numeric_limits<double>::infinity();
  for (int r = rows / 2; r < rows; ++r) {
    for (int c = columns / 8; c < columns - columns / 8; ++c) {
      const Cell& cell = cell_at(r, c);
      if (!cell.known || down.dot(cell.ray) < 0.08 || !inlier(cell, best)) continue;
      on_ego_plane.push_back(r * columns + c);
      nearest = std::min(nearest, metres / cell.rho);
    }
  }
  constexpr double kNear = 9.0, kNoFarther = 20.0;  // m
  const double seed_reach = std::max(kNear, std::min(1.25 * nearest, kNoFarther));
  for (const int i : on_ego_plane) {
    Cell& cell = cells[static_cast<std::size_t>(i)];
    if (metres / cell.rho > seed_reach) continue;
    cell.road = true;
    cell.plane = best;
    queue.push({cell.rho, i});
  }
  if (queue.empty()) return fail("no cell near the camera lies on the ego plane");
  const auto local_plane = [&](int r0, int c0, const Eigen::Vector3d& prior) {
    const Cell& centre = cell_at(r0, c0);
    Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
    Eigen::Vector3d right_side = Eigen::Vector3d::Zero();
    for (int r = std::max(0, r0 - 3); r <= std::min(rows - 1, r0 + 4); ++r) {
      for (int c = std::max(0, c0 - 5); c <= std::min(columns - 1, c0 + 5); ++c) {
        const Cell& cell = cell_at(r, c);
        if (!cell.road) continue;
        const double s = cell.sigma + 0.01 * cell.rho;
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
  };
  while (!queue.empty()) {
    const int at = queue.top().second;
    queue.pop();
    const int r = at / columns, c = at % columns;
    Cell& cell = cells[static_cast<std::size_t>(at)];
    cell.plane = local_plane(r, c, cell.plane);
    const double tilt = angle_between(-cell.plane, out.ego.normal);
    if (!(tilt < options.max_tilt)) continue;
    for (const auto& [dr, dc] :
         {std::pair{-1, 0}, std::pair{1, 0}, std::pair{0, -1}, std::pair{0, 1}}) {
      const int nr = r + dr, nc = c + dc;
      if (nr < 0 || nc < 0 || nr >= rows || nc >= columns) continue;
      Cell& next = cell_at(nr, nc);
      if (!next.known || next.road) continue;
      const double expected = cell.plane.dot(next.ray);
      if (!(expected > 0)) continue;
      const double per_rho = metres / (next.rho * cell.plane.norm());
      const double off = (next.rho - expected) * per_rho;  // m above the local plane
      const double sigma = next.sigma * per_rho;
      if (sigma > options.max_sigma) continue;
      const double apart =
          std::min(5.0, (next.ray / expected - cell.ray / cell.rho).norm() * metres);
      if (std::abs(off) > options.step_height + 1.0 * sigma + 0.015 * apart) continue;
      next.road = true;
      next.plane = cell.plane;
      queue.push({next.rho, nr * columns + nc});
    }
  }

  for (int r = 0; r < rows; ++r) {
    for (int c = 0; c < columns; ++c) {
      const Cell& cell = cell_at(r, c);
      if (!cell.road) continue;
      for (int y = 0; y < options.cell_rows; ++y) {
        for (int x = 0; x < options.cell_columns; ++x) {
          const int gx = c * options.cell_columns + x, gy = r * options.cell_rows + y;
          const std::size_t i =
              static_cast<std::size_t>(gy) * static_cast<std::size_t>(grid.columns) +
              static_cast<std::size_t>(gx);
          if (!std::isfinite(grid.inverse_depth[i]) || !(grid.inverse_depth[i] > 0)) continue;
          const Eigen::Vector3d ray = camera.ray(
              {static_cast<double>(gx * grid.step), static_cast<double>(gy * grid.step)});
          const double per_rho = metres / (grid.inverse_depth[i] * cell.plane.norm());
          const double off = (grid.inverse_depth[i] - cell.plane.dot(ray)) * per_rho;
          if (std::abs(off) < 1.5 * options.step_height + 3.0 * grid.sigma[i] * per_rho) {
            out.ground[i] = 1;
          }
        }
      }
    }
  }
  out.status = Status::kOk;
  return out;
}

}  // namespace camber
