#include "camber/export/site_raster.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <tuple>
#include <utility>

#include "camber/core/threads.h"

namespace camber {

using Eigen::Vector2d;
using Eigen::Vector3d;

namespace {

constexpr std::size_t kNearest = 12;  // points of a surface
constexpr std::size_t kFewest = 4;    // of a plane
constexpr float kNone = std::numeric_limits<float>::quiet_NaN();

/// Lambert's law for light from the north-west, 45 degrees high.
float shade_of(double slope_east, double slope_north) {
  const Vector3d light = Vector3d(-std::sqrt(0.5), std::sqrt(0.5), 1.0).normalized();
  const Vector3d normal = Vector3d(-slope_east, -slope_north, 1.0).normalized();
  return static_cast<float>(std::max(0.0, normal.dot(light)));
}

}  // namespace

SiteGrid::SiteGrid(const Vector2d& low, const Vector2d& high, double size) : cell(size) {
  const double left = std::floor(low.x() / cell), bottom = std::floor(low.y() / cell);
  const double right = std::floor(high.x() / cell) + 1.0, top = std::floor(high.y() / cell) + 1.0;
  west = left * cell;
  north = top * cell;
  columns = static_cast<std::size_t>(right - left);
  rows = static_cast<std::size_t>(top - bottom);
}

/// A point near a cell's centre, cells from it (y south), and its squared distance.
struct SiteRowsMaker::Near {
  double x, y, z, square;
};

SiteRowsMaker::SiteRowsMaker(const SiteGrid& grid, std::size_t first, std::size_t rows,
                             const SiteRasterOptions& options)
    : SiteRowsMaker(grid, {first, 0, rows, grid.columns}, options) {}

SiteRowsMaker::SiteRowsMaker(const SiteGrid& grid, const SiteWindow& window,
                             const SiteRasterOptions& options)
    : options_(options), window_(window), cell_(grid.cell), reach_(options.reach / grid.cell) {
  const std::size_t beside = margin(grid.cell, options);
  const auto widen = [&](std::size_t first, std::size_t count, std::size_t all) {
    const std::size_t low = first - std::min(first, beside);
    return std::make_pair(low, std::min(all, first + count + beside) - low);
  };
  std::tie(stored_.row, stored_.rows) = widen(window.row, window.rows, grid.rows);
  std::tie(stored_.column, stored_.columns) = widen(window.column, window.columns, grid.columns);
  // The grid's corners are multiples of the cell.
  west_ = std::round(grid.west / cell_) + static_cast<double>(stored_.column);
  north_ = std::round(grid.north / cell_) - static_cast<double>(stored_.row);
  const std::size_t cells = stored_.rows * stored_.columns;
  if (cells > std::numeric_limits<std::uint32_t>::max()) {
    throw std::invalid_argument("SiteRowsMaker: found 2^32 cells or more, expected fewer");
  }
  surface_.assign(cells, kNone);
  points_.assign(cells, 0);
}

std::size_t SiteRowsMaker::margin(double cell, const SiteRasterOptions& options) {
  return static_cast<std::size_t>(std::ceil(2.0 * options.reach / cell)) + 1;
}

std::size_t SiteRowsMaker::bytes_of_row(const SiteGrid& grid) {
  return grid.columns * (sizeof(std::size_t) + 2 * sizeof(float) + 6 * sizeof(float));
}

std::size_t SiteRowsMaker::bytes_of_point() {
  return 2 * sizeof(GroundPoint) + sizeof(std::uint32_t);
}

void SiteRowsMaker::add(const Vector3d& point, bool ground) {
  // Cells are counted from zero, and places from the cell: alike in every grid.
  const double x = point.x() / cell_, y = point.y() / cell_;
  const double left = std::floor(x), bottom = std::floor(y);
  const double column = left - west_, row = north_ - 1.0 - bottom;
  if (!(row >= 0.0 && row < static_cast<double>(stored_.rows) && column >= 0.0 &&
        column < static_cast<double>(stored_.columns))) {
    return;
  }
  const std::size_t at =
      static_cast<std::size_t>(row) * stored_.columns + static_cast<std::size_t>(column);
  ++points_[at];
  const float height = static_cast<float>(point.z());
  if (!(surface_[at] >= height)) surface_[at] = height;
  if (!ground) return;
  cell_of_.push_back(static_cast<std::uint32_t>(at));
  ground_.push_back({static_cast<float>(x - left), static_cast<float>(y - bottom), point.z()});
}

/// A counting sort.
void SiteRowsMaker::sort_by_cell() {
  start_.assign(stored_.rows * stored_.columns + 1, 0);
  for (const std::uint32_t cell : cell_of_) ++start_[cell + std::size_t{1}];
  for (std::size_t c = 1; c < start_.size(); ++c) start_[c] += start_[c - 1];
  std::vector<GroundPoint> sorted(ground_.size());
  for (std::size_t i = 0; i < ground_.size(); ++i) sorted[start_[cell_of_[i]]++] = ground_[i];
  for (std::size_t c = start_.size() - 1; c > 0; --c) start_[c] = start_[c - 1];
  start_[0] = 0;
  ground_ = std::move(sorted);
  cell_of_ = {};
}

/// The points that count for a cell, nearest first. @return whether it lies within reach of one
bool SiteRowsMaker::find_near(std::size_t row, std::size_t column, std::vector<Near>& near) const {
  constexpr double kAll = 0.7;     // cells
  constexpr double kAcross = 1.5;  // of the nearest one's distance: all around a hole
  const auto most = static_cast<std::size_t>(std::ceil(2.0 * reach_));
  near.clear();
  bool enough = false;
  for (std::size_t ring = 0; ring <= most && !enough; ++ring) {
    const auto low = [&](std::size_t i) { return i - std::min(i, ring); };
    const std::size_t last_row = std::min(stored_.rows - 1, row + ring),
                      last_column = std::min(stored_.columns - 1, column + ring);
    for (std::size_t r = low(row); r <= last_row; ++r) {
      const bool whole = r + ring == row || r == row + ring;
      for (std::size_t c = low(column); c <= last_column; ++c) {
        if (!whole && c + ring != column && c != column + ring) continue;
        const std::size_t at = r * stored_.columns + c;
        // Of the cell's corner from the centre.
        const double east = static_cast<double>(c) - static_cast<double>(column) - 0.5;
        const double south = static_cast<double>(r) - static_cast<double>(row) + 0.5;
        for (std::size_t k = start_[at]; k < start_[at + 1]; ++k) {
          const GroundPoint& p = ground_[k];
          const double dx = east + double{p.east}, dy = south - double{p.north};
          near.push_back({dx, dy, p.z, dx * dx + dy * dy});
        }
      }
    }
    const double seen = static_cast<double>(ring) + 0.5;  // cells to what was not looked at
    // All within kAll are in the first ring around.
    if (ring == 0 || near.size() < kNearest) continue;
    std::size_t inside = 0;
    double nearest = near.front().square;
    for (const Near& p : near) {
      inside += p.square <= seen * seen ? 1 : 0;
      nearest = std::min(nearest, p.square);
    }
    enough = inside >= kNearest && kAcross * kAcross * nearest <= seen * seen;
  }
  // Whichever of several at one distance are taken, and in which order: the same everywhere.
  std::sort(near.begin(), near.end(), [](const Near& a, const Near& b) {
    return std::tie(a.square, a.x, a.y, a.z) < std::tie(b.square, b.x, b.y, b.z);
  });
  if (near.size() < kFewest || near.front().square > reach_ * reach_) return false;
  std::size_t count = std::min(near.size(), kNearest);
  const double all = std::max(kAll * kAll, kAcross * kAcross * near.front().square);
  while (count < near.size() && near[count].square <= all) ++count;
  near.resize(count);
  return true;
}

namespace {

/// Weighted least squares of a polynomial about the centre.
template <int N>
struct Fitted {
  Eigen::Matrix<double, N, 1> found;
  double sigma = std::numeric_limits<double>::quiet_NaN();  // of the first
};

template <int N>
Eigen::Matrix<double, N, 1> terms(double x, double y) {
  Eigen::Matrix<double, N, 1> out;
  out(0) = 1.0;
  out(1) = x;
  out(2) = y;
  if constexpr (N == 6) {
    out(3) = x * x;
    out(4) = x * y;
    out(5) = y * y;
  }
  return out;
}

/// @param weights  of the points
template <int N, typename Points>
Fitted<N> fit(const Points& near, const std::vector<double>& weights) {
  using Matrix = Eigen::Matrix<double, N, N>;
  Matrix normal = Matrix::Zero(), squared = Matrix::Zero();
  Eigen::Matrix<double, N, 1> right = Eigen::Matrix<double, N, 1>::Zero();
  double sum = 0.0, squares = 0.0;
  for (std::size_t i = 0; i < near.size(); ++i) {
    const auto a = terms<N>(near[i].x, near[i].y);
    const double w = weights[i];
    normal += w * a * a.transpose();
    squared += w * w * a * a.transpose();
    right += w * near[i].z * a;
    sum += w;
    squares += w * w;
  }
  // Terms that the places do not hold apart stay small.
  Matrix held = normal;
  held.diagonal().tail(N - 1) *= 1.0 + 1e-9;
  const Eigen::LDLT<Matrix> solver(held);
  Fitted<N> out;
  out.found = solver.solve(right);
  double residual = 0.0;
  for (std::size_t i = 0; i < near.size(); ++i) {
    const double off = near[i].z - terms<N>(near[i].x, near[i].y).dot(out.found);
    residual += weights[i] * off * off;
  }
  const double effective = sum * sum / squares;  // points
  const Eigen::Matrix<double, N, 1> response =
      solver.solve(Eigen::Matrix<double, N, 1>::Unit(0).eval());
  const double freedom = std::max(effective - N, 1.0);
  const double scatter = residual / sum * effective / freedom;
  out.sigma = std::sqrt(scatter * response.dot(squared * response));
  return out;
}

}  // namespace

SiteRowsMaker::Answer SiteRowsMaker::answer(std::size_t row, std::size_t column,
                                            std::vector<Near>& near) const {
  // Of the distance of the farthest point: how far the points' middle may lie aside of the centre.
  constexpr double kBetween = 0.3, kBeside = 0.75;
  constexpr double kThinnest = 0.02;  // of the square of that distance, across a line
  Answer out;
  if (!find_near(row, column, near)) return out;
  const double level = near.front().z;
  for (Near& p : near) p.z -= level;
  const double square = 1.1 * near.back().square;
  std::vector<double> weights;
  double sum = 0.0;
  Vector2d mean(0.0, 0.0);
  Eigen::Matrix2d spread = Eigen::Matrix2d::Zero();
  for (const Near& p : near) {
    const double ratio = 1.0 - p.square / square;
    weights.push_back(ratio * ratio);
    const Vector2d place(p.x, p.y);
    mean += weights.back() * place;
    spread += weights.back() * place * place.transpose();
    sum += weights.back();
  }
  mean /= sum;
  spread = spread / sum - mean * mean.transpose();
  const double trace = spread.trace(), determinant = spread.determinant();
  const double thin = 0.5 * trace - std::sqrt(std::max(0.0, 0.25 * trace * trace - determinant));
  const double aside = mean.norm() / std::sqrt(square);
  if (thin < kThinnest * square || aside > kBeside) return out;
  const auto take = [&](const auto& fitted) {
    out.height = level + fitted.found(0);
    out.slope_x = fitted.found(1);
    out.slope_y = fitted.found(2);
    out.sigma = fitted.sigma;
  };
  if (near.size() >= kNearest && aside < kBetween) {
    take(fit<6>(near, weights));
  } else {
    take(fit<3>(near, weights));
  }
  if (!std::isfinite(out.height) || !std::isfinite(out.sigma)) out = Answer();
  return out;
}

SiteRows SiteRowsMaker::finish() {
  sort_by_cell();
  SiteRows out;
  out.window = window_;
  const std::size_t columns = window_.columns;
  for (std::vector<float>* band :
       {&out.ground, &out.surface, &out.slopes, &out.sigmas, &out.points, &out.shades}) {
    band->assign(window_.rows * columns, kNone);
  }
  const double rise = options_.height_per_length / cell_;
  parallel_for(window_.rows, options_.num_threads, [&](std::size_t row) {
    std::vector<Near> near;
    const std::size_t stored = row + window_.row - stored_.row;
    for (std::size_t column = 0; column < columns; ++column) {
      const std::size_t beside = column + window_.column - stored_.column;
      const std::size_t at = row * columns + column, from = stored * stored_.columns + beside;
      out.points[at] = static_cast<float>(points_[from]);
      out.surface[at] = surface_[from];
      const Answer found = answer(stored, beside, near);
      if (std::isnan(found.height)) continue;
      const double east = found.slope_x * rise, north = -found.slope_y * rise;
      out.ground[at] = static_cast<float>(found.height);
      out.sigmas[at] = static_cast<float>(found.sigma);
      out.slopes[at] = static_cast<float>(std::atan(std::hypot(east, north)));
      out.shades[at] = shade_of(east, north);
    }
  });
  return out;
}

}  // namespace camber
