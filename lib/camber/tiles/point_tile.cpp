#include "camber/tiles/point_tile.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "camber/cloud/filters.h"
#include "camber/cloud/normals.h"
#include "camber/cloud/point_tree.h"
#include "camber/cloud/stream_filters.h"
#include "camber/core/interruption.h"
#include "camber/core/threads.h"
#include "camber/tiles/tile_points.h"

namespace camber {
namespace {

constexpr double kRounding = 0.01;  // m, of coordinates

/// With all that lies within a radius, however it is rounded.
TilePoints read_with(const TilePlan& plan, std::size_t tile, double radius, int num_threads) {
  TileReading reading;
  reading.halo = radius + kRounding;
  reading.num_threads = num_threads;
  TilePoints points = read_tile_points(plan, tile, reading);
  throw_if_interrupted();
  return points;
}

}  // namespace

TileInliers tile_radius_inliers(const TilePlan& plan, std::size_t tile, double radius,
                                int neighbors, int num_threads) {
  const TilePoints points = read_with(plan, tile, radius, num_threads);
  TileInliers out;
  out.read_points = points.read_points;
  out.kept.assign(static_cast<std::size_t>(points.own_points), 0);
  for (const int i : radius_inliers(points.cloud, radius, neighbors, num_threads)) {
    const std::int32_t own = points.own[static_cast<std::size_t>(i)];
    if (own < 0) continue;
    out.kept[static_cast<std::size_t>(own)] = 1;
    ++out.points;
  }
  return out;
}

TileVoxels::TileVoxels(const TilePlan& plan, std::size_t tile, double size, int num_threads) {
  TileReading reading;
  reading.halo = size + kRounding;
  reading.num_threads = num_threads;
  TileRecords found = read_tile_records(plan, tile, reading);
  read_points_ = found.read_points;
  const std::vector<unsigned char> own = std::move(found.own);
  const std::unique_ptr<PointSource> points =
      make_las_rows(found.header, std::move(found.records), std::move(found.order));
  grid_ = std::make_unique<VoxelGrid>(points->header(), size / plan.metres);
  std::size_t place = 0;
  for (PointBatch batch; points->next(batch);) {
    throw_if_interrupted();
    grid_->add(batch);
    for (const std::int32_t cube : grid_->cubes()) {
      if (cube == static_cast<std::int32_t>(own_.size())) own_.push_back(own[place]);
      ++place;
    }
  }
}

std::unique_ptr<PointSource> TileVoxels::points() {
  return select_rows(grid_->points(), [this](const PointStreamHeader&, const PointBatch& batch,
                                             std::vector<unsigned char>* keep) {
    for (std::size_t i = 0; i < batch.count; ++i) (*keep)[i] = own_[next_++];
  });
}

TileNormals tile_normals(const TilePlan& plan, std::size_t tile, double radius, int neighbors,
                         int num_threads) {
  TilePoints points = read_with(plan, tile, radius, num_threads);
  NormalOptions options;
  options.radius = static_cast<float>(radius);
  options.neighbors = neighbors;
  options.num_threads = num_threads;
  estimate_normals(points.cloud, options);
  TileNormals out;
  out.read_points = points.read_points;
  constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();
  out.normals.assign(static_cast<std::size_t>(points.own_points),
                     Eigen::Vector3f(kNaN, kNaN, kNaN));
  for (std::size_t i = 0; i < points.own.size(); ++i) {
    if (points.own[i] < 0) continue;
    out.normals[static_cast<std::size_t>(points.own[i])] = points.cloud.normals[i];
    out.points += points.cloud.normals[i].allFinite() ? 1 : 0;
  }
  return out;
}

TileDistances tile_distances(const TilePlan& plan, std::size_t tile, const TilePlan& truth,
                             double radius, int num_threads) {
  TileReading reading;
  reading.num_threads = num_threads;
  const TilePoints points = read_tile_points(plan, tile, reading);
  reading.halo = radius + kRounding;
  const TilePoints other = read_points_around(truth, points, reading);
  throw_if_interrupted();
  const PointTree tree(other.cloud.points, num_threads);
  TileDistances out;
  out.read_points = points.read_points + other.read_points;
  out.distances.assign(static_cast<std::size_t>(points.own_points),
                       std::numeric_limits<float>::quiet_NaN());
  constexpr std::size_t kBatch = 16384;
  const std::size_t count = points.cloud.size();
  parallel_for((count + kBatch - 1) / kBatch, num_threads, [&](std::size_t batch) {
    const std::size_t end = std::min(count, (batch + 1) * kBatch);
    for (std::size_t i = batch * kBatch; i < end; ++i) {
      const PointTree::Neighbor nearest =
          tree.nearest(points.cloud.points[i], static_cast<float>(radius));
      if (nearest.index < 0) continue;
      out.distances[static_cast<std::size_t>(points.own[i])] = std::sqrt(nearest.squared_distance);
    }
  });
  return out;
}

}  // namespace camber
