#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "camber/cloud/point_stream.h"
#include "camber/cloud/road_cloud.h"

namespace camber {

/// Thins a stream of points to one a cube, in memory for the occupied cubes alone. A cube's point
/// is at the mean of its points; colours and other numbers are averaged, normals summed and made
/// unit (NaN ones do not count), `sigma` is that of a mean of independent points, sqrt(sum sigma^2)
/// / n, a covariance sum / n^2; an integer attribute has the value that most of the cube's points
/// have where one value has the majority, else one of theirs. Points that are not finite are left
/// out. Cubes come in the order of their first points.
class VoxelGrid {
 public:
  /// @param size edge of a cube, m, > 0; cubes are aligned with the origin of the coordinates
  /// @throws std::invalid_argument for another size.
  VoxelGrid(const PointStreamHeader& header, double size);
  ~VoxelGrid();
  void add(const PointBatch& batch);

  /// Of each point of the last batch the number of its cube, -1 where it was left out: cubes count
  /// in the order of their first points, as points() has them.
  const std::vector<std::int32_t>& cubes() const;

  /// Points left out because they are not finite.
  std::uint64_t non_finite() const;

  /// The thinned points as a stream with the same fields; the grid must outlive it.
  std::unique_ptr<PointSource> points();

 private:
  struct State;
  class Source;
  std::unique_ptr<State> state_;
};

/// The same for a whole cloud. @throws std::invalid_argument for a size that is not positive.
RoadCloud thin(const RoadCloud& cloud, double size);

}  // namespace camber
