// Networks on the frames of a drive: those of made ONNX files.

#include "camber/drive/detect_drive.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <vector>

#include "camber/image/image_io.h"
#include "detect/made_onnx.h"
#include "support/test_data.h"

namespace camber {
namespace {

constexpr int kWidth = 128, kHeight = 64;
constexpr std::size_t kFrames = 20;  // more than are looked at together

class DetectDrive : public ::testing::Test {
 protected:
  DetectDrive() {
    test::write_file(path("red.onnx"), test::red_cell_detector(kWidth, kHeight, 16.0));
    test::write_file(path("red.json"),
                     R"({"format": "camber-network", "version": 1, "task": "detector",
                         "input": {"width": 128, "height": 64, "fit": "stretch"},
                         "head": "fastestdet", "classes": ["other", "car"], "tiles": false})");
    test::write_file(path("colors.onnx"), test::color_segmenter(kWidth, kHeight));
    test::write_file(path("colors.json"),
                     R"({"format": "camber-network", "version": 1, "task": "segmenter",
                         "input": {"width": 128, "height": 64, "fit": "stretch"},
                         "head": "argmax", "classes": ["other", "road", "pavement"]})");
    scene_.camera.width = kWidth;
    scene_.camera.height = kHeight;
    scene_.camera.fx = scene_.camera.fy = 100.0;
    scene_.camera.cx = 64.0;
    scene_.camera.cy = 32.0;
    for (std::size_t k = 0; k < kFrames; ++k) {
      Image image;
      image.width = kWidth;
      image.height = kHeight;
      image.channels = 3;
      image.data.assign(3U * kWidth * kHeight, 0);
      for (std::size_t y = 40; y < 48; ++y) {
        const std::size_t left = 8 * (1 + k % 14);  // of a cell
        for (std::size_t x = left; x < left + 8; ++x) image.data[3 * (kWidth * y + x)] = 255;
      }
      SceneFrame frame;
      frame.id = static_cast<int>(k);
      frame.image = path(std::to_string(k) + ".png");
      write_png(image, frame.image);
      scene_.frames.push_back(frame);
      ids_.push_back(frame.id);
    }
    networks_.networks.segmenter = path("colors.onnx");
  }

  std::filesystem::path path(const std::string& name) const { return folder_.path() / name; }

  DriveNetworks see(Scene* scene) const {
    return detect_drive(scene, ids_, networks_, {}, path("labels"));
  }

  test::TemporaryFolder folder_;
  Scene scene_;
  std::vector<int> ids_;
  DetectFramesOptions networks_;
};

TEST_F(DetectDrive, LabelsOfAllFramesAreThoseOfEachAlone) {
  Scene seen = scene_;
  const DriveNetworks networks = see(&seen);
  ASSERT_TRUE(networks.view.segmenter.has_value());
  EXPECT_EQ(networks.view.segmenter->computed, static_cast<int>(kFrames));
  EXPECT_TRUE(networks.view.labels.empty());
  EXPECT_EQ(seen.segmentation_source.rfind("network:", 0), 0U);
  for (const std::size_t k : {std::size_t{0}, std::size_t{15}, std::size_t{16}, kFrames - 1}) {
    const NetworkView alone = detect_frames(scene_, {ids_[k]}, networks_);
    const Image labels = read_label_image(seen.frames[k].segmentation, {kWidth, kHeight});
    EXPECT_EQ(labels.data, alone.labels.at(ids_[k]).data) << k;
    EXPECT_GT(std::count(labels.data.begin(), labels.data.end(),
                         seen.segmentation_classes.at("road").at(0)),
              50)
        << k;
  }
}

TEST_F(DetectDrive, BoxesAndLabelsTogether) {
  networks_.networks.detector = path("red.onnx");
  Scene seen = scene_;
  see(&seen);
  for (const SceneFrame& frame : seen.frames) {
    EXPECT_EQ(frame.vehicles.size(), 1U) << frame.id;
    EXPECT_FALSE(frame.segmentation.empty()) << frame.id;
  }
}

TEST_F(DetectDrive, AFrameThatCannotBeReadHasNoLabels) {
  scene_.frames[3].image = path("missing.png");
  Scene seen = scene_;
  see(&seen);
  EXPECT_TRUE(seen.frames[3].segmentation.empty());
  EXPECT_FALSE(seen.frames[4].segmentation.empty());
}

}  // namespace
}  // namespace camber
