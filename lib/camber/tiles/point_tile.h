#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <vector>

#include "camber/cloud/voxel_grid.h"
#include "camber/tiles/tile_plan.h"

namespace camber {

/// Which of a tile's own points have enough others near them.
struct TileInliers {
  std::vector<unsigned char> kept;  ///< by their numbers in the file: 1 or 0
  std::uint64_t points = 0;         ///< that are kept
  std::uint64_t read_points = 0;    ///< that were decoded, of all files
};

/// As radius_inliers() of the whole cloud. @param radius  m, > 0  @param neighbors  >= 1
/// @throws InputError, NoAnswerError
TileInliers tile_radius_inliers(const TilePlan& plan, std::size_t tile, double radius,
                                int neighbors, int num_threads);

/// The thinned points of a tile: one a cube, of those cubes whose first point, in the order of y, x
/// and height, is the tile's own.
class TileVoxels {
 public:
  /// As VoxelGrid has the whole cloud's in that order; cubes are aligned with the zero of the
  /// coordinates. @param size  m, edge of a cube, > 0  @throws InputError, NoAnswerError
  TileVoxels(const TilePlan& plan, std::size_t tile, double size, int num_threads);

  /// This object must outlive it. Once.
  std::unique_ptr<PointSource> points();
  std::uint64_t read_points() const { return read_points_; }

 private:
  std::unique_ptr<VoxelGrid> grid_;
  std::vector<unsigned char> own_;  // by cube
  std::size_t next_ = 0;
  std::uint64_t read_points_ = 0;
};

/// Normals of a tile's own points.
struct TileNormals {
  std::vector<Eigen::Vector3f> normals;  ///< by their numbers in the file; NaN where there is none
  std::uint64_t points = 0;              ///< that have one
  std::uint64_t read_points = 0;         ///< that were decoded, of all files
};

/// As estimate_normals() of the whole cloud, up in z: of the points within a radius, at most so
/// many of the nearest. @param radius  m, > 0  @param neighbors  >= 3
/// @throws InputError, NoAnswerError
TileNormals tile_normals(const TilePlan& plan, std::size_t tile, double radius, int neighbors,
                         int num_threads);

/// How far a tile's own points lie from those of another survey.
struct TileDistances {
  std::vector<float> distances;   ///< m, by their numbers in the file; NaN beyond the radius
  std::uint64_t read_points = 0;  ///< that were decoded, of all files of both
};

/// To the nearest point of another plan of tiles, as far as a radius. @param radius  m, > 0
/// @throws InputError, NoAnswerError
TileDistances tile_distances(const TilePlan& plan, std::size_t tile, const TilePlan& truth,
                             double radius, int num_threads);

}  // namespace camber
