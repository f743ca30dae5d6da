// Filters and normals by radius in tiles are those of the whole.

#include "camber/tiles/point_tile.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <map>

#include "camber/cloud/cloud_io.h"
#include "camber/cloud/filters.h"
#include "camber/cloud/normals.h"
#include "camber/cloud/voxel_grid.h"
#include "camber/core/errors.h"
#include "camber/tiles/plan_tiles.h"
#include "camber/tiles/tile_job.h"
#include "camber/tiles/tile_points.h"
#include "support/test_data.h"
#include "tiles/made_survey.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

class PointTiles : public ::testing::Test {
 protected:
  void SetUp() override {
    cloud_ = test::made_survey(90.0, 8.0);
    // On a lattice, so that many distances are equal and some points are twice there.
    for (Eigen::Vector3f& p : cloud_.points) p = (8.0f * p).array().round().matrix() / 8.0f;
    write_cloud(cloud_, folder_.path() / "whole.laz");
  }
  TilePlan plan(double side, double corner) const {
    TilePlanOptions options;
    options.side = side;
    options.origin = {corner, 2.0 * corner};
    options.overwrite = true;
    return plan_tiles({folder_.path() / "whole.laz"}, folder_.path() / "plan", options);
  }
  /// What each point of the whole gets, by its id, from one for each tile.
  template <typename Value, typename OfTile>
  std::map<int, Value> by_tiles(const TilePlan& plan, const OfTile& of_tile) const {
    std::map<int, Value> out;
    for (std::size_t k = 0; k < plan.tiles.size(); ++k) {
      const std::vector<Value> values = of_tile(k);
      const RoadCloud tile = read_cloud(plan.path_of(k));
      EXPECT_EQ(values.size(), tile.size());
      for (std::size_t i = 0; i < tile.size(); ++i) out[tile.labels.at("id")[i]] = values[i];
    }
    return out;
  }

  test::TemporaryFolder folder_;
  RoadCloud cloud_;
};

TEST_F(PointTiles, NormalsAreThoseOfTheWholeBitForBit) {
  for (const int neighbors : {1000000, 9}) {  // with so few the farthest of equal ones count
    std::map<int, std::array<float, 3>> whole;
    for (const double side : {23.0, 31.0, 1000.0}) {
      const TilePlan tiles = plan(side, side / 7.0);
      EXPECT_EQ(tiles.tiles.size() > 4, side < 100.0);
      if (whole.empty()) {
        TilePoints points = read_whole_points(tiles, folder_.path() / "whole.laz", TileReading());
        NormalOptions options;
        options.radius = 1.3f;
        options.neighbors = neighbors;
        estimate_normals(points.cloud, options);
        for (std::size_t i = 0; i < points.own.size(); ++i) {
          const auto own = static_cast<std::size_t>(points.own[i]);
          const Eigen::Vector3f& n = points.cloud.normals[i];
          whole[cloud_.labels.at("id")[own]] = {n.x(), n.y(), n.z()};
        }
      }
      const auto found = by_tiles<Eigen::Vector3f>(tiles, [&](std::size_t k) {
        return tile_normals(tiles, k, 1.3, neighbors, k % 2 == 0 ? 1 : 2).normals;
      });
      ASSERT_EQ(found.size(), whole.size());
      std::size_t different = 0, known = 0;
      for (const auto& [id, normal] : found) {
        different += std::memcmp(normal.data(), whole.at(id).data(), 12) == 0 ? 0 : 1;
        known += normal.allFinite() ? 1 : 0;
      }
      EXPECT_EQ(different, 0u) << side << " " << neighbors;
      EXPECT_GT(known, cloud_.size() * 9 / 10);
    }
  }
}

TEST_F(PointTiles, FilteredPointsAreThoseOfTheWhole) {
  std::map<int, int> whole;
  for (std::size_t i = 0; i < cloud_.size(); ++i) whole[cloud_.labels.at("id")[i]] = 0;
  for (const int i : radius_inliers(cloud_, 0.75, 14)) {
    whole[cloud_.labels.at("id")[static_cast<std::size_t>(i)]] = 1;
  }
  std::size_t kept = 0;
  for (const auto& [id, value] : whole) kept += static_cast<std::size_t>(value);
  EXPECT_GT(kept, cloud_.size() / 4);
  EXPECT_LT(kept, cloud_.size() * 3 / 4);
  for (const double side : {23.0, 40.0}) {
    const TilePlan tiles = plan(side, 3.0);
    const auto found = by_tiles<int>(tiles, [&](std::size_t k) {
      const TileInliers inliers = tile_radius_inliers(tiles, k, 0.75, 14, 1);
      return std::vector<int>(inliers.kept.begin(), inliers.kept.end());
    });
    EXPECT_EQ(found, whole);
  }
}

/// Points of files as text, sorted: all that they hold.
std::vector<std::string> rows_of(const std::vector<fs::path>& files) {
  std::vector<std::string> out;
  for (const fs::path& file : files) {
    const RoadCloud cloud = read_cloud(file);
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      const Eigen::Vector3d p = cloud.origin + cloud.points[i].cast<double>();
      std::string row;
      for (int a = 0; a < 3; ++a) row += std::to_string(p[a]) + " ";
      for (const auto& [name, values] : cloud.labels) row += std::to_string(values[i]) + " ";
      out.push_back(row);
    }
  }
  std::sort(out.begin(), out.end());
  return out;
}

TEST_F(PointTiles, CubesAreThoseOfTheWhole) {
  std::vector<std::string> whole;
  for (const double side : {1000.0, 23.0, 40.0}) {
    const TilePlan tiles = plan(side, side > 100.0 ? 0.0 : 3.3);
    TileJob job;
    job.kind = TileJob::Kind::kVoxels;
    job.voxel = 1.7;
    begin_tile_job(tiles, job);
    std::vector<fs::path> files;
    for (std::size_t k = 0; k < tiles.tiles.size(); ++k) {
      files.push_back(job_folder(tiles, job) / run_tile_job(tiles, job, k).file);
    }
    const std::vector<std::string> found = rows_of(files);
    if (whole.empty()) {
      whole = found;
      // As many as there are occupied cubes.
      EXPECT_EQ(whole.size(), thin(cloud_, 1.7).size());
    }
    EXPECT_EQ(found, whole) << side;
  }
}

TEST_F(PointTiles, DistancesToAnotherSurveyAreThoseOfTheWhole) {
  // The other survey: moved, less than half of its points, and nothing in the east.
  RoadCloud other = test::strip_of(cloud_, 0.0, 70.0);
  std::vector<int> some;
  for (std::size_t i = 0; i < other.size(); i += 1 + i % 3) some.push_back(static_cast<int>(i));
  other = other.select(some);
  for (Eigen::Vector3f& p : other.points) p += Eigen::Vector3f(0.25f, -0.125f, 0.5f);
  write_cloud(other, folder_.path() / "other.laz");
  TilePlanOptions options;
  options.side = 31.0;
  const TilePlan truth =
      plan_tiles({folder_.path() / "other.laz"}, folder_.path() / "truth", options);
  constexpr double kRadius = 0.8;
  std::map<int, float> expected;
  std::size_t near = 0, nowhere = 0;
  for (std::size_t i = 0; i < cloud_.size(); i += 97) {
    float least = std::numeric_limits<float>::infinity();
    for (const Eigen::Vector3f& q : other.points) {
      least = std::min(least, (cloud_.points[i] - q).squaredNorm());
    }
    const bool found = std::sqrt(least) < static_cast<float>(kRadius);
    (found ? near : nowhere) += 1;
    expected[cloud_.labels.at("id")[i]] =
        found ? std::sqrt(least) : std::numeric_limits<float>::quiet_NaN();
  }
  EXPECT_GT(near, 100u);
  EXPECT_GT(nowhere, 50u);
  const TilePlan tiles = plan(37.0, 11.0);
  const auto by_id = by_tiles<float>(
      tiles, [&](std::size_t k) { return tile_distances(tiles, k, truth, kRadius, 0).distances; });
  EXPECT_EQ(by_id.size(), cloud_.size());
  for (const auto& [id, distance] : expected) {
    if (std::isnan(distance)) {
      EXPECT_TRUE(std::isnan(by_id.at(id))) << id;
    } else {
      EXPECT_FLOAT_EQ(by_id.at(id), distance) << id;
    }
  }
  TileJob job;
  job.kind = TileJob::Kind::kCompare;
  job.truth = truth.folder;
  job.radius = kRadius;
  begin_tile_job(tiles, job);
  for (std::size_t k = 0; k < tiles.tiles.size(); ++k) run_tile_job(tiles, job, k);
  const JoinedTiles joined = join_tiles(tiles, job);
  const auto within = [&](float most) {
    return static_cast<std::uint64_t>(std::count_if(
        by_id.begin(), by_id.end(), [&](const auto& entry) { return entry.second <= most; }));
  };
  EXPECT_EQ(joined.counts.at("compared"), within(0.8f));
  EXPECT_EQ(joined.counts.at("within_0.2"), within(0.2f));
  job.thresholds = {2.0};
  EXPECT_THROW(job.validate(), std::invalid_argument);
}

TEST_F(PointTiles, JobsWriteWhatTheyFind) {
  const TilePlan tiles = plan(50.0, 0.0);
  TileJob job;
  job.kind = TileJob::Kind::kFilter;
  job.radius = 0.75;
  job.neighbors = 14;
  begin_tile_job(tiles, job);
  for (std::size_t k = 0; k < tiles.tiles.size(); ++k) run_tile_job(tiles, job, k);
  const JoinedTiles joined = join_tiles(tiles, job);
  EXPECT_EQ(joined.points, radius_inliers(cloud_, 0.75, 14).size());
  EXPECT_EQ(joined.counts.at("kept"), joined.points);
  job.radius = 0.5;
  EXPECT_THROW(begin_tile_job(tiles, job), UsageError);
  job.folder = folder_.path() / "finer";
  begin_tile_job(tiles, job);

  job = TileJob();
  job.kind = TileJob::Kind::kNormals;
  job.radius = 1.3;
  EXPECT_THROW(begin_tile_job(tiles, job), std::invalid_argument);  // no neighbours
  job.neighbors = 20;
  begin_tile_job(tiles, job);
  const TileDone done = run_tile_job(tiles, job, 0);
  const RoadCloud cloud = read_cloud(job_folder(tiles, job) / done.file);
  ASSERT_EQ(cloud.normals.size(), tiles.tiles[0].points);
  const TileNormals normals = tile_normals(tiles, 0, 1.3, 20, 0);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    EXPECT_EQ(std::memcmp(cloud.normals[i].data(), normals.normals[i].data(), 12), 0);
  }
}

}  // namespace
}  // namespace camber
