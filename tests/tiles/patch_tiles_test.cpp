// The patches of tiles are those of the whole.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

#include "camber/cloud/cloud_io.h"
#include "camber/core/errors.h"
#include "camber/road/fit_road_surface.h"
#include "camber/tiles/plan_tiles.h"
#include "camber/tiles/tile_job.h"
#include "support/test_data.h"
#include "tiles/made_survey.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

using ::testing::HasSubstr;

class PatchesOfTiles : public ::testing::Test {
 protected:
  void SetUp() override {
    RoadCloud survey = test::made_survey(290.0, 4.0);
    // In whole millimetres, as surveys are; of finer ones the floats of a cloud lose the last bits.
    for (Eigen::Vector3f& p : survey.points) {
      p = ((1000.0 * p.cast<double>()).array().round() / 1000.0).matrix().cast<float>();
    }
    write_cloud(survey, folder_.path() / "whole.laz");
  }

  TilePlan plan(double side, double origin) const {
    TilePlanOptions options;
    options.side = side;
    options.origin = {origin, origin / 2.0};
    options.overwrite = true;
    return plan_tiles({folder_.path() / "whole.laz"}, folder_.path() / "plan", options);
  }

  static TileJob patches_job(int threads) {
    TileJob job;
    job.kind = TileJob::Kind::kPatches;
    job.num_threads = threads;
    return job;
  }

  /// All of it; tiles from the last to the first.
  static JoinedSurface run(const TilePlan& plan, int threads) {
    TileJob job = patches_job(threads);
    begin_tile_job(plan, job);
    for (std::size_t k = plan.tiles.size(); k-- > 0;) run_tile_job(plan, job, k);
    JoinedSurface out = join_patches(plan, job);
    job.kind = TileJob::Kind::kLabels;
    begin_tile_job(plan, job);
    for (std::size_t k = 0; k < plan.tiles.size(); ++k) run_tile_job(plan, job, k);
    join_tiles(plan, job);
    return out;
  }

  /// Patches of points by their ids.
  static std::map<int, int> labels_of(const TilePlan& plan) {
    std::map<int, int> out;
    for (const JoinedFile& file : joined_files(plan.folder / "labels")) {
      const RoadCloud cloud = read_cloud(file.path);
      for (std::size_t i = 0; i < cloud.size(); ++i) {
        out[cloud.labels.at("id")[i]] = cloud.labels.at("patch")[i];
      }
    }
    return out;
  }

  test::TemporaryFolder folder_;
};

TEST_F(PatchesOfTiles, AreThoseOfTheWhole) {
  const RoadCloud cloud = read_cloud(folder_.path() / "whole.laz");
  ASSERT_GT(cloud.size(), 262144u);
  const RoadSurfaceFit whole = fit_road_surface(cloud, {});
  ASSERT_EQ(whole.status, Status::kOk) << whole.reason;
  EXPECT_GT(whole.surface.patches.size(), 50u);
  for (const double origin : {0.0, 17.0}) {
    const TilePlan tiles = plan(170.0, origin);
    EXPECT_GT(tiles.tiles.size(), 3u);
    const JoinedSurface joined = run(tiles, origin > 0.0 ? 1 : 2);
    EXPECT_EQ(joined.points, cloud.size());
    const std::map<int, int> labels = labels_of(tiles);
    std::size_t differing = labels.size() == cloud.size() ? 0 : 1, on_patches = 0;
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      const auto found = labels.find(cloud.labels.at("id")[i]);
      differing += found == labels.end() || found->second != whole.labels[i] ? 1 : 0;
      on_patches += whole.labels[i] >= 0 ? 1 : 0;
    }
    EXPECT_GT(on_patches, cloud.size() / 2);
    EXPECT_EQ(differing, 0u) << origin;
    const std::vector<PlanePatch>&there = joined.patches.fit.surface.patches,
          &here = whole.surface.patches;
    ASSERT_EQ(there.size(), here.size());
    for (std::size_t k = 0; k < here.size(); ++k) {
      EXPECT_EQ(there[k].plane.plane.normal, here[k].plane.plane.normal) << k;
      EXPECT_EQ(there[k].plane.plane.offset, here[k].plane.plane.offset) << k;
      EXPECT_EQ(there[k].plane.covariance, here[k].plane.covariance) << k;
      EXPECT_EQ(there[k].kind, here[k].kind) << k;
      EXPECT_EQ(there[k].unmodelled_sigma, here[k].unmodelled_sigma) << k;
    }
  }
}

TEST_F(PatchesOfTiles, WhatIsMissingOrDamagedIsNamed) {
  const TilePlan tiles = plan(170.0, 0.0);
  const TileJob job = patches_job(0);
  begin_tile_job(tiles, job);
  run_tile_job(tiles, job, 1);
  try {
    join_patches(tiles, job);
    FAIL();
  } catch (const NoAnswerError& error) {
    EXPECT_THAT(error.what(), HasSubstr(tiles.tiles.front().name));
  }
  for (std::size_t k = 0; k < tiles.tiles.size(); ++k) run_tile_job(tiles, job, k);
  const fs::path file = job_folder(tiles, job) / (tiles.tiles.front().name + ".patches");
  std::string bytes;
  {
    std::ifstream in(file, std::ios::binary);
    bytes.assign(std::istreambuf_iterator<char>(in), {});
  }
  // Whatever byte is wrong or missing, the reader says so or reads numbers; it never reads beyond.
  const fs::path damaged = folder_.path() / "damaged.patches";
  std::size_t refused = 0;
  for (std::size_t cut = 0; cut < bytes.size(); cut += 1 + bytes.size() / 40) {
    std::ofstream(damaged, std::ios::binary) << bytes.substr(0, cut);
    try {
      join_tile_patches({damaged}, {});
    } catch (const InputError& error) {
      EXPECT_THAT(error.what(), HasSubstr("damaged.patches"));
      ++refused;
    }
  }
  EXPECT_GE(refused, 40u);
  std::ofstream(file, std::ios::binary | std::ios::in).seekp(40) << "damaged";
  EXPECT_THROW(join_patches(tiles, job), InputError);
}

}  // namespace
}  // namespace camber
