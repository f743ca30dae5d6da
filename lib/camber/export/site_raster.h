#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

namespace camber {

/// Square cells over a site, row by row from the greatest y (north), in the units of the cloud's
/// horizontal axes. Corners are multiples of the cell, so that rasters of the same cell fit each
/// other.
struct SiteGrid {
  double west = 0.0, north = 0.0;  ///< outer corner of the first cell
  double cell = 0.0;
  std::size_t columns = 0, rows = 0;

  SiteGrid() = default;
  /// The grid of all cells that hold places from `low` to `high` (x, y).
  SiteGrid(const Eigen::Vector2d& low, const Eigen::Vector2d& high, double cell);
  Eigen::Vector2d center(std::size_t row, std::size_t column) const {
    return {west + (static_cast<double>(column) + 0.5) * cell,
            north - (static_cast<double>(row) + 0.5) * cell};
  }
};

struct SiteRasterOptions {
  /// Units of x and y: how far the nearest point of the ground may lie from a cell's centre. What
  /// is farther from it is a hole. > 0
  double reach = 1.0;
  double height_per_length = 1.0;  ///< of a unit of z and a unit of x and y, metres each; > 0
  int num_threads = 0;             ///< <= 0: see resolve_num_threads
};

/// A rectangle of a grid's cells.
struct SiteWindow {
  std::size_t row = 0, column = 0;  ///< first ones
  std::size_t rows = 0, columns = 0;
};

/// Some rows of a site's raster, row by row; NaN: not known.
struct SiteRows {
  SiteWindow window;
  std::vector<float> ground;   ///< height of the ground in the cell's centre, units of z
  std::vector<float> surface;  ///< greatest height of a point in the cell, units of z
  std::vector<float> slopes;   ///< rad, steepest, of the ground
  std::vector<float> sigmas;   ///< standard deviation of `ground`, units of z
  std::vector<float> points;   ///< of the cell; 0 where there are none
  /// 0 to 1, of the ground lit from the north-west, 45 degrees high; NaN.
  std::vector<float> shades;
};

/// Makes rows of a site's raster out of points in any number: memory is that of the rows and of the
/// ground's points in them.
///
/// The ground in a cell's centre is that of a surface of second degree through the twelve nearest
/// points of the ground, or all within 0.7 cells where these are more (moving least squares,
/// weights (1 - (d / h)^2)^2, Cleveland and Devlin 1988); of a plane where they lie on one side or
/// are few. Standard deviations are those of its height for the scatter of its points, which are
/// taken as independent of each other.
///
/// A cell's numbers hang on the points within margin() beside it, and on nothing else: not on their
/// order, nor on the grid that it is a cell of, bit for bit, as long as cells are of one size.
class SiteRowsMaker {
 public:
  /// Whole rows. @param grid  is to outlive the maker
  SiteRowsMaker(const SiteGrid& grid, std::size_t first, std::size_t rows,
                const SiteRasterOptions& options);
  /// A part of the grid. @throws std::invalid_argument for 2^32 cells or more with their margin
  SiteRowsMaker(const SiteGrid& grid, const SiteWindow& window, const SiteRasterOptions& options);
  /// Cells beside the answered ones whose points count.
  static std::size_t margin(double cell, const SiteRasterOptions& options);
  /// A point, in the file's units; those of other rows are of no interest.
  void add(const Eigen::Vector3d& point, bool ground);
  /// The same for any number of threads. Once.
  SiteRows finish();
  /// Bytes that one row takes, and a point of the ground.
  static std::size_t bytes_of_row(const SiteGrid& grid);
  static std::size_t bytes_of_point();

 private:
  /// A point of the ground: its place in its cell, from the south-west corner, 0 to 1, and its
  /// height.
  struct GroundPoint {
    float east, north;
    double z;
  };
  struct Near;
  struct Answer {
    double height = std::numeric_limits<double>::quiet_NaN();
    double slope_x = 0.0, slope_y = 0.0;  // height a cell, y south
    double sigma = std::numeric_limits<double>::quiet_NaN();
  };
  void sort_by_cell();
  bool find_near(std::size_t row, std::size_t column, std::vector<Near>& near) const;
  Answer answer(std::size_t row, std::size_t column, std::vector<Near>& near) const;

  SiteRasterOptions options_;
  SiteWindow window_;                // that is answered
  SiteWindow stored_;                // with what lies within reach
  double cell_ = 1.0;                // units of the file
  double west_ = 0.0, north_ = 0.0;  // cells from zero: of the stored ones' corner
  double reach_ = 0.0;               // cells
  std::vector<GroundPoint> ground_;
  std::vector<std::uint32_t> cell_of_;  // of each as it was added; empty once they are sorted
  std::vector<std::size_t> start_;      // of each stored cell's points, and the end
  std::vector<float> surface_;
  std::vector<std::uint32_t> points_;
};

}  // namespace camber
