#include "camber/pipeline/stages/fuse_masks.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <optional>
#include <utility>

#include "camber/core/median.h"

namespace camber::stages {
namespace {

/// A point of the ground over the ego plane, m.
struct GroundHeight {
  std::size_t grid;
  double along, across, height, sigma;
};

std::vector<GroundHeight> heights_of(const TriangulatedPoints& points, const Plane& ego,
                                     const Eigen::Vector3d& travel, double metres) {
  const Eigen::Vector3d ahead = (travel - travel.dot(ego.normal) * ego.normal).normalized();
  const Eigen::Vector3d side = ego.normal.cross(ahead);
  std::vector<GroundHeight> out;
  out.reserve(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    const double rho = points.inverse_depth[i];
    const Eigen::Vector3d x = points.point(i);
    out.push_back(
        {static_cast<std::size_t>(points.grid[i]), metres * ahead.dot(x), metres * side.dot(x),
         metres * ego.signed_distance(x),
         metres * std::abs(ego.normal.dot(points.rays[i])) * points.sigma_own[i] / (rho * rho)});
  }
  return out;
}

/// Heights along the road ahead.
class CentralSurface {
 public:
  CentralSurface(const std::vector<GroundHeight>& points, const MaskFusionOptions& options) {
    struct Bin {
      std::vector<double> along, height;
    };
    std::map<int, Bin> bins;
    for (const GroundHeight& p : points) {
      if (p.along < kNearest || p.sigma > options.max_sigma) continue;
      if (std::abs(p.across) > options.half_width) continue;
      Bin& bin = bins[bin_of(p.along)];
      bin.along.push_back(p.along);
      bin.height.push_back(p.height);
    }
    for (auto& [number, bin] : bins) {
      if (bin.along.size() < kLeastOfBin) continue;
      along_.push_back(upper_median(std::move(bin.along)));
      height_.push_back(upper_median(std::move(bin.height)));
    }
    fit_cross_slope(points, options);
  }

  /// Linear between the bins' middles, and on from the first and the last two. Nothing where the
  /// driven part is not seen any more.
  std::optional<double> at(double along, double across) const {
    if (along_.size() < 2 || along > along_.back() * kGrowth) return std::nullopt;
    const auto after = std::upper_bound(along_.begin() + 1, along_.end() - 1, along);
    const auto i = static_cast<std::size_t>(after - along_.begin());
    const double share = (along - along_[i - 1]) / (along_[i] - along_[i - 1]);
    return (1.0 - share) * height_[i - 1] + share * height_[i] + cross_slope_ * across;
  }

 private:
  static constexpr double kNearest = 3.0;           // m
  static constexpr double kGrowth = 1.2;            // of the bins' lengths along the road
  static constexpr std::size_t kLeastOfBin = 8;     // points
  static constexpr double kSlopeResidual = 0.15;    // m: kerbs take no part in the cross slope
  static constexpr std::size_t kLeastOfSlope = 50;  // points

  static int bin_of(double along) {
    return static_cast<int>(std::floor(std::log(along / kNearest) / std::log(kGrowth)));
  }

  void fit_cross_slope(const std::vector<GroundHeight>& points, const MaskFusionOptions& options) {
    double across2 = 0.0, product = 0.0;
    std::size_t count = 0;
    for (const GroundHeight& p : points) {
      if (p.along < kNearest || p.sigma > options.max_sigma) continue;
      if (std::abs(p.across) > options.slope_width) continue;
      const auto level = at(p.along, 0.0);
      if (!level || std::abs(p.height - *level) > kSlopeResidual) continue;
      const double weight = 1.0 / (p.sigma * p.sigma + 1e-4);
      across2 += weight * p.across * p.across;
      product += weight * p.across * (p.height - *level);
      ++count;
    }
    if (count >= kLeastOfSlope && across2 > 0.0) cross_slope_ = product / across2;
  }

  std::vector<double> along_, height_;  // m, ascending
  double cross_slope_ = 0.0;
};

/// Cells of grid points, row by row.
class CellGrid {
 public:
  CellGrid(const Correspondences& matches, const MaskFusionOptions& options)
      : grid_columns_(matches.columns),
        wide_(std::max(1, options.cell_width / matches.step)),
        high_(std::max(1, options.cell_height / matches.step)),
        columns_((matches.columns + wide_ - 1) / wide_),
        rows_((matches.rows + high_ - 1) / high_) {}

  std::size_t size() const { return static_cast<std::size_t>(columns_ * rows_); }
  std::size_t cell_of(std::size_t grid) const {
    const int at = static_cast<int>(grid);
    return static_cast<std::size_t>(at / grid_columns_ / high_ * columns_ +
                                    at % grid_columns_ / wide_);
  }

  /// Clears marks with too much unmarked ground beyond them in their row, seen from the driven
  /// line.
  /// @param across  m, of the cells' middles; NaN: nothing is known of the cell.
  void drop_with_road_beyond(const std::vector<double>& across, double most,
                             std::vector<std::uint8_t>* marked) const {
    for (int row = 0; row < rows_; ++row) {
      const auto cell = [&](int column) {
        return static_cast<std::size_t>(row * columns_ + column);
      };
      int middle = -1;  // the driven line's column
      for (int c = 0; c < columns_; ++c) {
        if (std::isnan(across[cell(c)])) continue;
        if (middle < 0 || std::abs(across[cell(c)]) < std::abs(across[cell(middle)])) middle = c;
      }
      if (middle < 0) continue;
      for (const int step : {1, -1}) {
        int on = 0, off = 0;
        for (int c = step > 0 ? 0 : columns_ - 1; c != middle; c += step) {
          if (std::isnan(across[cell(c)])) continue;
          ++((*marked)[cell(c)] ? off : on);
          if (on > most * off) (*marked)[cell(c)] = 0;
        }
      }
      (*marked)[cell(middle)] = 0;
    }
  }

  /// Clears the marks of groups of fewer cells that touch at their sides.
  void drop_small(int least, std::vector<std::uint8_t>* marked) const {
    std::vector<std::uint8_t> seen(size(), 0);
    for (std::size_t first = 0; first < size(); ++first) {
      if (!(*marked)[first] || seen[first]) continue;
      std::vector<std::size_t> group = {first};
      seen[first] = 1;
      for (std::size_t k = 0; k < group.size(); ++k) {
        const int row = static_cast<int>(group[k]) / columns_;
        const int column = static_cast<int>(group[k]) % columns_;
        for (const auto& [r, c] : {std::pair{row - 1, column},
                                   {row + 1, column},
                                   {row, column - 1},
                                   {row, column + 1}}) {
          if (r < 0 || c < 0 || r >= rows_ || c >= columns_) continue;
          const auto next = static_cast<std::size_t>(r * columns_ + c);
          if (!(*marked)[next] || seen[next]) continue;
          seen[next] = 1;
          group.push_back(next);
        }
      }
      if (static_cast<int>(group.size()) >= least) continue;
      for (const std::size_t cell : group) (*marked)[cell] = 0;
    }
  }

 private:
  int grid_columns_, wide_, high_, columns_, rows_;
};

}  // namespace

std::vector<std::uint8_t> off_road_surface(const Correspondences& matches, const GroundPoints& seen,
                                           const Plane& ego, const Eigen::Vector3d& travel,
                                           double metres_per_baseline,
                                           const MaskFusionOptions& options) {
  std::vector<std::uint8_t> off(matches.pixels.size(), 0);
  const std::vector<GroundHeight> points =
      heights_of(seen.points, ego, travel, metres_per_baseline);
  const CentralSurface surface(points, options);

  const CellGrid grid(matches, options);
  std::vector<std::vector<double>> heights(grid.size()), sigmas(grid.size()),
      across(grid.size());  // m
  for (const GroundHeight& p : points) {
    const auto level = surface.at(p.along, p.across);
    if (!level || p.sigma > options.max_sigma) continue;
    const std::size_t cell = grid.cell_of(p.grid);
    heights[cell].push_back(p.height - *level);
    sigmas[cell].push_back(p.sigma);
    across[cell].push_back(p.across);
  }
  std::vector<std::uint8_t> cell_off(grid.size(), 0);
  std::vector<double> middle(grid.size(), std::numeric_limits<double>::quiet_NaN());
  for (std::size_t c = 0; c < grid.size(); ++c) {
    if (heights[c].size() < static_cast<std::size_t>(options.least_points)) continue;
    middle[c] = upper_median(across[c]);
    if (std::abs(middle[c]) <= options.slope_width) continue;  // the road itself
    cell_off[c] = std::abs(upper_median(heights[c])) >
                  options.most_height + options.sigmas * upper_median(sigmas[c]);
  }
  grid.drop_with_road_beyond(middle, options.most_road_beyond, &cell_off);
  grid.drop_small(options.least_cells, &cell_off);
  for (std::size_t i = 0; i < off.size(); ++i) {
    off[i] = seen.is_ground[i] != 0 && cell_off[grid.cell_of(i)] != 0;
  }
  return off;
}

void fuse_masks(const Correspondences& matches, const MotionEstimate& motion, const Ground& ground,
                LoadedFrames* frames, GroundPoints* seen) {
  if (!frames->masks_by_network || !frames->has_masks()) return;
  const std::vector<std::uint8_t> off =
      off_road_surface(matches, *seen, ground.ego.plane.plane,
                       travel_direction(motion, frames->reference), ground.metres_per_baseline);
  FrameMasks& masks = frames->masks[frames->reference];
  const int width = frames->camera.width, height = frames->camera.height;
  bool any = false;
  for (std::size_t i = 0; i < off.size(); ++i) {
    if (!off[i]) continue;
    any = true;
    seen->is_ground[i] = seen->is_roadway[i] = 0;
    const int x = static_cast<int>(matches.pixels[i].x()),
              y = static_cast<int>(matches.pixels[i].y());
    const int reach = matches.step / 2;
    for (int v = std::max(0, y - reach); v <= std::min(height - 1, y + reach); ++v) {
      for (int u = std::max(0, x - reach); u <= std::min(width - 1, x + reach); ++u) {
        const std::size_t p = static_cast<std::size_t>(v) * static_cast<std::size_t>(width) +
                              static_cast<std::size_t>(u);
        masks.ground[p] = masks.roadway[p] = 0;
      }
    }
  }
  if (any) seen->points = seen->points.chosen(seen->is_ground);
}

}  // namespace camber::stages
