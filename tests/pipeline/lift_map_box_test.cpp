// Boxes of nuScenes and Argoverse 2 on the ground.

#include "camber/pipeline/lift_map_box.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>

#include "camber/cloud/cloud_io.h"
#include "camber/core/errors.h"
#include "camber/export/plan_frame.h"
#include "support/test_data.h"

namespace camber {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using ::testing::HasSubstr;

/// A hill of 10 % to the east and 5 % across.
class Hill : public HeightSource {
 public:
  GroundSample at(const Eigen::Vector3d& place) const override {
    GroundSample out;
    if (place.x() > 100.0) return out;
    out.height = 0.1 * place.x() + 0.05 * place.y();
    out.sigma = place.x() > 50.0 ? 0.3 : 0.02;
    out.normal = Eigen::Vector3d(-0.1, -0.05, 1.0).normalized();
    return out;
  }
  double resolution() const override { return 0.1; }
};

MapBox box_at(double x, double y, double bottom, double yaw) {
  MapBox box;
  box.length = 4.0;
  box.width = 1.8;
  box.height = 1.5;
  box.center = {x, y, bottom + 0.75};
  box.rotation = Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ());
  return box;
}

TEST(LiftMapBox, ABoxStandsOnTheHill) {
  const MapBox given = box_at(20.0, 10.0, 1.0, 0.7);
  const LiftedMapBox lifted = lift_map_box(given, Hill());
  EXPECT_EQ(lifted.status, Status::kOk) << lifted.reason;
  EXPECT_NEAR(lifted.rise, 2.5 - 1.0, 1e-12);
  const Eigen::Vector3d up = lifted.box.rotation * Eigen::Vector3d::UnitZ();
  EXPECT_NEAR((up - Eigen::Vector3d(-0.1, -0.05, 1.0).normalized()).norm(), 0.0, 1e-12);
  const Eigen::Vector3d bottom = lifted.box.center - 0.75 * up;
  EXPECT_NEAR((bottom - Eigen::Vector3d(20.0, 10.0, 2.5)).norm(), 0.0, 1e-9);
  const Eigen::Vector3d front = lifted.box.rotation * Eigen::Vector3d::UnitX();
  EXPECT_NEAR(std::atan2(front.y(), front.x()), 0.7, 1e-12);  // the heading in plan stays
  EXPECT_NEAR(front.dot(up), 0.0, 1e-12);
}

TEST(LiftMapBox, WhatHasNoGroundStays) {
  const MapBox beyond = box_at(200.0, 0.0, 20.0, 0.0);
  const LiftedMapBox left = lift_map_box(beyond, Hill());
  EXPECT_EQ(left.status, Status::kFailed);
  EXPECT_THAT(left.reason, HasSubstr("no ground is known"));
  EXPECT_EQ(left.box.center, beyond.center);
  EXPECT_EQ(lift_map_box(box_at(20.0, 10.0, 9.0, 0.0), Hill()).status, Status::kFailed);
  EXPECT_EQ(lift_map_box(box_at(60.0, 0.0, 6.0, 0.0), Hill()).status, Status::kWeak);
}

TEST(MapBoxes, BothFormsGoThereAndBack) {
  const test::TemporaryFolder folder;
  const fs::path nuscenes = folder.path() / "results.json", av2 = folder.path() / "boxes.csv";
  std::ofstream(nuscenes) << R"({"meta": {"use_lidar": true}, "results": {"a": [
    {"sample_token": "a", "translation": [1, 2, 3], "size": [1.8, 4.5, 1.6],
     "rotation": [0.8, 0, 0, 0.6], "detection_name": "car", "detection_score": 0.9}], "b": []}})";
  std::ofstream(av2) << "timestamp_ns,track_uuid,category,length_m,width_m,height_m,qw,qx,qy,qz,"
                        "tx_m,ty_m,tz_m\n315,t,BUS,11,2.5,3,1,0,0,0,5,6,7\n";
  const MapBoxFile one = MapBoxFile::read(nuscenes), two = MapBoxFile::read(av2);
  ASSERT_EQ(one.boxes().size(), 1u);
  EXPECT_EQ(one.boxes()[0].length, 4.5);
  EXPECT_EQ(one.boxes()[0].width, 1.8);
  EXPECT_EQ(one.boxes()[0].category, "car");
  ASSERT_EQ(two.boxes().size(), 1u);
  EXPECT_EQ(two.boxes()[0].timestamp, 315);
  std::vector<MapBox> moved = one.boxes();
  moved[0].center.z() = 3.5;
  const json written = json::parse(one.encoded(moved, {{"ok", "", 0.05}}));
  EXPECT_EQ(written["results"]["a"][0]["translation"][2], 3.5);
  EXPECT_EQ(written["results"]["a"][0]["detection_score"], 0.9);
  EXPECT_EQ(written["results"]["a"][0]["camber_height_sigma"], 0.05);
  EXPECT_EQ(written["meta"]["use_lidar"], true);
  std::ofstream(av2) << two.encoded(two.boxes(), {{"failed", "no ground, here", std::nan("")}});
  const MapBoxFile again = MapBoxFile::read(av2);
  EXPECT_EQ(again.boxes()[0].center, two.boxes()[0].center);
  EXPECT_THAT(test::read_text(av2), HasSubstr("failed,\"no ground, here\","));
}

TEST(MapBoxes, WhatIsWrongIsNamed) {
  const test::TemporaryFolder folder;
  const auto reason = [&](const std::string& name, const std::string& text) {
    const fs::path file = folder.path() / name;
    std::ofstream(file) << text;
    try {
      MapBoxFile::read(file);
    } catch (const InputError& error) {
      return std::string(error.what());
    }
    return std::string("read");
  };
  EXPECT_THAT(reason("a.json", R"([{"translation": [1, 2], "size": [1, 1, 1]}])"),
              HasSubstr("[0].translation"));
  EXPECT_THAT(
      reason("b.json",
             R"([{"translation": [1, 2, 3], "size": [1, 0, 1], "rotation": [1, 0, 0, 0]}])"),
      HasSubstr("sizes above 0"));
  EXPECT_THAT(
      reason("c.json",
             R"([{"translation": [1, 2, 3], "size": [1, 1, 1], "rotation": [2, 0, 0, 0]}])"),
      HasSubstr("quaternion"));
  EXPECT_THAT(reason("d.csv", "timestamp_ns,qw\n1,2\n"), HasSubstr("found no column qx"));
  EXPECT_THAT(reason("e.csv", "qw,qx,qy,qz,tx_m,ty_m,tz_m,length_m,width_m,height_m\n1,0,0,0,1\n"),
              HasSubstr("line 2"));
  EXPECT_THAT(reason("f.json", R"({"boxes": []})"), HasSubstr("results"));
}

/// Annotated boxes of a laser's moments, 0.5 m too high and level, come back to the measured
/// ground: the annotators' own bottoms lie on it within 26 mm (its README).
TEST(LiftMapBox, ArgoversesBoxesComeBackToTheMeasuredGround) {
  CAMBER_REQUIRE_DATA("argoverse2-ground/3bffdcff/ground.ply");
  const fs::path folder = test::data_dir() / "argoverse2-ground/3bffdcff";
  const RoadCloud cloud = read_cloud(folder / "ground.ply");
  const std::unique_ptr<HeightSource> ground = cloud_heights(cloud, PlanFrame());
  const auto poses = read_stamped_poses(folder / "ego_poses.csv");
  const MapBoxFile file = MapBoxFile::read(folder / "vehicles.csv");
  std::vector<double> off;
  for (const MapBox& given : file.boxes()) {
    const SE3& pose = poses.at(given.timestamp);
    MapBox box = given;
    box.center = pose * given.center;
    box.rotation = pose.rotation() * given.rotation;
    const double bottom =
        (box.center - 0.5 * box.height * (box.rotation * Eigen::Vector3d::UnitZ())).z();
    const Eigen::Vector3d front = box.rotation * Eigen::Vector3d::UnitX();
    MapBox raised = box;
    raised.rotation = Eigen::AngleAxisd(std::atan2(front.y(), front.x()), Eigen::Vector3d::UnitZ());
    raised.center.z() += 0.5;
    const LiftedMapBox lifted = lift_map_box(raised, *ground);
    if (lifted.status == Status::kFailed) continue;
    const Eigen::Vector3d up = lifted.box.rotation * Eigen::Vector3d::UnitZ();
    off.push_back(std::abs((lifted.box.center - 0.5 * box.height * up).z() - bottom));
  }
  ASSERT_GT(off.size(), 100u);
  std::sort(off.begin(), off.end());
  EXPECT_LT(off[off.size() / 2], 0.05);       // m
  EXPECT_LT(off[off.size() * 9 / 10], 0.15);  // boxes beside the road stand on kerbs
}

}  // namespace
}  // namespace camber
