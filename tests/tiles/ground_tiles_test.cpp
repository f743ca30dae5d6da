// The ground of tiles is that of the whole.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>
#include <numeric>

#include "camber/cloud/cloud_io.h"
#include "camber/core/errors.h"
#include "camber/core/hash.h"
#include "camber/tiles/detail/kept_parts.h"
#include "camber/tiles/ground_tile.h"
#include "camber/tiles/plan_tiles.h"
#include "camber/tiles/tile_job.h"
#include "camber/tiles/tile_points.h"
#include "support/test_data.h"
#include "tiles/made_survey.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

using ::testing::HasSubstr;

std::vector<fs::path> result_files(const TilePlan& plan) {
  std::vector<fs::path> out;
  for (const Tile& tile : plan.tiles) {
    out.push_back(job_folder(plan, TileJob()) / (tile.name + ".laz"));
  }
  return out;
}

TileDone run_ground(const TilePlan& plan, std::size_t tile, int threads) {
  TileJob job;
  job.num_threads = threads;
  begin_tile_job(plan, job);
  return run_tile_job(plan, job, tile);
}

std::size_t differing(const std::map<int, std::vector<int>>& a,
                      const std::map<int, std::vector<int>>& b) {
  std::size_t count = a.size() == b.size() ? 0 : 1;
  for (const auto& [id, classes] : a) {
    const auto other = b.find(id);
    count += other == b.end() || other->second != classes ? 1 : 0;
  }
  return count;
}

/// The classes that a whole cloud gets by a plan.
std::map<int, std::vector<int>> classes_of_whole(const TilePlan& plan, const RoadCloud& cloud,
                                                 const fs::path& file) {
  const TileGround whole = segment_whole_ground(plan, file, 0);
  std::map<int, std::vector<int>> out;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    int& kind = out[cloud.labels.at("id")[i]].emplace_back(cloud.labels.at("classification")[i]);
    if (whole.labels[i] == 1) kind = 2;
    if (whole.labels[i] == 0 && (kind == 0 || kind == 2)) kind = 1;
  }
  return out;
}

TEST(GroundOfTiles, IsThatOfTheWhole) {
  const test::TemporaryFolder folder;
  // From the air one has to look 190 m around, in streets 104 m.
  for (const double density : {1.4, 7.0}) {
    const RoadCloud cloud = test::made_survey(density < 4.0 ? 850.0 : 380.0, density);
    const fs::path whole = folder.path() / "whole.laz";
    write_cloud(cloud, whole);
    std::map<int, std::vector<int>> truth;
    for (const double side : {190.0, 333.0}) {
      TilePlanOptions options;
      options.side = side;
      options.origin = {17.0, side / 3.0};
      if (density > 4.0) options.ground.largest_object = 12.0;
      options.overwrite = true;
      options.num_threads = side < 200.0 ? 1 : 2;
      TilePlan plan = plan_tiles({whole}, folder.path() / "plan", options);
      ASSERT_TRUE(plan.ground.has_value()) << plan.ground_reason;
      EXPECT_TRUE(plan.ground->from_air);
      EXPECT_GT(plan.tiles.size(), 3u);
      truth = classes_of_whole(plan, cloud, whole);
      std::size_t ground = 0;
      for (const auto& [id, classes] : truth) ground += classes[0] == 2 ? 1 : 0;
      EXPECT_GT(ground, cloud.size() / 2);
      for (std::size_t k = plan.tiles.size(); k-- > 0;) {
        run_ground(plan, k, k % 2 == 0 ? 1 : 2);
      }
      EXPECT_EQ(differing(truth, test::classes_by_id(result_files(plan))), 0u) << side;
    }
  }
}

class TilesOfGround : public ::testing::Test {
 protected:
  void SetUp() override {
    cloud_ = test::made_survey(400.0, 1.0);
    write_cloud(cloud_, folder_.path() / "whole.laz");
    TilePlanOptions options;
    options.side = 150.0;
    options.ground.largest_object = 10.0;
    plan_ = plan_tiles({folder_.path() / "whole.laz"}, folder_.path() / "plan", options);
  }
  test::TemporaryFolder folder_;
  RoadCloud cloud_;
  TilePlan plan_;
};

TEST_F(TilesOfGround, WithoutTheirSurroundingsTheyAreAnsweredOtherwise) {
  TileReading reading;
  reading.classes = true;
  reading.alignment = plan_.ground->alignment();
  GroundOptions options;
  options.plan = plan_.ground;
  std::size_t different = 0;
  for (std::size_t k = 0; k < plan_.tiles.size(); ++k) {
    const TileGround right = segment_tile_ground(plan_, k, 0);
    const TilePoints alone = read_tile_points(plan_, k, reading);
    const GroundSegmentation wrong = segment_ground(alone.cloud, options);
    for (std::size_t i = 0; i < alone.own.size(); ++i) {
      const int label = right.labels[static_cast<std::size_t>(alone.own[i])];
      different += label >= 0 && label != wrong.labels[i] ? 1 : 0;
    }
  }
  EXPECT_GT(different, 10u);
}

TEST_F(TilesOfGround, ShardsAndRepetitionsGiveTheSameFiles) {
  for (std::size_t k = 0; k < plan_.tiles.size(); ++k) {
    EXPECT_FALSE(run_ground(plan_, k, 2).was_there);
  }
  const JoinedTiles joined = join_tiles(plan_, TileJob());
  EXPECT_EQ(joined.points, cloud_.size());
  EXPECT_GT(joined.counts.at("ground"), cloud_.size() / 2);
  const auto files = test::files_below(job_folder(plan_, TileJob()));
  EXPECT_EQ(files.size(), 2 * plan_.tiles.size() + 2);
  for (std::size_t k = 0; k < plan_.tiles.size(); ++k) {
    EXPECT_TRUE(run_ground(plan_, k, 1).was_there);
  }
  fs::remove_all(job_folder(plan_, TileJob()));
  std::vector<std::size_t> seen;
  std::uint64_t largest = 0;
  for (const Tile& tile : plan_.tiles) largest = std::max(largest, tile.points);
  for (const std::size_t shard : {4, 1, 3, 2}) {
    std::uint64_t points = 0;
    for (const std::size_t k : tiles_of_shard(plan_, shard, 4)) {
      run_ground(plan_, k, 1);
      seen.push_back(k);
      points += plan_.tiles[k].points;
    }
    // No more than a quarter, but for half a tile at each end.
    EXPECT_LE(points, plan_.points / 4 + largest);
  }
  std::sort(seen.begin(), seen.end());
  EXPECT_EQ(seen.size(), plan_.tiles.size());
  EXPECT_EQ(std::unique(seen.begin(), seen.end()), seen.end());
  join_tiles(plan_, TileJob());
  EXPECT_EQ(test::files_below(job_folder(plan_, TileJob())), files);
}

TEST_F(TilesOfGround, WhatIsMissingOrDamagedIsNamed) {
  run_ground(plan_, 0, 1);
  try {
    join_tiles(plan_, TileJob());
    FAIL();
  } catch (const NoAnswerError& error) {
    EXPECT_THAT(error.what(),
                HasSubstr("8 of 9 tiles are not done, the first is " + plan_.tiles[1].name));
  }
  // A tile of another content, then of another size, then none.
  const fs::path path = plan_.path_of(4);
  const auto names = [&](std::size_t tile, const char* part) {
    try {
      run_ground(plan_, tile, 1);
      FAIL();
    } catch (const InputError& error) {
      EXPECT_THAT(error.what(), HasSubstr(path.filename().string()));
      EXPECT_THAT(error.what(), HasSubstr(part));
    }
  };
  {
    std::fstream file(path, std::ios::in | std::ios::out | std::ios::binary);
    file.seekp(90);
    file.put('x');
  }
  names(4, "other content");
  std::ofstream(path, std::ios::app) << "more";
  names(4, "bytes");
  names(3, "bytes");  // its neighbour
  fs::remove(path);
  names(3, "No such file");
}

/// Tiles of two parts.
class RowsOfTiles : public ::testing::Test {
 protected:
  void SetUp() override {
    write_cloud(test::made_survey(200.0, 9.0), folder_.path() / "whole.laz");
    TilePlanOptions options;
    options.side = 100.0;
    options.ground.largest_object = 5.0;
    plan_ = plan_tiles({folder_.path() / "whole.laz"}, folder_.path() / "plan", options);
    ASSERT_GT(plan_.tiles.size(), 3u);
  }

  TileJob job(TileJob::Kind kind, const std::string& name) const {
    TileJob out;
    out.kind = kind;
    out.folder = folder_.path() / name;
    return out;
  }

  test::TemporaryFolder folder_;
  TilePlan plan_;
};

TEST_F(RowsOfTiles, DecodeLessThanTilesAloneWithEqualResults) {
  for (const TileJob::Kind kind : {TileJob::Kind::kGround, TileJob::Kind::kPatches}) {
    const std::string name = to_string(kind);
    const TileJob apart = job(kind, name + "_apart"), row = job(kind, name + "_row");
    begin_tile_job(plan_, apart);
    std::uint64_t read = 0;
    std::map<std::string, std::string> expected;
    for (std::size_t k = 0; k < plan_.tiles.size(); ++k) {
      const TileDone done = run_tile_job(plan_, apart, k);
      read += done.read_points;
      expected[done.file.string()] = done.hash;
    }
    // Any order gives the same; a tile is there already.
    std::vector<std::size_t> order(plan_.tiles.size());
    std::iota(order.begin(), order.end(), std::size_t{0});
    if (kind == TileJob::Kind::kPatches) std::reverse(order.begin(), order.end());
    begin_tile_job(plan_, row);
    const TileDone first = run_tile_job(plan_, row, 1);
    const TilesRun run = run_tile_job(plan_, row, order);
    EXPECT_EQ(run.points_answered, plan_.points - plan_.tiles[1].points);
    EXPECT_LT(first.read_points + run.points_read, read - 50000) << name;
    for (const auto& [file, hash] : expected) {
      EXPECT_EQ(hash_file(row.folder / file), hash) << file;
    }
  }
}

TEST_F(RowsOfTiles, HoldAPartOfTheTileBeforeAlone) {
  detail::KeptParts kept;
  TileReading reading;
  reading.halo = 30.0;
  reading.kept = &kept;
  kept.set_next(1);
  const TilePoints first = read_tile_points(plan_, 0, reading);
  kept.set_next(plan_.tiles.size());
  const TilePoints second = read_tile_points(plan_, 1, reading);
  EXPECT_GE(first.read_points, plan_.tiles[0].points);
  reading.kept = nullptr;
  const TilePoints alone = read_tile_points(plan_, 1, reading);
  EXPECT_LT(second.read_points, alone.read_points);
  EXPECT_EQ(second.cloud.points, alone.cloud.points);
  EXPECT_EQ(second.own_points, alone.own_points);
  // What nobody asks for next is not held.
  for (std::size_t k = 0; k < plan_.tiles.size(); ++k) {
    for (std::size_t part = 0; part < 100; ++part) EXPECT_EQ(kept.find({k, part}), nullptr);
  }
}

TEST(GroundInPlace, AnswersEveryFileWithItsNeighbours) {
  const test::TemporaryFolder folder;
  const RoadCloud cloud = test::made_survey(420.0, 1.0);
  const fs::path whole = folder.path() / "whole.laz";
  write_cloud(cloud, whole);
  // 20 m stand in both.
  const fs::path west = folder.path() / "west.laz", east = folder.path() / "east.las";
  write_cloud(test::strip_of(cloud, 0.0, 220.0), west);
  write_cloud(test::strip_of(cloud, 200.0, 500.0), east);
  TilePlanOptions options;
  options.in_place = true;
  options.ground.largest_object = 10.0;
  const TilePlan plan = plan_tiles({west, east}, folder.path() / "plan", options);
  ASSERT_EQ(plan.tiles.size(), 2u);
  EXPECT_EQ(plan.tiles[0].name, "east");
  for (std::size_t k = 0; k < 2; ++k) run_ground(plan, k, 1);
  const auto found = test::classes_by_id(result_files(plan));
  EXPECT_EQ(found.size(), cloud.size());
  // The whole has those points twice, as well.
  std::vector<int> twice;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    twice.push_back(static_cast<int>(i));
    const float x = cloud.points[i].x();
    if (x >= 200.0f && x < 220.0f) twice.push_back(static_cast<int>(i));
  }
  const RoadCloud both = cloud.select(twice);
  write_cloud(both, whole);
  EXPECT_EQ(differing(classes_of_whole(plan, both, whole), found), 0u);
}

}  // namespace
}  // namespace camber
