#include "camber/scene/validate_scene.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <limits>
#include <stdexcept>

namespace camber {
namespace {

using ::testing::StartsWith;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

Scene made_scene() {
  Scene scene;
  scene.camera = {64, 48, 50, 50, 32, 24};
  scene.height_above_road = 1.65;
  scene.markings_m = {{"dash_length", 3.0}, {"dash_gap", 6.0}};
  scene.segmentation_classes = {{"road", {1}}, {"vehicle", {3}}};
  for (const int id : {3, 4}) {
    SceneFrame frame;
    frame.id = id;
    frame.up = Eigen::Vector3d(0.0, -1.0, 0.0);
    VehicleDetection vehicle;
    vehicle.id = 7;
    vehicle.box = {1, 2, 3, 4};
    frame.vehicles = {vehicle};
    scene.frames.push_back(frame);
  }
  return scene;
}

std::string problem(const std::function<void(Scene&)>& change) {
  Scene scene = made_scene();
  change(scene);
  try {
    validate(scene);
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "";
}

TEST(ValidateScene, WhatAManifestMayHave) {
  EXPECT_EQ(problem([](Scene&) {}), "");
  EXPECT_EQ(problem([](Scene& s) { s.frames.clear(), s.reference_frame = 9; }), "");
  EXPECT_EQ(problem([](Scene& s) { s.reference_frame = 4; }), "");
}

TEST(ValidateScene, NamesFrameFieldAndValue) {
  EXPECT_THAT(problem([](Scene& s) { s.camera.fx = -1; }), StartsWith("fx = -1"));
  EXPECT_THAT(problem([](Scene& s) { s.distortion.coefficients = {0.1}; }), StartsWith("width"));
  EXPECT_EQ(problem([](Scene& s) { s.height_above_road = -1.0; }),
            "height_above_road: found -1, expected a positive number of metres up to 1000");
  EXPECT_EQ(problem([](Scene& s) { s.height_above_road = 1001.0; }),
            "height_above_road: found 1001, expected a positive number of metres up to 1000");
  EXPECT_THAT(problem([](Scene& s) { s.height_sigma = 0.0; }), StartsWith("height_sigma: found 0"));
  EXPECT_THAT(problem([](Scene& s) { s.frame_rate = kNan; }), StartsWith("frame_rate: found nan"));
  EXPECT_THAT(problem([](Scene& s) { s.box_sigma_px = 0.0; }), StartsWith("box_sigma_px: found 0"));
  EXPECT_EQ(problem([](Scene& s) { s.markings_m["dash_lenght"] = 3.0; }),
            "markings_m: found \"dash_lenght\", expected dash_length, dash_gap, line_width, "
            "zebra_stripe_width, zebra_gap, zebra_stripe_length, lane_width");
  EXPECT_EQ(problem([](Scene& s) { s.markings_m["dash_gap"] = -6.0; }),
            "markings_m: dash_gap: found -6, expected a positive number of metres");
  EXPECT_THAT(problem([](Scene& s) { s.segmentation_classes["road"] = {256}; }),
              StartsWith("segmentation_classes: found 256"));
  EXPECT_THAT(problem([](Scene& s) { s.segmentation_classes["road"] = {3}; }),
              StartsWith("segmentation_classes: found 3 under \"road\" and \"vehicle\""));
  EXPECT_EQ(problem([](Scene& s) { s.reference_frame = 9; }),
            "reference_frame: found 9, expected the id of one of the frames");
  EXPECT_EQ(problem([](Scene& s) { s.frames[1].id = 3; }),
            "frames: found 3 behind 3, expected ids in ascending order");

  EXPECT_EQ(problem([](Scene& s) { s.frames[0].id = -3; }),
            "frame -3: id: found -3, expected at least 0");
  EXPECT_THAT(problem([](Scene& s) { s.frames[1].up = Eigen::Vector3d(0, 1, 0); }),
              StartsWith("frame 4: up points down"));
  EXPECT_THAT(problem([](Scene& s) { s.frames[1].up = Eigen::Vector3d(0, 0, 0); }),
              StartsWith("frame 4: up (its length): found 0"));
  EXPECT_THAT(problem([](Scene& s) { s.frames[1].up_sigma = kNan; }),
              StartsWith("frame 4: up_sigma: found nan"));
  EXPECT_THAT(problem([](Scene& s) { s.frames[1].time_s = kNan; }),
              StartsWith("frame 4: time_s: found nan"));
  EXPECT_THAT(problem([](Scene& s) { s.frames[1].speed = -1.0; }),
              StartsWith("frame 4: speed: found -1"));
  EXPECT_THAT(problem([](Scene& s) { s.frames[1].speed = 1.0; }),
              StartsWith("frame 4: speed_sigma: found 0"));
  EXPECT_THAT(problem([](Scene& s) {
                s.frames[1].ego_plane = Plane{{0, 1, 0}, 1.65};
              }),
              StartsWith("frame 4: ego_plane.normal: found 1"));
  EXPECT_THAT(problem([](Scene& s) {
                s.frames[1].ego_plane = Plane{{0, -2, 0}, 1.65};
              }),
              StartsWith("frame 4: ego_plane.normal: found 2, expected length 1"));

  const auto vehicle = [](const std::function<void(VehicleDetection&)>& change) {
    return problem([&](Scene& s) { change(s.frames[0].vehicles[0]); });
  };
  EXPECT_THAT(vehicle([](auto& v) { v.id = -1; }), StartsWith("frame 3: vehicle id: found -1"));
  EXPECT_THAT(vehicle([](auto& v) { v.track = -2; }), StartsWith("frame 3: vehicle 7: track"));
  EXPECT_THAT(vehicle([](auto& v) { v.score = kNan; }), StartsWith("frame 3: vehicle 7: score"));
  EXPECT_THAT(vehicle([](auto& v) {
                v.box = {3, 2, 1, 4};
              }),
              StartsWith("frame 3: vehicle 7: box: found 3, 2 to 1, 4"));
  EXPECT_THAT(vehicle([](auto& v) { v.keypoints.resize(14); }),
              StartsWith("frame 3: vehicle 7: keypoints: found 14"));
  EXPECT_EQ(vehicle([](auto& v) {
              v.keypoints.resize(kNumKeypoints);
              v.keypoints[5].pixel.x() = kNan;
            }),
            "");
  EXPECT_THAT(vehicle([](auto& v) {
                v.keypoints.resize(kNumKeypoints);
                v.keypoints[5].pixel.y() = std::numeric_limits<double>::infinity();
              }),
              StartsWith("frame 3: vehicle 7: keypoints: found 0, inf"));
  EXPECT_EQ(
      problem([](Scene& s) { s.frames[0].vehicles.push_back(s.frames[0].vehicles[0]); }),
      "frame 3: vehicle id: found 7 a second time, expected ids that differ within the frame");
}

}  // namespace
}  // namespace camber
