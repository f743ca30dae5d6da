#include "camber/tiles/plan_tiles.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <set>

#include "camber/cloud/cloud_io.h"
#include "camber/cloud/morton.h"
#include "camber/core/errors.h"
#include "camber/tiles/detail/tile_grid.h"
#include "camber/tiles/tile_points.h"
#include "support/test_data.h"
#include "tiles/made_survey.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

using ::testing::HasSubstr;

TEST(TileAxis, BordersBelongToTheTileThatBeginsThere) {
  detail::TileAxis axis(0.01, 500000.0, 100.0, 0.0);
  EXPECT_EQ(axis.tile_of(0), 5000);
  EXPECT_EQ(axis.tile_of(9999), 5000);   // 500099.99
  EXPECT_EQ(axis.tile_of(10000), 5001);  // 500100
  EXPECT_EQ(axis.tile_of(-1), 4999);
  EXPECT_EQ(axis.edge(5001), 10000);
  // Whatever the grid, edges and tiles agree.
  detail::TileAxis odd(0.0003048, 17.3, 33.3, -5.1);
  for (std::int32_t value = -3000000; value < 3000000; value += 7919) {
    const std::int64_t tile = odd.tile_of(value);
    EXPECT_LE(odd.edge(tile), value);
    EXPECT_GT(odd.edge(tile + 1), value);
  }
}

TEST(MortonCode, TakesTheBitsOfBothAxesInTurn) {
  EXPECT_EQ(morton_code(0, 0), 0u);
  EXPECT_EQ(morton_code(1, 0), 1u);
  EXPECT_EQ(morton_code(0, 1), 2u);
  EXPECT_EQ(morton_code(3, 5), 0b100111u);
  EXPECT_EQ(morton_code(0xffffffffu, 0xffffffffu), ~std::uint64_t{0});
}

class PlanTiles : public ::testing::Test {
 protected:
  void SetUp() override {
    const RoadCloud cloud = test::made_survey(300.0, 1.0);
    write_cloud(test::strip_of(cloud, 0.0, 170.0), path("west.laz"));
    RoadCloud east = test::strip_of(cloud, 170.0, 400.0);
    write_cloud(east, path("east.las"));
    points_ = cloud.size();
    options_.side = 100.0;
  }
  std::string path(const std::string& name) const { return folder_.path() / name; }
  std::vector<fs::path> inputs() const { return {path("west.laz"), path("east.las")}; }
  TilePlan plan(const std::string& name) const {
    return plan_tiles(inputs(), path(name), options_);
  }
  template <typename E>
  std::string failure(const std::vector<fs::path>& files, const std::string& name) const {
    try {
      plan_tiles(files, path(name), options_);
    } catch (const E& error) {
      return error.what();
    }
    return "no such error";
  }

  test::TemporaryFolder folder_;
  TilePlanOptions options_;
  std::size_t points_ = 0;
};

TEST_F(PlanTiles, EveryPointIsInOneTile) {
  const TilePlan made = plan("plan");
  EXPECT_EQ(made.tiles.size(), 9u);
  EXPECT_EQ(made.points, points_);
  std::set<int> ids;
  std::size_t read = 0;
  for (std::size_t k = 0; k < made.tiles.size(); ++k) {
    const Tile& tile = made.tiles[k];
    const CloudFile file = read_cloud_file(made.path_of(k));
    EXPECT_EQ(file.cloud.size(), tile.points);
    read += file.cloud.size();
    for (std::size_t i = 0; i < file.cloud.size(); ++i) {
      const Eigen::Vector3d p = file.cloud.origin + file.cloud.points[i].cast<double>();
      ids.insert(file.cloud.labels.at("id")[i]);
      // To the nearest float.
      EXPECT_TRUE(tile.bounds.contains(p) || tile.bounds.exteriorDistance(p) < 1e-3);
    }
    ASSERT_TRUE(tile.square.has_value());
    EXPECT_TRUE(tile.square->contains(tile.bounds.min().x(), tile.bounds.min().y()));
    EXPECT_TRUE(tile.square->contains(tile.bounds.max().x(), tile.bounds.max().y()));
    EXPECT_DOUBLE_EQ(tile.square->x1 - tile.square->x0, 100.0);
    std::uint64_t in_parts = 0;
    for (const TilePart& part : read_tile_parts(made, k)) in_parts += part.points;
    EXPECT_EQ(in_parts, tile.points);
  }
  EXPECT_EQ(read, points_);
  EXPECT_EQ(ids.size(), points_);
  EXPECT_FALSE(fs::exists(path("plan/.work")));
}

TEST_F(PlanTiles, FilesHangOnNeitherThreadsNorMemoryNorInterruptions) {
  plan("plan");
  const auto files = test::files_below(path("plan"));
  options_.num_threads = 1;
  options_.memory = 100000;  // many flushes
  for (const double stop : {0.2, 0.5, 0.8}) {
    for (const char* const stage : {"read", "write"}) {
      const std::string name = stage + std::to_string(stop);
      const auto interrupt = [&](const std::string& now, double share) {
        if (now == stage && share > stop) throw InterruptedError();
      };
      EXPECT_THROW(plan_tiles(inputs(), path(name), options_, interrupt), InterruptedError);
      EXPECT_TRUE(fs::exists(path(name + "/.work/state.json")));
      plan(name);
      EXPECT_EQ(test::files_below(path(name)), files) << name;
    }
  }
  // What a killed run had written beyond what it noted goes away.
  const auto late = [](const std::string&, double share) {
    if (share > 0.6) throw InterruptedError();
  };
  EXPECT_THROW(plan_tiles(inputs(), path("cut"), options_, late), InterruptedError);
  for (const auto& entry : fs::directory_iterator(path("cut/.work/spills"))) {
    std::ofstream(entry.path(), std::ios::app) << "half a record";
  }
  plan("cut");
  EXPECT_EQ(test::files_below(path("cut")), files);
}

TEST_F(PlanTiles, ACompletePlanStays) {
  const std::string hash = plan("plan").hash;
  const auto before = fs::last_write_time(path("plan/index.json"));
  EXPECT_EQ(plan("plan").hash, hash);
  EXPECT_EQ(fs::last_write_time(path("plan/index.json")), before);
  options_.side = 150.0;
  EXPECT_THAT(failure<UsageError>(inputs(), "plan"), HasSubstr("another value of 'tile' (100.0)"));
  options_.overwrite = true;
  EXPECT_NE(plan("plan").hash, hash);
  EXPECT_EQ(read_tile_plan(path("plan")).tiles.size(), 4u);
}

TEST_F(PlanTiles, RefusesWhatIsNoCloudOfOneKind) {
  EXPECT_THAT(failure<InputError>({path("west.laz"), path("gone.laz")}, "a"),
              HasSubstr("gone.laz"));
  write_cloud(test::made_survey(20.0, 1.0), path("cloud.ply"));
  EXPECT_THAT(failure<InputError>({path("cloud.ply")}, "b"), HasSubstr("expected LAS, LAZ"));
  RoadCloud other = test::made_survey(20.0, 1.0);
  other.labels.erase("id");
  write_cloud(other, path("other.laz"));
  EXPECT_THAT(failure<InputError>({path("other.laz"), path("west.laz")}, "c"),
              HasSubstr("expected format"));
  options_.crs = coordinate_system_from_epsg(32631);
  const TilePlan with_crs = plan("with_crs");
  EXPECT_THAT(with_crs.crs, HasSubstr("UTM"));
  options_.crs.reset();
  EXPECT_THAT(failure<InputError>({with_crs.path_of(0), path("west.laz")}, "d"),
              ::testing::AllOf(HasSubstr("EPSG:32631"), HasSubstr("expected none")));
  // Cut in the middle of its points: nothing is left of the plan.
  std::string bytes = test::files_below(folder_.path())["west.laz"];
  bytes.resize(bytes.size() / 2);
  std::ofstream(path("cut.laz"), std::ios::binary) << bytes;
  EXPECT_THAT(failure<InputError>({path("cut.laz"), path("east.las")}, "e"), HasSubstr("cut.laz"));
  EXPECT_FALSE(fs::exists(path("e")));
  EXPECT_THROW(read_tile_plan(path("e")), InputError);
  fs::create_directories(path("full"));
  std::ofstream(path("full/notes.txt")) << "mine";
  EXPECT_THAT(failure<OutputError>(inputs(), "full"), HasSubstr("not a plan of tiles"));
}

TEST_F(PlanTiles, OtherGridsAreMovedOntoTheFirstOne) {
  RoadCloud cloud = test::strip_of(test::made_survey(300.0, 1.0), 170.0, 400.0);
  for (Eigen::Vector3f& p : cloud.points) p -= Eigen::Vector3f(1000.0f, 2000.0f, 100.0f);
  cloud.origin += Eigen::Vector3d(1000.0, 2000.0, 100.0);
  write_cloud(cloud, path("moved.las"));
  const TilePlan made = plan_tiles({path("moved.las"), path("west.laz")}, path("plan"), options_);
  EXPECT_EQ(made.tiles.size(), 9u);
  EXPECT_EQ(made.points, points_);
}

TEST_F(PlanTiles, PartsOfTilesAreReadAlone) {
  options_.side = 0.0;  // one tile
  RoadCloud cloud = test::made_survey(300.0, 6.0);
  write_cloud(cloud, path("dense.laz"));
  write_cloud(test::made_survey(20.0, 1.0), path("small.laz"));
  options_.in_place = true;
  RoadCloud far = test::made_survey(20.0, 1.0);
  far.origin += Eigen::Vector3d(-40.0, 0.0, 0.0);
  write_cloud(far, path("far.laz"));
  const TilePlan sorted = [&] {
    TilePlanOptions one;
    one.side = 1000.0;
    return plan_tiles({path("dense.laz")}, path("sorted"), one);
  }();
  ASSERT_EQ(sorted.tiles.size(), 1u);
  const TilePlan made = plan_tiles({sorted.path_of(0), path("far.laz")}, path("plan"), options_);
  TileReading reading;
  reading.halo = 60.0;
  const std::size_t far_tile = made.tiles[0].name == "far" ? 0 : 1;
  const TilePoints points = read_tile_points(made, far_tile, reading);
  std::size_t around = 0;
  for (const std::int32_t own : points.own) around += own < 0 ? 1 : 0;
  // Within 40 m in x and 80 m in y of the dense corner; some of its ten chunks are not read.
  EXPECT_GT(around, 10000u);
  EXPECT_LT(points.read_points, points.own_points + cloud.size() / 2);
}

}  // namespace
}  // namespace camber
