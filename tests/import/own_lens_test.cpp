#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "camber/geometry/lens_map.h"
#include "camber/import/import_own.h"

namespace camber {
namespace {

Scene lensed_scene() {
  Scene scene;
  scene.camera = {640, 400, 350.0, 350.0, 320.0, 200.0};
  scene.distortion.model = LensModel::kBrown;
  scene.distortion.coefficients = {-0.28, 0.07, 0.0, 0.0};
  scene.distortion.raw = scene.camera;
  SceneFrame frame;
  VehicleDetection car;
  car.box = {500.0, 240.0, 600.0, 300.0};
  car.keypoints.assign(kNumKeypoints, {});
  for (KeypointObservation& k : car.keypoints) k.pixel.setConstant(std::nan(""));
  car.keypoints[3].pixel = {550.0, 270.0};
  frame.vehicles.push_back(car);
  scene.frames.push_back(frame);
  return scene;
}

TEST(OwnLens, BoxesAndKeypointsAreCarriedOver) {
  const Scene before = lensed_scene();
  Scene scene = before;
  OwnImport out;
  take_out_lens(scene, out);
  ASSERT_EQ(out.found.size(), 1u);
  EXPECT_THAT(out.found[0], ::testing::HasSubstr("the lens is taken out on reading"));
  EXPECT_GT(scene.camera.width, before.camera.width);
  EXPECT_EQ(file_camera(scene).width, 640);
  const LensMap map(scene.camera, scene.distortion);
  const VehicleDetection& car = scene.frames[0].vehicles[0];
  const auto at = map.raw_from_pinhole(car.keypoints[3].pixel);
  ASSERT_TRUE(at);
  EXPECT_LT((*at - Eigen::Vector2d(550.0, 270.0)).norm(), 1e-6);
  EXPECT_FALSE(car.keypoints[4].pixel.allFinite());
  // The middles of the edges are on the box's edges, but for their bend.
  const auto left = map.pinhole_from_raw({500.0, 270.0}),
             below = map.pinhole_from_raw({550.0, 300.0});
  EXPECT_NEAR(car.box.x1, left->x(), 2.0);
  EXPECT_NEAR(car.box.y2, below->y(), 4.0);
  EXPECT_GT(car.box.width(), 1.15 * 100.0);  // a barrel squeezes the border
}

TEST(OwnLens, WithoutALensNothingChanges) {
  Scene scene = lensed_scene();
  scene.distortion = {};
  OwnImport out;
  take_out_lens(scene, out);
  EXPECT_TRUE(out.found.empty());
  EXPECT_EQ(scene.camera.width, 640);
  EXPECT_EQ(file_camera(scene).width, 640);
  EXPECT_EQ(scene.frames[0].vehicles[0].box.x1, 500.0);
}

/// A fisheye that sees 90 degrees to the side: the pinhole image ends before, and what lies beyond
/// has no place in it.
TEST(OwnLens, BoxesBeyondThePinholeImageAreCutOrLeftOut) {
  Scene scene;
  scene.camera = {128, 64, 41.0, 41.0, 63.5, 31.5};
  scene.distortion.model = LensModel::kFisheye;
  scene.distortion.coefficients = {0.0, 0.0, 0.0, 0.0};
  scene.distortion.raw = scene.camera;
  scene.frames.emplace_back();
  for (const Box2& box :
       {Box2{50.0, 20.0, 60.0, 40.0}, Box2{0.0, 20.0, 25.0, 40.0}, Box2{0.0, 20.0, 4.0, 40.0}}) {
    VehicleDetection car;
    car.id = static_cast<int>(scene.frames[0].vehicles.size());
    car.box = box;
    scene.frames[0].vehicles.push_back(car);
  }
  OwnImport out;
  take_out_lens(scene, out);
  const std::vector<VehicleDetection>& cars = scene.frames[0].vehicles;
  ASSERT_EQ(cars.size(), 2u);
  EXPECT_EQ(cars[0].id, 0);
  EXPECT_EQ(cars[1].id, 1);
  const LensMap map(scene.camera, scene.distortion);
  EXPECT_FALSE(map.pinhole_from_raw({-1.0, 30.0}));
  EXPECT_NEAR(cars[1].box.x2, map.pinhole_from_raw({25.0, 30.0})->x(), 1.0);
  EXPECT_LE(cars[1].box.x1, 0.0);
  EXPECT_THAT(out.found[0], ::testing::HasSubstr("1 boxes left out"));
}

}  // namespace
}  // namespace camber
