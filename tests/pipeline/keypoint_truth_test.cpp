#include "camber/pipeline/keypoint_truth.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>

#include "camber/core/errors.h"
#include "scene/write_image.h"
#include "support/test_data.h"

namespace camber {
namespace {

/// A vehicle 10 m ahead that is seen from its left: it points to the camera's left, so its right
/// axis points away.
class KeypointTruth : public ::testing::Test {
 protected:
  KeypointTruth() {
    scene_.camera.width = 200;
    scene_.camera.height = 100;
    scene_.camera.fx = scene_.camera.fy = 200.0;
    scene_.camera.cx = 100.0;
    scene_.camera.cy = 50.0;
    test::write_png(folder_.path() / "0.png", 200, 100, 2, 8, test::picture(200, 100, 3));
    SceneFrame frame;
    frame.id = 4;
    frame.image = folder_.path() / "0.png";
    scene_.frames = {frame};
    TruthVehicle vehicle;
    vehicle.id = 8;
    vehicle.box = {60.0, 30.0, 140.0, 75.0};
    Eigen::Matrix3d rotation;  // front, up, right
    rotation << -1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 1.0;
    vehicle.pose.camera_from_vehicle = SE3(rotation, Eigen::Vector3d(0.0, 1.2, 10.0));
    vehicle.pose.dimensions = {4.0, 1.8, 1.5};
    for (int k = 0; k < kNumKeypoints; ++k) {
      const double side = k < 18 ? -0.8 : 0.8;
      vehicle.keypoints.push_back(vehicle.pose.camera_from_vehicle *
                                  Eigen::Vector3d(0.1 * (k % 18), 0.5, side));
    }
    vehicle.keypoints[3] = {-9.0, 0.0, 10.0};  // left of the image
    SceneTruth truth;
    TruthFrame in_truth;
    in_truth.id = 4;
    in_truth.vehicles = {vehicle};
    truth.frames = {in_truth};
    scene_.truth = truth;
  }
  TruthVehicle& vehicle() { return scene_.truth->frames[0].vehicles[0]; }
  SceneKeypointTruth read(const KeypointTruthOptions& options = {}) {
    return scene_keypoint_truth(scene_, folder_.path(), options);
  }
  test::TemporaryFolder folder_;
  Scene scene_;
};

TEST_F(KeypointTruth, IsProjectedIntoTheCropsOfTrueBoxes) {
  const SceneKeypointTruth truth = read();
  ASSERT_EQ(truth.crops.size(), 1U);
  EXPECT_FALSE(truth.by_ray_casting);
  const KeypointCropTruth& crop = truth.crops[0];
  EXPECT_EQ(crop.crop.width, 64);
  EXPECT_NEAR(crop.box_side, 64.0 / 1.15, 1e-9);
  EXPECT_NEAR(crop.box_height, 45.0, 1e-9);
  EXPECT_NEAR(std::abs(crop.azimuth), 3.14159265, 1e-6) << "from the left";
  // Keypoint 0: x 0, 0.7 m below the camera, 9.2 m away.
  const double scale = 1.15 * 80.0 / 64.0;
  EXPECT_NEAR(crop.points[0].x(), 31.5 + (100.0 - 100.0) / scale, 1e-9);
  EXPECT_NEAR(crop.points[0].y(), 31.5 + (50.0 + 200.0 * 0.7 / 9.2 - 52.5) / scale, 1e-9);
  EXPECT_EQ(crop.visibility[0], KeypointVisibility::kVisible);
  EXPECT_EQ(crop.visibility[18], KeypointVisibility::kHiddenByCar) << "the other side";
  EXPECT_EQ(crop.visibility[3], KeypointVisibility::kOutside);
}

TEST_F(KeypointTruth, TakesWhatRaysSaw) {
  std::filesystem::create_directories(folder_.path() / "truth");
  const auto write = [&](const std::string& visible) {
    std::ofstream(folder_.path() / "truth/truth.json")
        << R"({"frames": [{"frame": 4, "cars": [{"track_id": 8, "keypoints_visible": [)" << visible
        << "]}]}]}";
  };
  std::string visible = "0";
  for (int k = 1; k < kNumKeypoints; ++k) visible += k == 18 ? ", 1" : ", 0";
  write(visible);
  const SceneKeypointTruth truth = read();
  EXPECT_TRUE(truth.by_ray_casting);
  EXPECT_EQ(truth.crops.at(0).visibility[0], KeypointVisibility::kHiddenByCar);
  EXPECT_EQ(truth.crops[0].visibility[18], KeypointVisibility::kVisible);
  write("1, 0");
  EXPECT_THROW(read(), InputError);
}

TEST_F(KeypointTruth, LeavesOutVehiclesThatAreHardlyThere) {
  const auto count = [&] { return read().crops.size(); };
  vehicle().occlusion = 0.6;
  EXPECT_EQ(count(), 0U);
  vehicle().occlusion = 0.4;
  EXPECT_EQ(count(), 1U);
  vehicle().truncation = 0.4;
  EXPECT_EQ(count(), 0U);
  vehicle().truncation = 0.0;
  KeypointTruthOptions options;
  options.least_height = 46.0;
  EXPECT_EQ(read(options).crops.size(), 0U);
  vehicle().keypoints.clear();
  EXPECT_EQ(count(), 0U);
  scene_.truth.reset();
  EXPECT_EQ(count(), 0U);
}

}  // namespace
}  // namespace camber
