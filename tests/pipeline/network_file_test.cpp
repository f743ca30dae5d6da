// Side files of networks: what they say, and one sentence for what is wrong in them.

#include "camber/pipeline/network_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

#include "camber/core/errors.h"
#include "support/test_data.h"

namespace camber {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::Pair;

class NetworkFile : public ::testing::Test {
 protected:
  std::filesystem::path write(const std::string& text) {
    const auto path = folder_.path() / "net.json";
    std::ofstream(path) << text;
    return path;
  }
  DetectorDescription detector(const std::string& keys) {
    return read_detector_description(
        write(R"({"format": "camber-network", "version": 1, "task": "detector", )" + keys + "}"),
        [this](const std::string& text) { warnings_.push_back(text); });
  }
  SegmenterDescription segmenter(const std::string& keys) {
    return read_segmenter_description(
        write(R"({"format": "camber-network", "version": 1, "task": "segmenter", )" + keys + "}"));
  }
  std::string refused(const std::string& keys) {
    try {
      detector(keys);
    } catch (const InputError& error) {
      return error.what();
    }
    return "taken";
  }
  test::TemporaryFolder folder_;
  std::vector<std::string> warnings_;
};

TEST_F(NetworkFile, ADetectorIsDescribedInFull) {
  const DetectorDescription d = detector(
      R"("name": "mine", "input": {"width": 64, "height": 32, "fit": "letterbox",
         "align": "top_left", "padding": 7, "colors": "bgr", "range": [0, 255],
         "mean": [1, 2, 3], "std": [4, 5, 6]},
         "head": "yolox", "strides": [8, 16], "classes": ["person", "Car", "lorry"],
         "vehicles": {"Car": "car", "lorry": "truck"}, "score": 0.4, "overlap": 0.6,
         "tiles": {"side": 1.5, "overlap": 0.25, "most": 3}, "box_sigma_px": 1.5,
         "check": {"values": [{"output": "a", "index": [0, 2], "value": 3}], "tolerance": 0.5})");
  EXPECT_EQ(d.name, "mine");
  EXPECT_EQ(d.input.width, 64);
  EXPECT_EQ(d.input.height, 32);
  EXPECT_EQ(d.input.align, NetworkInput::Align::kTopLeft);
  EXPECT_EQ(d.input.padding, 7);
  EXPECT_TRUE(d.input.bgr);
  EXPECT_EQ(d.input.high, 255.0);
  EXPECT_THAT(d.input.mean, ElementsAre(1, 2, 3));
  EXPECT_THAT(d.input.std, ElementsAre(4, 5, 6));
  EXPECT_THAT(d.strides, ElementsAre(8, 16));
  EXPECT_THAT(d.vehicles, ElementsAre(Pair(1, "car"), Pair(2, "truck")));
  EXPECT_EQ(d.least_score, 0.4);
  EXPECT_EQ(d.most_overlap, 0.6);
  EXPECT_EQ(d.tiles.side, 1.5);
  EXPECT_EQ(d.tiles.overlap, 0.25);
  EXPECT_EQ(d.tiles.most, 3);
  EXPECT_EQ(d.box_sigma_px, 1.5);
  ASSERT_EQ(d.check.values.size(), 1u);
  EXPECT_EQ(d.check.values[0].output, "a");
  EXPECT_THAT(d.check.values[0].index, ElementsAre(0, 2));
  EXPECT_EQ(d.check.tolerance, 0.5);
  EXPECT_TRUE(warnings_.empty());
}

TEST_F(NetworkFile, CocoIsKnownAndUnknownKeysWarn) {
  const DetectorDescription d = detector(
      R"("input": {"width": 64, "height": 64}, "head": "yolov8", "classes": "coco",
         "tiles": false, "Score": 1)");
  EXPECT_EQ(d.classes.size(), 80u);
  EXPECT_THAT(d.vehicles, ElementsAre(Pair(2, "car"), Pair(5, "bus"), Pair(7, "truck")));
  EXPECT_FALSE(d.tiles.enabled);
  EXPECT_FALSE(d.box_sigma_px.has_value());
  ASSERT_EQ(warnings_.size(), 1u);
  EXPECT_THAT(warnings_[0], HasSubstr("Score"));
}

TEST_F(NetworkFile, WhatIsWrongIsOneSentence) {
  const std::string input = R"("input": {"width": 64, "height": 64}, )";
  EXPECT_THAT(refused(input + R"("head": "ssd", "classes": "coco")"),
              HasSubstr("net.json: head: found \"ssd\", expected one of yolox, yolov5, yolov8, "
                        "fastestdet"));
  EXPECT_THAT(refused(input + R"("head": "yolox", "classes": "voc")"),
              HasSubstr("classes: found \"voc\", expected \"coco\" or an array of names"));
  EXPECT_THAT(refused(input + R"("head": "yolox", "classes": ["person"])"),
              HasSubstr("found none of car, van, truck and bus"));
  EXPECT_THAT(refused(input + R"("head": "yolox", "classes": ["a"], "vehicles": {"b": "car"})"),
              HasSubstr("found the class \"b\", expected one of `classes`"));
  EXPECT_THAT(refused(input + R"("head": "yolox", "classes": "coco", "score": 1)"),
              HasSubstr("score: found 1, expected a number between 0 and 1"));
  EXPECT_THAT(refused(input + R"("head": "yolox", "classes": "coco", "strides": [7])"),
              HasSubstr("strides: 7, must be a divisor of the input's width and height"));
  EXPECT_THAT(refused(R"("head": "yolox", "classes": "coco")"), HasSubstr("input: missing"));
  EXPECT_THAT(refused(R"("input": {"width": 4, "height": 64}, "head": "yolox", "classes": "coco")"),
              HasSubstr("input.width: found 4, expected a whole number of pixels from 8 to 8192"));
  EXPECT_THAT(refused(R"("input": {"width": 64, "height": 64, "std": [1, 0, 1]},
                         "head": "yolox", "classes": "coco")"),
              HasSubstr("input.std: "));
  try {
    read_segmenter_description(
        write(R"({"format": "camber-network", "version": 1, "task": "detector"})"));
    FAIL() << "a detector's side file was taken for a segmenter's";
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), HasSubstr("task: found \"detector\", expected \"segmenter\""));
  }
  try {
    read_detector_description(folder_.path() / "none.json");
    FAIL() << "a file that is not there was read";
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), HasSubstr("none.json: no such file, expected the description of "
                                        "the detector"));
  }
}

TEST_F(NetworkFile, ASegmentersClassesAreKnownByNameOrGiven) {
  const std::string input = R"("input": {"width": 64, "height": 64, "fit": "stretch"}, )";
  const SegmenterDescription by_name = segmenter(
      input + R"("head": "argmax", "classes": ["sky", "road", "sidewalk", "car", "lane marking"])");
  EXPECT_EQ(by_name.input.fit, NetworkInput::Fit::kStretch);
  EXPECT_THAT(by_name.classes.road, ElementsAre(1, 4));
  EXPECT_THAT(by_name.classes.pavement, ElementsAre(2));
  EXPECT_THAT(by_name.classes.vehicle, ElementsAre(3));
  const SegmenterDescription given =
      segmenter(input + R"("head": "pairs", "classes": ["da", "ll"], "road": ["ll", "da"])");
  EXPECT_EQ(given.head, SegmenterHead::kPairs);
  EXPECT_THAT(given.classes.road, ElementsAre(1, 0));
  EXPECT_THROW(segmenter(input + R"("head": "pairs", "classes": ["da", "ll"])"), InputError);
  EXPECT_THROW(
      segmenter(input +
                R"("head": "pairs", "classes": ["da"], "road": ["da"], "pavement": ["da"])"),
      InputError);
}

TEST(SideFile, StandsBesideItsNetworkUnlessGiven) {
  EXPECT_EQ(side_file_of("a/net.onnx", ""), "a/net.json");
  EXPECT_EQ(side_file_of("a/net.onnx", "b.json"), "b.json");
}

}  // namespace
}  // namespace camber
