#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>

#include "camber/core/errors.h"
#include "camber/import/detail/own_data.h"
#include "support/test_data.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

using Eigen::Vector3d;
using ::testing::HasSubstr;

constexpr double kDegree = M_PI / 180.0;

/// A map whose metres are plain to compute with, turned by 0.1 rad against true north.
std::vector<MapPlace> plain_map(const std::string&, const std::vector<GeoPoint>& points) {
  std::vector<MapPlace> out;
  for (const GeoPoint& p : points) out.push_back({1e5 * p.longitude, 1e5 * p.latitude, 0.1});
  return out;
}

class Gnss : public ::testing::Test {
 protected:
  Gnss() {
    for (int i = 0; i < 4; ++i) {
      SceneFrame frame;
      frame.id = 10 + i;
      frame.time_s = 100.0 + 0.5 * i;
      import_.scene.frames.push_back(frame);
    }
    options_.file = folder_.path() / "log";
    options_.projection = plain_map;
  }
  const MapPosition& at(std::size_t i) const { return *import_.scene.frames[i].map_position; }
  void put(const std::string& text, const char* name = "log") {
    options_.file = folder_.path() / name;
    std::ofstream(options_.file) << text;
    put_gnss(import_.scene, options_, import_);
  }

  test::TemporaryFolder folder_;
  OwnImport import_;
  GnssOptions options_;
};

TEST_F(Gnss, TablesByTimeAreInterpolated) {
  options_.offset = "1000";
  options_.antenna = {0, -1, 0};
  put("time,latitude,longitude,altitude,sigma\n"
      "-900,49.00001,8.00001,100,0.5\n"
      "-899,49.00002,8.00003,102,0.7\n");
  EXPECT_EQ(import_.scene.map_crs, "EPSG:32632");
  EXPECT_EQ(import_.scene.antenna, Vector3d(0, -1, 0));
  EXPECT_LT((at(0).position - Vector3d(800001, 4900001, 100)).norm(), 1e-6);
  EXPECT_LT((at(1).position - Vector3d(800002, 4900001.5, 101)).norm(), 1e-6);
  EXPECT_DOUBLE_EQ(at(1).sigma, 0.7);
  EXPECT_FALSE(at(1).heading);
  EXPECT_TRUE(import_.scene.frames[2].map_position);
  EXPECT_FALSE(import_.scene.frames[3].map_position);  // beyond the log
}

TEST_F(Gnss, TablesByFrame) {
  options_.sigma = 1.25;
  options_.crs = "EPSG:25833";
  put("frame,lat,lon\n11,49.1,8.1\n12,49.2,8.2\n");
  EXPECT_EQ(import_.scene.map_crs, "EPSG:25833");
  EXPECT_FALSE(import_.scene.frames[0].map_position);
  EXPECT_LT((at(1).position.head<2>() - Eigen::Vector2d(810000, 4910000)).norm(), 1e-6);
  EXPECT_TRUE(std::isnan(at(1).position.z()));
  EXPECT_DOUBLE_EQ(at(2).sigma, 1.25);
}

TEST_F(Gnss, GpxFromItsFirstPoint) {
  options_.offset = "first";
  put("<gpx version=\"1.1\"><trk><trkseg>"
      "<trkpt lat=\"49\" lon=\"8\"><ele>5</ele><time>2020-01-01T00:00:00Z</time></trkpt>"
      "<trkpt lat=\"49.001\" lon=\"8\"><ele>7</ele><time>2020-01-01T00:00:02Z</time></trkpt>"
      "</trkseg></trk></gpx>");
  EXPECT_LT((at(3).position - Vector3d(800000, 4900075, 6.5)).norm(), 1e-6);
}

TEST_F(Gnss, OxtsHasHeadingsAgainstTheMapsNorth) {
  std::string row = "49.01 8.43 112.8 0.02 0.01 0.5";
  for (int i = 6; i < 30; ++i) row += i == 23 ? " 0.25" : " 0";
  std::string rows;
  for (int i = 0; i < 12; ++i) rows += row + "\n";
  put(rows, "oxts.txt");
  EXPECT_FALSE(import_.scene.frames[2].map_position);  // rows are frames 0 to 11
  EXPECT_DOUBLE_EQ(at(0).sigma, 0.25);
  ASSERT_TRUE(at(0).heading);
  EXPECT_NEAR(*at(0).heading, 0.5 + 0.1, 1e-12);
  EXPECT_LT((at(1).position - Vector3d(843000, 4901000, 112.8)).norm(), 1e-6);
}

TEST_F(Gnss, Refusals) {
  EXPECT_THROW(put("time,latitude,longitude\n1,49,8\n2,49,8\n"), InputError);  // other times
  EXPECT_THROW(put("frame,latitude,longitude\n1,49,8\n2,49,8\n"), InputError);
  EXPECT_THROW(put("latitude,longitude\n49,8\n49,8\n"), InputError);
  EXPECT_THROW(put("frame,latitude,longitude,sigma\n10,49,8,-1\n"), InputError);
  options_.offset = "soon";
  EXPECT_THROW(put("time,latitude,longitude\n100,49,8\n102,49,8\n"), UsageError);
}

TEST_F(Gnss, StandsInTheManifest) {
  put("frame,lat,lon\n10,49.1,8.1\n13,49.2,8.2\n");
  Scene& scene = import_.scene;
  scene.camera = {64, 48, 50, 50, 32, 24};
  scene.frames[0].map_position->heading = 0.25;
  write_scene(scene, folder_.path() / "scene.json");
  const Scene back = read_scene(folder_.path());
  EXPECT_EQ(back.map_crs, scene.map_crs);
  ASSERT_TRUE(back.frames[0].map_position);
  EXPECT_EQ(back.frames[0].map_position->position.head<2>(), at(0).position.head<2>());
  EXPECT_TRUE(std::isnan(back.frames[0].map_position->position.z()));
  EXPECT_NEAR(*back.frames[0].map_position->heading, 0.25, 1e-12);
  EXPECT_FALSE(back.frames[1].map_position);
}

}  // namespace
}  // namespace camber
