// camber import rosbag on bags that ROS's own library writes.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "camber/image/image_io.h"
#include "camber/scene/scene.h"
#include "cli/bag_maker.h"
#include "cli/run_program.h"
#include "scene/write_image.h"
#include "support/ros_messages.h"
#include "support/test_data.h"

namespace camber {
namespace {

using test::BagCompression;
using test::BagContent;
using test::picture;
using test::RosCameraInfo;
using test::run_camber;
using test::snapshot;
using testing::HasSubstr;
namespace fs = std::filesystem;

constexpr int kWidth = 80, kHeight = 60;

class ImportBag : public ::testing::Test {
 protected:
  std::string path(const std::string& name) const { return folder_.path() / name; }

  static BagContent image(double seconds, const std::string& camera = "/cam") {
    const auto bytes = picture(kWidth, kHeight, 3);
    return {camera + "/image_raw", "Image",
            test::ros_image(seconds, kWidth, kHeight, "bgr8", 3 * kWidth,
                            std::string(bytes.begin(), bytes.end()))};
  }
  static BagContent info(const std::string& camera = "/cam") {
    return {camera + "/camera_info", "CameraInfo", RosCameraInfo().bytes()};
  }
  /// A bag of six images in several chunks.
  void write(BagCompression compression) const {
    std::vector<BagContent> messages = {info()};
    for (int i = 0; i < 6; ++i) messages.push_back(image(1600000000 + 0.1 * i));
    test::write_bag(path("drive.bag"), messages, compression, 30000);
  }
  test::ProgramResult import(const std::vector<std::string>& more = {}) const {
    std::vector<std::string> all = {"import", "rosbag", path("drive.bag"), "--out", path("out")};
    all.insert(all.end(), more.begin(), more.end());
    return run_camber(all);
  }
  void expect_refused(const std::string& part, const std::vector<std::string>& more = {}) const {
    const auto before = snapshot(folder_.path());
    EXPECT_ONE_SENTENCE(import(more), 2, part);
    EXPECT_EQ(snapshot(folder_.path()), before);
  }
  test::TemporaryFolder folder_;
};

TEST_F(ImportBag, ChunksOfEveryCompression) {
  for (const auto compression :
       {BagCompression::kNone, BagCompression::kBz2, BagCompression::kLz4}) {
    fs::remove_all(path("out"));
    write(compression);
    const auto result = import({"--height", "1.4"});
    ASSERT_EQ(result.exit_code, 0) << result.error;
    EXPECT_THAT(result.error, HasSubstr("6 frames (0 to 5) of 85 x 64 pixels, 0 detections"));
    EXPECT_THAT(result.error, HasSubstr("6 images of /cam/image_raw over 0.50 s, 10 a second"));
    EXPECT_THAT(result.error, HasSubstr("camera /cam/camera_info (CameraInfo): fx 100 fy 101"));
    EXPECT_THAT(result.error, HasSubstr("camera 1.4 +- 0.03 m above the road"));
    EXPECT_THAT(result.error, HasSubstr("missing: no boxes"));
    const Scene scene = read_scene(path("out"));
    ASSERT_EQ(scene.frames.size(), 6u);
    EXPECT_NEAR(*scene.frames[5].time_s, 1600000000.5, 1e-6);
    const Image pixels = read_color_image(scene.frames[5].image);
    const auto bgr = picture(kWidth, kHeight, 3);
    ASSERT_EQ(pixels.data.size(), bgr.size());
    EXPECT_EQ(pixels.data[3], bgr[5]);
    EXPECT_EQ(pixels.data[5], bgr[3]);
  }
}

/// The scene is made on the way and stays in the result.
TEST_F(ImportBag, IsReconstructedInOneCommand) {
  const fs::path sample = test::source_dir() / "samples/steep_hill";
  const Scene given = read_scene(sample);
  RosCameraInfo camera;
  camera.width = given.camera.width;
  camera.height = given.camera.height;
  camera.coefficients = {0, 0, 0, 0, 0};
  camera.fx = camera.projection_f = given.camera.fx;
  camera.fy = given.camera.fy;
  camera.cx = given.camera.cx;
  camera.cy = given.camera.cy;
  std::vector<BagContent> messages = {{"/cam/camera_info", "CameraInfo", camera.bytes()}};
  for (std::size_t i = 0; i < given.frames.size(); ++i) {
    const Image pixels = read_color_image(given.frames[i].image);
    messages.push_back({"/cam/image_raw", "Image",
                        test::ros_image(1600000000 + 0.1 * static_cast<double>(i), pixels.width,
                                        pixels.height, "rgb8", 3 * pixels.width,
                                        std::string(pixels.data.begin(), pixels.data.end()))});
  }
  test::write_bag(path("drive.bag"), messages);
  const auto made =
      run_camber({"reconstruct", path("drive.bag"), "--height", "1.65", "--detector", "none",
                  "--keypoints", "none", "--no-pictures", "--out", path("result")});
  ASSERT_EQ(made.exit_code, 0) << made.error;
  EXPECT_THAT(made.error, HasSubstr("3 images of /cam/image_raw"));
  EXPECT_THAT(made.out, HasSubstr("distances known to "));
  const Scene scene = read_scene(path("result/scene"));
  EXPECT_NEAR(scene.camera.fx, given.camera.fx, 1e-9);
  EXPECT_EQ(scene.height_above_road, 1.65);
}

TEST_F(ImportBag, OptionsAndJson) {
  write(BagCompression::kNone);
  const auto result = import({"--from", "0.15", "--every", "2", "--fov", "90", "--json"});
  ASSERT_EQ(result.exit_code, 0) << result.error;
  const auto report = nlohmann::json::parse(result.out);
  EXPECT_EQ(report["options"]["from"], 0.15);
  EXPECT_EQ(report["options"]["every"], 2);
  const Scene scene = read_scene(path("out"));
  ASSERT_EQ(scene.frames.size(), 2u);
  EXPECT_EQ(scene.frames[1].id, 4);
  EXPECT_NEAR(scene.camera.fx, 40.0, 1e-9);
}

TEST_F(ImportBag, TwoCamerasAndNone) {
  test::write_bag(path("drive.bag"), {info("/left"), info("/right"), image(1, "/left"),
                                      image(1, "/right"), image(2, "/right")});
  expect_refused("found images of 2 topics: /left/image_raw (1), /right/image_raw (2); expected");
  const auto result = import({"--topic", "/right/image_raw"});
  ASSERT_EQ(result.exit_code, 0) << result.error;
  EXPECT_EQ(read_scene(path("out")).frames.size(), 2u);
  fs::remove_all(path("out"));
  test::write_bag(path("drive.bag"), {image(1)});
  expect_refused("found no CameraInfo of /cam/image_raw");
  test::write_bag(path("drive.bag"), {info()});
  expect_refused("found no images among 1 topics");
  // The last image is another size: those before it do not stay behind.
  BagContent small = image(9);
  small.bytes = test::ros_image(9, 4, 4, "mono8", 4, std::string(16, 'x'));
  test::write_bag(path("drive.bag"), {info(), image(1), image(2), small});
  expect_refused("message 2 of /cam/image_raw: found an image of 4 x 4 pixels, expected 80 x 60");
}

TEST_F(ImportBag, WhatIsNoBag) {
  expect_refused("no such file, expected a bag");
  test::write_bytes(path("drive.bag"), "");
  expect_refused("found an empty file");
  test::write_bytes(path("drive.bag"), "SQLite format 3");
  expect_refused("found a recording of ROS 2");
  test::write_bytes(path("drive.bag"), "#ROSBAG V1.2\n");
  expect_refused("found a bag of the version V1.2");
  fs::remove(path("drive.bag"));
  fs::create_directories(path("drive.bag"));
  expect_refused("cannot be read");
}

TEST_F(ImportBag, CutOrDamagedBags) {
  write(BagCompression::kLz4);
  const std::string whole = test::read_bytes(path("drive.bag"));
  for (const double part : {0.001, 0.2, 0.5, 0.8, 0.999}) {
    test::write_bytes(path("drive.bag"),
                      whole.substr(0, static_cast<std::size_t>(part * whole.size())));
    expect_refused("drive.bag");
  }
  // Never closed: the header's index_pos is 0.
  std::string open = whole;
  const std::size_t at = open.find("index_pos=") + 10;
  open.replace(at, 8, std::string(8, '\0'));
  test::write_bytes(path("drive.bag"), open);
  expect_refused("whose recording was not finished, expected one with its index (rosbag reindex");
}

}  // namespace
}  // namespace camber
