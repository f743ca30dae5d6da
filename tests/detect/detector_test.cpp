// Detectors: what their outputs mean, where boxes lie in the image, tiles and merging.

#include "camber/detect/detector.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "camber/core/errors.h"
#include "camber/detect/detail/detector_heads.h"
#include "detect/made_onnx.h"
#include "support/test_data.h"

namespace camber {
namespace {

using internal::decode_head;
using internal::HeadBox;
using test::red_cell_detector;
using testing::HasSubstr;

constexpr double kNear = 1e-4;  // px: floats of a few hundred

void expect_box(const Box2& box, double x1, double y1, double x2, double y2, double near = kNear) {
  EXPECT_NEAR(box.x1, x1, near);
  EXPECT_NEAR(box.y1, y1, near);
  EXPECT_NEAR(box.x2, x2, near);
  EXPECT_NEAR(box.y2, y2, near);
}

/// Two classes, the second one a car; 32 x 16 px.
DetectorDescription small(DetectorHead head) {
  DetectorDescription out;
  out.input.width = 32;
  out.input.height = 16;
  out.head = head;
  out.strides = {8, 16};
  out.classes = {"person", "car"};
  out.vehicles = {{1, "car"}};
  out.tiles.enabled = false;
  return out;
}

TEST(DetectorHead, YoloxCountsCellsRowByRowStrideByStride) {
  // 4 x 2 cells of 8 px, then 2 x 1 of 16 px.
  Tensor out{{1, 10, 7}, std::vector<float>(70, 0.0F)};
  const auto put = [&](std::size_t row, std::vector<float> values) {
    std::copy(values.begin(), values.end(), out.values.begin() + 7 * row);
  };
  put(6, {0.5F, 0.25F, std::log(2.0F), 0.0F, 0.9F, 0.1F, 0.8F});  // cell (2, 1) of stride 8
  put(9, {0.5F, 0.5F, 0.0F, std::log(0.5F), 1.0F, 0.2F, 0.9F});   // cell (1, 0) of stride 16
  put(3, {0.5F, 0.5F, 0.0F, 0.0F, 1.0F, 0.9F, 0.8F});             // a person
  put(4, {0.5F, 0.5F, 0.0F, 0.0F, 0.6F, 0.0F, 0.8F});             // 0.48 is below 0.5
  const std::vector<HeadBox> boxes = decode_head(small(DetectorHead::kYolox), {out}, "f");
  ASSERT_EQ(boxes.size(), 2u);
  EXPECT_NEAR(boxes[0].score, 0.72, 1e-6);
  EXPECT_EQ(boxes[0].class_number, 1);
  expect_box(boxes[0].box, 20 - 8, 10 - 4, 20 + 8, 10 + 4);
  expect_box(boxes[1].box, 24 - 8, 8 - 4, 24 + 8, 8 + 4);
}

TEST(DetectorHead, Yolov5AndYolov8GivePixels) {
  const Tensor five{{1, 2, 7}, {10, 8, 4, 6, 0.9F, 0, 0.9F, 1, 1, 1, 1, 0.2F, 0, 1}};
  std::vector<HeadBox> boxes = decode_head(small(DetectorHead::kYolov5), {five}, "f");
  ASSERT_EQ(boxes.size(), 1u);
  EXPECT_NEAR(boxes[0].score, 0.81, 1e-6);
  expect_box(boxes[0].box, 8, 5, 12, 11);

  const Tensor rows{{1, 2, 6}, {10, 8, 4, 6, 0, 0.7F, 5, 5, 2, 2, 0.9F, 0.1F}};
  Tensor columns{{1, 6, 2}, {10, 5, 8, 5, 4, 2, 6, 2, 0, 0.9F, 0.7F, 0.1F}};
  for (const Tensor& output : {rows, columns}) {
    boxes = decode_head(small(DetectorHead::kYolov8), {output}, "f");
    ASSERT_EQ(boxes.size(), 1u);
    EXPECT_NEAR(boxes[0].score, 0.7, 1e-6);
    expect_box(boxes[0].box, 8, 5, 12, 11);
  }
  columns.values[0] = std::numeric_limits<float>::quiet_NaN();
  EXPECT_TRUE(decode_head(small(DetectorHead::kYolov8), {columns}, "f").empty());
}

TEST(DetectorHead, AnotherShapeIsOneSentence) {
  const auto refused = [](DetectorHead head, const std::vector<Tensor>& outputs) {
    try {
      decode_head(small(head), outputs, "net.onnx");
    } catch (const InputError& error) {
      return std::string(error.what());
    }
    return std::string("taken");
  };
  const Tensor segmenter{{1, 4, 2, 4}, std::vector<float>(32)};
  EXPECT_THAT(refused(DetectorHead::kYolox, {segmenter}),
              HasSubstr("net.onnx: found output (1, 4, 2, 4), expected (1, 10, 7) for head yolox "
                        "with 2 classes at 32 x 16 px"));
  EXPECT_THAT(refused(DetectorHead::kYolov8, {segmenter}),
              HasSubstr("expected (1, 6, N) or (1, N, 6)"));
  const Tensor yolov8{{1, 6, 3}, std::vector<float>(18)};
  EXPECT_EQ(refused(DetectorHead::kYolov8, {yolov8}), "taken");
  EXPECT_THAT(refused(DetectorHead::kYolov8, {yolov8, yolov8}),
              HasSubstr("(1, 6, 3)  and (1, 6, 3) "));
  EXPECT_THAT(refused(DetectorHead::kYolov5, {yolov8}), HasSubstr("expected (1, N, 7)"));
  EXPECT_THAT(refused(DetectorHead::kFastestDet, {segmenter}), HasSubstr("expected (1, 7, N, N)"));
}

TEST(DetectionParts, TilesCoverTheWidthAndOverlap) {
  DetectionTiles tiles;
  tiles.side = 1.2;
  tiles.overlap = 0.1;
  const std::vector<ImagePart> parts = detection_parts(1242, 375, tiles);
  ASSERT_EQ(parts.size(), 4u);
  EXPECT_EQ(parts[0].width, 1242);
  EXPECT_EQ(parts[0].height, 375);
  EXPECT_EQ(parts[1].x, 0);
  EXPECT_EQ(parts[3].x + parts[3].width, 1242);
  for (std::size_t i = 2; i < parts.size(); ++i) {
    EXPECT_LE(parts[i].x, parts[i - 1].x + parts[i - 1].width - 0.1 * parts[i].width + 1);
  }
  tiles.most = 2;
  EXPECT_EQ(detection_parts(1242, 375, tiles).size(), 3u);
  EXPECT_EQ(detection_parts(1242, 375, tiles)[2].x + detection_parts(1242, 375, tiles)[2].width,
            1242);
  tiles.enabled = false;
  EXPECT_EQ(detection_parts(1242, 375, tiles).size(), 1u);
  tiles = {};
  EXPECT_EQ(detection_parts(400, 400, tiles).size(), 1u) << "a square image is its only tile";
}

TEST(MergeDetections, KeepsTheBestOfBoxesThatAreOneVehicle) {
  const std::vector<DetectedVehicle> merged = merge_detections({{"car", 0.6, {0, 0, 10, 10}},
                                                                {"truck", 0.9, {1, 0, 11, 10}},
                                                                {"car", 0.7, {50, 0, 60, 10}},
                                                                {"car", 0.5, {52, 2, 56, 6}},
                                                                {"car", 0.8, {56, 0, 66, 10}}},
                                                               0.45);
  ASSERT_EQ(merged.size(), 3u);
  EXPECT_EQ(merged[0].vehicle_class, "truck");
  EXPECT_EQ(merged[1].score, 0.8);
  EXPECT_EQ(merged[2].score, 0.7);
}

/// An image, black but for red rectangles.
class RedCells : public ::testing::Test {
 protected:
  RedCells() {
    path_ = folder_.path() / "red.onnx";
    description_.input.width = description_.input.height = 64;
    description_.input.padding = 0;
    description_.head = DetectorHead::kFastestDet;
    description_.classes = {"other", "car"};
    description_.vehicles = {{1, "car"}};
    description_.tiles.enabled = false;
    test::write_file(path_, red_cell_detector(64, 64, 16.0));
  }
  static Image black(int width, int height) {
    return {width, height, 3, std::vector<std::uint8_t>(3u * width * height, 0)};
  }
  static void paint(Image& image, int x, int y, int width, int height) {
    for (int v = y; v < y + height; ++v) {
      for (int u = x; u < x + width; ++u) image.data[3u * (v * image.width + u)] = 255;
    }
  }
  std::vector<DetectedVehicle> found(const Image& image, int threads = 1) const {
    return Detector(path_, description_).detect(image, threads);
  }
  test::TemporaryFolder folder_;
  std::filesystem::path path_;
  DetectorDescription description_;
};

TEST_F(RedCells, ABoxLiesWhereItsPixelsLie) {
  Image image = black(64, 64);
  paint(image, 24, 40, 8, 8);  // edges at 23.5 and 31.5: the middle is 27.5
  const auto boxes = found(image);
  ASSERT_EQ(boxes.size(), 1u);
  EXPECT_EQ(boxes[0].vehicle_class, "car");
  EXPECT_NEAR(boxes[0].score, 1.0, 1e-5);
  expect_box(boxes[0].box, 19.5, 35.5, 35.5, 51.5, 1e-3);
}

TEST_F(RedCells, ALetterboxIsTakenBack) {
  Image image = black(128, 64);  // half as large, 16 rows of padding above and below
  paint(image, 48, 16, 16, 16);
  for (const auto align : {NetworkInput::Align::kCenter, NetworkInput::Align::kTopLeft}) {
    description_.input.align = align;
    const auto boxes = found(image);
    ASSERT_EQ(boxes.size(), 1u);
    expect_box(boxes[0].box, 55.5 - 16, 23.5 - 16, 55.5 + 16, 23.5 + 16, 1e-3);
  }
  description_.input.fit = NetworkInput::Fit::kStretch;  // 64 x 64 by 1/2 and 1
  Image other = black(128, 64);
  paint(other, 48, 16, 16, 8);
  const auto boxes = found(other);
  ASSERT_EQ(boxes.size(), 1u);
  expect_box(boxes[0].box, 55.5 - 16, 19.5 - 8, 55.5 + 16, 19.5 + 8, 1e-3);
}

TEST_F(RedCells, ColorsAreInTheOrderOfTheDescription) {
  Image image = black(64, 64);
  paint(image, 24, 40, 8, 8);
  description_.input.bgr = true;  // red is the third channel now
  EXPECT_TRUE(found(image).empty());
  description_.input.bgr = false;
  description_.input.mean = {0.5, 0.0, 0.0};  // (1 - 0.5)^0.6 = 0.66
  EXPECT_NEAR(found(image).at(0).score, std::pow(0.5, 0.6), 1e-5);
  description_.input.std = {0.5, 1.0, 1.0};
  EXPECT_NEAR(found(image).at(0).score, 1.0, 1e-5);
}

TEST_F(RedCells, TilesShowWhatIsSmall) {
  Image image = black(256, 64);
  paint(image, 136, 24, 8, 8);  // a quarter as large in the whole image
  EXPECT_TRUE(found(image).empty());
  description_.tiles = {true, 1.0, 0.0, 8};
  const auto boxes = found(image);
  ASSERT_EQ(boxes.size(), 1u);
  expect_box(boxes[0].box, 131.5, 19.5, 147.5, 35.5, 1e-3);
  Image at_edge = black(256, 64);
  paint(at_edge, 128, 24, 8, 8);
  EXPECT_TRUE(found(at_edge).empty()) << "cut by the tile, shown by no other";
  description_.tiles.overlap = 0.5;
  ASSERT_EQ(found(at_edge).size(), 1u);
  const auto one = found(at_edge, 1), two = found(at_edge, 2);
  ASSERT_EQ(one.size(), two.size());
  EXPECT_EQ(one[0].box.x1, two[0].box.x1);
}

TEST_F(RedCells, WhatIsNoSuchNetworkIsRefused) {
  const auto refused = [&] {
    try {
      Detector(path_, description_);
    } catch (const InputError& error) {
      return std::string(error.what());
    }
    return std::string("taken");
  };
  EXPECT_EQ(refused(), "taken");
  description_.check.values = {{"", {0, 6, 0, 0}, 1.0}};
  EXPECT_EQ(refused(), "taken");
  description_.check.values = {{"out", {0, 6, 0, 0}, 0.9}};
  EXPECT_THAT(refused(), HasSubstr("for the check image is 1, expected 0.9 at (0, 6, 0, 0)"));
  description_.check.values = {{"", {0, 6, 0}, 1.0}};
  EXPECT_THAT(refused(), HasSubstr("found an output (1, 7, 8, 8)"));
  description_.check.values = {{"other", {0}, 1.0}};
  EXPECT_THAT(refused(), HasSubstr("found output (1, 7, 8, 8), expected the output other"));
  description_.check.values.clear();
  description_.classes.push_back("bus");
  EXPECT_THAT(refused(), HasSubstr("found output (1, 7, 8, 8), expected (1, 8, N, N)"));
  test::write_file(path_, "no network at all");
  EXPECT_THAT(refused(), HasSubstr("red.onnx: found no network that OpenCV can load"));
  test::write_file(path_, "");
  EXPECT_THAT(refused(), HasSubstr("red.onnx: "));
  std::filesystem::remove(path_);
  EXPECT_THAT(refused(), HasSubstr("red.onnx: "));
}

}  // namespace
}  // namespace camber
