#include "camber/import/import_synthia.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "camber/core/errors.h"
#include "camber/image/image_io.h"
#include "scene/write_image.h"
#include "support/test_data.h"

namespace camber {
namespace {

using test::picture;
using test::write_bytes;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
namespace fs = std::filesystem;

/// A sequence of 64 x 36 images: frames 3 and 4.
class SynthiaSequence : public ::testing::Test {
 protected:
  SynthiaSequence() {
    for (const char* folder : {"SEQ1/RGBLeft", "SEQ1/DepthLeft", "SEQ1/GTLeft", "out"}) {
      fs::create_directories(path(folder));
    }
    std::vector<std::uint8_t> labels;
    for (int i = 0; i < 64 * 36; ++i) {
      const auto id = static_cast<std::uint8_t>(i % 23);
      labels.insert(labels.end(), {id, 7, 9, 255});
    }
    for (const char* name : {"0000003.png", "0000004.png"}) {
      test::write_png(path(std::string("SEQ1/RGBLeft/") + name), 64, 36, 2, 8, picture(64, 36, 3));
      test::write_png(path(std::string("SEQ1/DepthLeft/") + name), 64, 36, 2, 8,
                      picture(64, 36, 3));
      test::write_png(path(std::string("SEQ1/GTLeft/") + name), 64, 36, 6, 8, labels);
    }
    options_.sequence = path("SEQ1/");
  }
  fs::path path(const std::string& name) const { return folder_.path() / name; }
  fs::path manifest() const { return path("out/scene.json"); }

  test::TemporaryFolder folder_;
  SynthiaSfImportOptions options_;
};

TEST_F(SynthiaSequence, DepthAndLabelsBecomeTruth) {
  import_synthia_sf_to(options_, manifest());
  const Scene scene = read_scene(manifest());
  EXPECT_EQ(scene.name, "SEQ1");
  EXPECT_EQ(scene.camera.width, 64);
  EXPECT_NEAR(scene.camera.fx, 847.630211643 / 30, 1e-12);
  // The full image's centre, 960.5 from its left edge, is 960.5 / 30 from it here.
  EXPECT_NEAR(scene.camera.cx, 960.5 / 30 - 0.5, 1e-12);
  EXPECT_NEAR(scene.camera.cy, 540.5 / 30 - 0.5, 1e-12);
  EXPECT_FALSE(scene.height_above_road);
  ASSERT_EQ(scene.frames.size(), 2u);
  EXPECT_EQ(scene.frames[0].id, 3);
  EXPECT_TRUE(scene.frames[0].segmentation.empty());
  EXPECT_EQ(scene.segmentation_source, "");
  ASSERT_TRUE(scene.truth);
  ASSERT_EQ(scene.truth->frames.size(), 2u);
  EXPECT_EQ(scene.truth->frames[0].depth_encoding, "synthia");
  EXPECT_NO_THROW(read_depth_image(scene.truth->frames[0].depth, "synthia", scene.camera));
  const Image label = read_label_image(scene.truth->frames[0].label, scene.camera);
  EXPECT_EQ(label.data[22], 22);
  EXPECT_EQ(label.data[23], 0);
}

TEST_F(SynthiaSequence, LabelsBecomeTheSegmentationOnlyWhenAskedForAndSaySo) {
  options_.segmentation_from_labels = true;
  options_.camera_height = 1.9;
  options_.frames = "4";
  import_synthia_sf_to(options_, manifest());
  const Scene scene = read_scene(manifest());
  ASSERT_EQ(scene.frames.size(), 1u);
  EXPECT_EQ(scene.height_above_road, 1.9);
  EXPECT_EQ(scene.segmentation_source, "truth");
  EXPECT_EQ(scene.frames[0].segmentation, path("out/label/000004.png"));
  EXPECT_THAT(scene.segmentation_classes.at("road"), ElementsAre(1, 20));
  EXPECT_THAT(scene.segmentation_classes.at("pavement"), ElementsAre(2));
  EXPECT_THAT(scene.segmentation_classes.at("vehicle"), ElementsAre(14, 15, 16));
  EXPECT_FALSE(fs::exists(path("out/label/000003.png")));
}

TEST_F(SynthiaSequence, DetectionsInKittisForm) {
  write_bytes(path("boxes.txt"),
              "4 -1 Car -1 -1 -10 12 2 32 12 -1 -1 -1 -1000 -1000 -1000 -10 0.5");
  options_.detections = path("boxes.txt");
  const Scene scene = import_synthia_sf_to(options_, manifest());
  EXPECT_EQ(scene.detections_source, "network");
  EXPECT_EQ(scene.frames[1].vehicles.size(), 1u);
}

TEST_F(SynthiaSequence, ErrorsLeaveNothingBehind) {
  const auto refuse = [&](const char* part) {
    try {
      import_synthia_sf_to(options_, manifest());
      ADD_FAILURE() << "no error; expected " << part;
    } catch (const Error& error) {
      EXPECT_THAT(error.what(), HasSubstr(part));
    }
    EXPECT_TRUE(fs::is_empty(path("out")));
  };
  const std::string label = test::read_bytes(path("SEQ1/GTLeft/0000004.png"));
  write_bytes(path("SEQ1/GTLeft/0000004.png"), label.substr(0, label.size() / 2));
  refuse("GTLeft/0000004.png: found a truncated PNG image");
  test::write_png(path("SEQ1/GTLeft/0000004.png"), 32, 18, 0, 8, picture(32, 18, 1));
  refuse("found an image of 32 x 18 pixels, expected 64 x 36 as its colour image");
  fs::remove(path("SEQ1/GTLeft/0000004.png"));
  options_.segmentation_from_labels = true;
  refuse("GTLeft: found no label image of frame 4");
  test::write_png(path("SEQ1/RGBLeft/0000003.png"), 64, 40, 2, 8, picture(64, 40, 3));
  refuse("expected 64 x 40 as 0000003.png");
  options_.frames = "3";
  refuse("found an image of 64 x 40 pixels, expected the shape of SYNTHIA-SF's 1920 x 1080");
  options_.sequence = path("SEQ2");
  refuse("SEQ2/RGBLeft: is not a folder");
}

TEST_F(SynthiaSequence, TheFullCameraIsTheDataSets) {
  const PinholeCamera camera = synthia_sf_camera(1920, 1080);
  EXPECT_EQ(camera.fx, 847.630211643);
  EXPECT_EQ(camera.cx, 960);
  EXPECT_EQ(camera.cy, 540);
  EXPECT_THROW(synthia_sf_camera(1242, 375), std::invalid_argument);
}

}  // namespace
}  // namespace camber
