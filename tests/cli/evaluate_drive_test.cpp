// camber evaluate on the result of a drive and on files of poses.

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>

#include "camber/cloud/cloud_io.h"
#include "camber/scene/drive_document.h"
#include "camber/scene/results.h"
#include "camber/scene/scene.h"
#include "cli/run_program.h"
#include "support/test_data.h"

namespace camber {
namespace {

using nlohmann::json;
using test::run_camber;
using ::testing::HasSubstr;

/// A straight drive of 70 frames, a metre each, with two vehicles, and a result a percent too long.
class DrivenScene : public ::testing::Test {
 protected:
  static constexpr int kFrames = 70;

  DrivenScene() {
    Scene scene;
    scene.name = "driven";
    scene.camera = {1242, 375, 720.0, 720.0, 620.5, 187.0};
    scene.height_above_road = 1.65;
    scene.frame_rate = 10.0;
    scene.truth.emplace();
    DriveDocument drive;
    drive.length = 1.01 * (kFrames - 1);
    drive.length_sigma = 0.005 * drive.length;
    drive.common_sigma = 0.004;
    drive.windows = {{0, 50, 50.5, 0.5}, {10, 60, 50.5, 0.5}};
    VehicleDocument vehicles;
    vehicles.method = "joint";
    std::ofstream truth_poses(path("truth.txt")), times(path("times.txt")), tum(path("t.tum"));
    for (int i = 0; i < kFrames; ++i) {
      SceneFrame frame;
      frame.id = i;
      scene.frames.push_back(frame);
      TruthFrame truth;
      truth.id = i;
      truth.world_from_camera = pose(i);
      vehicles.frames.push_back({i, {}});
      for (int k = 0; k < 2; ++k) {
        TruthVehicle vehicle;
        vehicle.id = 3 + k;
        vehicle.box = {100.0 + 300.0 * k, 150.0, 200.0 + 300.0 * k, 230.0};
        vehicle.pose.camera_from_vehicle =
            SE3(rotation_from_rotation_y(-1.5), Eigen::Vector3d(3.0 * k, 1.6, 15.0));
        vehicle.pose.dimensions = {4.0, 1.7, 1.5};
        truth.vehicles.push_back(vehicle);
        VehicleEstimate estimate;
        estimate.id = k;
        estimate.track = k == 1 && i > 30 ? 7 : k;  // one track breaks in two
        estimate.box = vehicle.box;
        estimate.pose = vehicle.pose;
        estimate.plane = Plane{Eigen::Vector3d(0, -1, 0), 1.6};
        estimate.plane_source = "given";
        estimate.status = Status::kOk;
        vehicles.frames.back().vehicles.push_back(estimate);
      }
      scene.truth->frames.push_back(truth);
      DriveFrame driven;
      driven.id = i;
      if (i > 0) driven.world_from_camera = pose(1.01 * i);
      drive.frames.push_back(driven);
      truth_poses << fmt::format("1 0 0 0 0 1 0 0 0 0 1 {}\n", i);
      times << 0.1 * i << "\n";
      tum << fmt::format("{} 0 0 {} 0 0 0 1\n", 0.1 * i, 1.01 * i);
    }
    write_scene(scene, path("scene.json"));
    std::filesystem::create_directories(path("result"));
    write_json(to_json(drive), path("result/drive.json"));
    write_json(to_json(vehicles), path("result/vehicles.json"));
  }

  static SE3 pose(double along) {
    return {Eigen::Quaterniond::Identity(), Eigen::Vector3d(0.0, 0.0, along)};
  }
  std::string path(const std::string& name) const { return (folder_.path() / name).string(); }

  test::TemporaryFolder folder_;
};

TEST_F(DrivenScene, TrajectoryTracksAndVehiclesOfAResult) {
  const auto run = run_camber(
      {"evaluate", "--truth", path("scene.json"), "--estimate", path("result"), "--json"});
  ASSERT_EQ(run.exit_code, 0) << run.error;
  const json result = json::parse(run.out);
  ASSERT_EQ(result["trajectories"].size(), 1u);
  const json& drive = result["trajectories"][0];
  EXPECT_EQ(drive["frames"], kFrames);
  EXPECT_EQ(drive["frames_with_pose"], kFrames - 1);
  EXPECT_NEAR(drive["length_log_error"].get<double>(), std::log(1.01), 1e-9);
  EXPECT_NEAR(drive["length_error_sigma"].get<double>(), std::log(1.01) / 0.005, 1e-6);
  // Half of the true 69 m; from the first window's first frame there is no pose.
  EXPECT_NEAR(drive["kitti_every_frame"]["half"]["length"].get<double>(), 34.5, 1e-9);
  EXPECT_EQ(drive["windows"]["count"], 1);
  EXPECT_EQ(drive["windows"]["unanswered"], 1);
  ASSERT_EQ(result["tracks"].size(), 1u);
  EXPECT_EQ(result["tracks"][0]["id_switches"], 1);
  EXPECT_EQ(result["tracks"][0]["matched"], 2 * kFrames);
  ASSERT_EQ(result["tables"].size(), 1u);
  EXPECT_EQ(result["tables"][0]["counted"], 2 * kFrames);

  const auto text = run_camber({"evaluate", "--truth", path("scene.json"), "--estimate",
                                path("result"), "--out", path("tables")});
  ASSERT_EQ(text.exit_code, 0) << text.error;
  EXPECT_THAT(text.out, HasSubstr("69 of 70 frames with a pose (98.6 %)"));
  EXPECT_THAT(text.out, HasSubstr("length 68.68 m of 68.00 m: +1.00 %, 1.99 sigma"));
  EXPECT_THAT(text.out, HasSubstr("half the drive (34.5 m), every frame"));
  EXPECT_THAT(text.out, HasSubstr("id switches"));
  EXPECT_THAT(test::read_text(path("tables/tables.md")), HasSubstr("| with scale |"));
}

TEST_F(DrivenScene, FilesOfPosesAreCompared) {
  const auto run = run_camber({"evaluate", "--truth", path("truth.txt"), "--times",
                               path("times.txt"), "--estimate", path("t.tum"), path("truth.txt"),
                               path("result/drive.json"), "--json"});
  ASSERT_EQ(run.exit_code, 0) << run.error;
  const json list = json::parse(run.out)["trajectories"];
  ASSERT_EQ(list.size(), 3u);
  EXPECT_EQ(list[0]["method"], "TUM");
  EXPECT_NEAR(list[0]["length_log_error"].get<double>(), std::log(1.01), 1e-9);
  EXPECT_EQ(list[1]["method"], "KITTI");
  EXPECT_EQ(list[1]["length_log_error"], 0.0);
  EXPECT_EQ(list[2]["method"], "drive");

  const auto of_scene =
      run_camber({"evaluate", "--truth", path("scene.json"), "--estimate", path("t.tum")});
  EXPECT_EQ(of_scene.exit_code, 0) << of_scene.error;
  EXPECT_THAT(of_scene.out, HasSubstr("70 of 70 frames"));

  EXPECT_ONE_SENTENCE(
      run_camber({"evaluate", "--truth", path("truth.txt"), "--estimate", path("t.tum")}), 2,
      "--times");
  EXPECT_ONE_SENTENCE(run_camber({"evaluate", "--truth", path("truth.txt"), "--estimate",
                                  path("result/vehicles.json")}),
                      2, "is no trajectory");
}

TEST_F(DrivenScene, TheRoadAlongItIsComparedWithTheTruthsCloud) {
  // A level road 1.65 m below the cameras; the strip lacks what lies left of 2 m, and its right
  // half is 4 cm low.
  RoadCloud truth, strip;
  for (int i = 0; i < 400; ++i) {
    for (int k = -20; k <= 20; ++k) truth.points.emplace_back(0.25F * k, 1.65F, 0.25F * i);
  }
  write_cloud(truth, path("road.ply"));
  strip.frame = CloudFrame::kZUp;
  for (int i = 0; i < 190; ++i) {
    for (int k = -10; k < 4; ++k) {
      const double s = 0.5 * i + 0.25, lateral = 0.5 * k + 0.25;
      // The drive's lengths are a percent too long, and the second frame is its first with a pose.
      strip.points.push_back(
          Eigen::Vector3d(1.01 + s, lateral, -1.65 - (k < 0 ? 0.04 : 0.0)).cast<float>());
      strip.scalars["s"].push_back(static_cast<float>(s));
      strip.scalars["lateral"].push_back(static_cast<float>(lateral));
      strip.scalars["sigma"].push_back(0.01F);
      strip.labels["label"].push_back(1);
    }
  }
  std::filesystem::create_directories(path("result/strip"));
  write_cloud(strip, path("result/strip/000000.ply"));
  json index = {{"format", "camber-strip"},
                {"metric", true},
                {"level", "camera"},
                {"cell", 0.5},
                {"strip_from_world", {0, 0, 1, 0, -1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 0, 1}},
                {"stretches", {{{"file", "000000.ply"}, {"from_s", 0.0}}}}};
  for (int i = 1; i < kFrames; ++i) {
    index["driven_line_s_xyz"].push_back({1.01 * (i - 1), 1.01 * i, 0.0, -1.65});
  }
  write_json(index, path("result/strip/index.json"));
  json scene = json::parse(test::read_text(path("scene.json")));
  scene["truth"]["cloud"] = "road.ply";
  scene["truth"]["cloud_frame"] = 0;
  write_json(scene, path("scene.json"));

  const std::vector<std::string> words{"evaluate",   "--truth",      path("scene.json"),
                                       "--estimate", path("result"), "--json"};
  const auto run = run_camber(words);
  ASSERT_EQ(run.exit_code, 0) << run.error;
  const json road = json::parse(run.out)["strips"][0];
  EXPECT_GT(road["cells"], 1500);
  EXPECT_NEAR(road["share_answered"].get<double>(), 0.75, 0.02);  // 12 of 16 across
  EXPECT_NEAR(road["height_error"]["p95"].get<double>(), 0.04, 1e-3);
  EXPECT_NEAR(road["height_error"]["mean"].get<double>(), -0.04 * 8.0 / 12.0, 2e-3);
  EXPECT_NEAR(road["height_error_beside"]["within_95"].get<double>(), 4.0 / 12.0, 0.02);
  EXPECT_NEAR(road["grade_error_deg"]["rms"].get<double>(), 0.0, 1e-3);
  EXPECT_THAT(
      run_camber({"evaluate", "--truth", path("scene.json"), "--estimate", path("result")}).out,
      HasSubstr("road of"));
  // Of a strip that is up to scale nothing is said in metres.
  index["metric"] = false;
  write_json(index, path("result/strip/index.json"));
  EXPECT_FALSE(json::parse(run_camber(words).out).contains("strips"));
}

}  // namespace
}  // namespace camber
