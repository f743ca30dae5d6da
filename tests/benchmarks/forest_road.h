#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <filesystem>
#include <map>
#include <utility>
#include <vector>

#include "camber/cloud/road_cloud.h"

namespace camber::benchmarks {

/// Whether a file is there; prints that a part is skipped where it is not.
bool available(const std::filesystem::path& path);

/// Rows of numbers of a CSV file with one header line.
std::vector<std::vector<double>> read_rows(const std::filesystem::path& path);

/// Slope of heights over `length` around each station, by least squares; NaN at the ends.
std::vector<double> smoothed_grade(const std::vector<double>& station,
                                   const std::vector<double>& height, double length);

/// Heights on a grid of 1 m whose cells may be missing.
class Terrain {
 public:
  explicit Terrain(const RoadCloud& cloud);
  double height(double x, double y) const;  ///< bilinear; NaN outside

 private:
  std::pair<long, long> key(double x, double y) const;
  Eigen::Vector2d offset_ = Eigen::Vector2d::Zero();
  std::map<std::pair<long, long>, double> cells_;
};

/// What a cloud of the forest road is made of.
struct ForestInput {
  const char* name;
  std::size_t points;  ///< 0: every grid cell once
  float width;         ///< m, cells this near to the centreline
  bool sigmas;
};
inline constexpr ForestInput kForestInputs[] = {
    {"every cell once", 0, 25.0f, false},     {"every cell once", 0, 25.0f, true},
    {"road and verge, once", 0, 6.0f, false}, {"20000 places", 20000, 25.0f, false},
    {"200000 places", 200000, 25.0f, false},  {"200000 places", 200000, 25.0f, true}};

/// als-forest-road, to be seen by a camera that drives along it.
struct ForestRoad {
  RoadCloud terrain;
  Terrain grid;
  std::vector<Eigen::Vector3d> line;  ///< the centreline
  std::vector<double> station;        ///< m, of its points, in plan as profiles have them
  std::vector<double> height;         ///< m, of its points

  explicit ForestRoad(const std::filesystem::path& folder);
  double height_at(double at_station) const;  ///< of the centreline
  /// Slope of the ground across the centreline at its points, rise over run, left side up: least
  /// squares over `half_width` to both sides. NaN at the edge of the grid.
  std::vector<double> cross_slopes(double half_width) const;
  /// With the noise of a camera 1.65 m above the road, 6 to 30 m before each point.
  RoadCloud cloud(const ForestInput& input, std::uint64_t seed) const;
};

}  // namespace camber::benchmarks
