#include "camber/import/open_scene.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>

#include "camber/core/errors.h"
#include "scene/write_image.h"
#include "support/test_data.h"

namespace camber {
namespace {

namespace fs = std::filesystem;

constexpr double kDegrees = 57.29577951308232;

struct OpenSceneTest : testing::Test {
  test::TemporaryFolder folder;
  fs::path images = folder.path() / "clip";
  OpenSceneOptions options;

  void SetUp() override {
    fs::create_directories(images);
    for (const char* name : {"1.png", "2.png"}) {
      test::write_png(images / name, 64, 48, 2, 8, test::picture(64, 48, 3));
    }
    options.import_to = folder.path() / "made" / "scene";
    options.own.height = 1.3;
  }
};

TEST_F(OpenSceneTest, ASceneIsRead) {
  options.own.camera.guess = true;
  open_scene(images, options);
  const OpenedScene again = open_scene(options.import_to, {});
  EXPECT_EQ(again.kind, InputKind::kScene);
  EXPECT_EQ(again.manifest, options.import_to / "scene.json");
  EXPECT_EQ(again.scene.frames.size(), 2u);
}

TEST_F(OpenSceneTest, OfImagesOneIsMadeWithACameraThatIsGuessed) {
  EXPECT_THROW(open_scene(images, options), UsageError);  // unless asked for, none is
  EXPECT_FALSE(fs::exists(folder.path() / "made"));
  options.own.camera.guess = true;
  const OpenedScene opened = open_scene(images, options);
  EXPECT_EQ(opened.kind, InputKind::kImages);
  EXPECT_TRUE(opened.camera_guessed);
  EXPECT_EQ(opened.scene.camera_sigma.focal, kGuessedFocalSigma);
  EXPECT_NEAR(2.0 * std::atan(32.0 / opened.scene.camera.fx) * kDegrees, kGuessedFovDeg, 1e-9);
  EXPECT_EQ(opened.scene.height_sigma, kTypedHeightSigma);
  const Scene kept = read_scene(opened.manifest);
  EXPECT_EQ(kept.camera_sigma.focal, kGuessedFocalSigma);
  EXPECT_TRUE(fs::equivalent(kept.frames[1].image, images / "2.png"));
}

TEST_F(OpenSceneTest, WhatIsStatedOfTheCameraSaysHowWellItIsKnown) {
  const auto sigma = [&] { return open_scene(images, options).scene.camera_sigma.focal; };
  OwnCamera& camera = options.own.camera;
  camera.fov_deg = 70.0;
  // By the derivative of the focal length, against numbers.
  const auto focal = [](double degrees) { return 32.0 / std::tan(0.5 * degrees / kDegrees); };
  EXPECT_NEAR(sigma(), kFovSigmaDeg * std::log(focal(69.5) / focal(70.5)), 1e-4);
  camera.fov_sigma_deg = 2.0;
  EXPECT_NEAR(sigma(), 2.0 * std::log(focal(69.5) / focal(70.5)), 1e-4);
  camera = {};
  camera.fx = 60.0;
  EXPECT_EQ(sigma(), kTypedFocalSigma);
  camera = {};
  camera.calibration = folder.path() / "camera.yaml";
  const std::string calibration =
      "%YAML:1.0\nimage_width: 64\nimage_height: 48\ncamera_matrix: !!opencv-matrix\n   rows: 3\n"
      "   cols: 3\n   dt: d\n   data: [60., 0., 31.5, 0., 60., 23.5, 0., 0., 1.]\n";
  std::ofstream(camera.calibration) << calibration;
  EXPECT_EQ(sigma(), kCalibratedFocalSigma);
  std::ofstream(camera.calibration)
      << calibration << "focal_sigma: 0.012\nprincipal_sigma: 4\ndistortion_sigma: 0.02\n";
  EXPECT_EQ(sigma(), 0.012);
  EXPECT_EQ(open_scene(images, options).scene.camera_sigma.principal, 4.0);
  EXPECT_EQ(open_scene(images, options).scene.camera_sigma.distortion, 0.02);
  std::ofstream(camera.calibration) << calibration << "focal_sigma: -1\n";
  EXPECT_THROW(sigma(), InputError);
  camera = {};
  camera.fov_sigma_deg = 2.0;
  EXPECT_THROW(sigma(), std::invalid_argument);
}

}  // namespace
}  // namespace camber
