// A surface in tiles: what a window of it has is what the whole has there.

#include "camber/scene/surface_tiles.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include "camber/core/errors.h"
#include "camber/scene/results.h"
#include "support/test_data.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

using Eigen::AlignedBox2d;
using Eigen::Vector2d;
using ::testing::HasSubstr;

/// Eight by eight squares of 9 m, linked to their neighbours in x.
RoadSurface field() {
  RoadSurface out;
  out.frame = "z-up";
  out.up = Eigen::Vector3d::UnitZ();
  out.level = RoadSurface::Level::kGravity;
  for (int i = 0; i < 64; ++i) {
    const double x = 10.0 * (i % 8), y = 10.0 * (i / 8), z = 0.1 * i;
    PlanePatch patch;
    patch.id = i;
    patch.plane.plane = {Eigen::Vector3d::UnitZ(), -z};
    patch.plane.centroid = {x + 4.5, y + 4.5, z};
    patch.inliers = 50 + i;
    for (const auto& [u, v] : {std::pair(0.0, 0.0), {9.0, 0.0}, {9.0, 9.0}, {0.0, 9.0}}) {
      patch.boundary.emplace_back(x + u, y + v, z);
    }
    out.patches.push_back(patch);
    if (i % 8 == 0) continue;
    PatchLink link;
    link.a = i - 1;
    link.b = i;
    link.height_step = 0.1;
    out.links.push_back(link);
  }
  return out;
}

/// Squares of 25 m; the upper rows of patches lie beside them.
std::vector<SurfaceTileSquare> squares() {
  std::vector<SurfaceTileSquare> out;
  for (int k = 0; k < 6; ++k) {
    const Vector2d low(25.0 * (k % 3), 25.0 * (k / 3));
    out.push_back({"tile" + std::to_string(k), {low, low + Vector2d(25.0, 25.0)}});
  }
  return out;
}

class SurfaceTiles : public ::testing::Test {
 protected:
  void SetUp() override {
    write_json(to_json(field()), folder_.path() / "surface.json");
    whole_ = read_surface(folder_.path() / "surface.json");
    EXPECT_FALSE(has_surface_tiles(folder_.path()));
    write_surface_tiles(whole_, squares(), folder_.path());
    EXPECT_TRUE(has_surface_tiles(folder_.path()));
  }
  test::TemporaryFolder folder_;
  RoadSurface whole_;
};

TEST_F(SurfaceTiles, AllOfThemAreTheWhole) {
  const auto all = read_surface_within(folder_.path(), {Vector2d(-1, -1), Vector2d(100, 100)});
  EXPECT_EQ(to_json(all), to_json(whole_));
  std::size_t patches = 0;
  double highest = 0.0;
  for (const SurfaceTile& tile : read_surface_tiles(folder_.path())) {
    EXPECT_EQ(read_surface(tile.file).patches.size(), tile.patches);
    patches += tile.patches;
    highest = std::max(highest, tile.heights[1]);
  }
  EXPECT_EQ(patches, 64u);
  EXPECT_DOUBLE_EQ(highest, 6.3);
}

TEST_F(SurfaceTiles, AWindowHasThePatchesThatReachIntoIt) {
  // Across the tiles' border at 25 m; files of other tiles are not opened.
  fs::remove(folder_.path() / "surface" / "tile5.json");
  const AlignedBox2d window(Vector2d(18.0, 21.0), Vector2d(33.0, 28.0));
  const RoadSurface found = read_surface_within(folder_.path(), window);
  std::vector<int> ids;
  for (const PlanePatch& patch : found.patches) ids.push_back(patch.id);
  EXPECT_THAT(ids, ::testing::ElementsAre(17, 18, 19));
  ASSERT_EQ(found.links.size(), 2u);
  EXPECT_EQ(found.links[0].a, 17);
  EXPECT_EQ(found.links[1].b, 19);
  EXPECT_EQ(found.query({25.0, 25.0, 0.0}).patch, whole_.query({25.0, 25.0, 0.0}).patch);
  const auto beside = read_surface_within(folder_.path(), {Vector2d(-9, -9), Vector2d(-5, -5)});
  EXPECT_TRUE(beside.patches.empty());
  EXPECT_EQ(beside.frame, "z-up");
}

TEST_F(SurfaceTiles, OtherTilesReplaceThem) {
  write_surface_tiles(whole_, {{"one", {Vector2d(0, 0), Vector2d(80, 80)}}}, folder_.path());
  EXPECT_FALSE(fs::exists(folder_.path() / "surface" / "tile0.json"));
  EXPECT_EQ(read_surface_tiles(folder_.path()).size(), 1u);
  EXPECT_THROW(write_surface_tiles(whole_, {}, folder_.path()), std::invalid_argument);
}

TEST_F(SurfaceTiles, WhatIsMissingOrDamagedIsNamed) {
  const AlignedBox2d all(Vector2d(0, 0), Vector2d(80, 80));
  fs::remove(folder_.path() / "surface" / "tile1.json");
  try {
    read_surface_within(folder_.path(), all);
    FAIL();
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), HasSubstr("tile1.json"));
  }
  std::ofstream(folder_.path() / "surface" / "index.json")
      << R"({"format": "camber-surface-tiles", "patches": [], "tiles": [{"file": "a.json",
             "patches": 1, "bounds": [0, 1], "heights": [0, 1]}]})";
  try {
    read_surface_within(folder_.path(), all);
    FAIL();
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), HasSubstr("tiles[0].bounds"));
  }
}

}  // namespace
}  // namespace camber
