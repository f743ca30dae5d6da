#include "camber/pipeline/recognise_detector.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "camber/core/errors.h"
#include "camber/pipeline/detect_frames.h"
#include "detect/made_onnx.h"
#include "support/test_data.h"

namespace camber {
namespace {

using ::testing::HasSubstr;

RecognisedDetector recognised(const std::vector<int>& input, const std::vector<int>& output,
                              const std::string& names = {}) {
  return recognise_detector({"made", test::declared_onnx(input, output, names)});
}

TEST(RecogniseDetector, KnowsTheHeadsByTheirShapes) {
  const struct {
    std::vector<int> input, output;
    DetectorHead head;
  } cases[] = {
      {{1, 3, 416, 416}, {1, 3549, 85}, DetectorHead::kYolox},
      {{1, 3, 640, 640}, {1, 25200, 85}, DetectorHead::kYolov5},
      {{1, 3, 640, 640}, {1, 84, 8400}, DetectorHead::kYolov8},
      {{1, 3, 384, 640}, {1, 5040, 84}, DetectorHead::kYolov8},  // transposed
      {{1, 3, 352, 352}, {1, 85, 22, 22}, DetectorHead::kFastestDet},
  };
  for (const auto& [input, output, head] : cases) {
    const RecognisedDetector found = recognised(input, output);
    ASSERT_TRUE(found.description) << found.reason;
    EXPECT_EQ(found.description->head, head) << found.reason;
    EXPECT_EQ(found.description->input.height, input[2]);
    EXPECT_EQ(found.description->input.width, input[3]);
    EXPECT_EQ(found.description->classes.size(), 80u);
    EXPECT_EQ(found.description->vehicles.at(2), "car");
  }
}

TEST(RecogniseDetector, TakesColoursAndPlaceOfThePixelsFromTheProgram) {
  const NetworkInput yolox = recognised({1, 3, 416, 416}, {1, 3549, 85}).description->input;
  EXPECT_TRUE(yolox.bgr);
  EXPECT_EQ(yolox.high, 255.0);
  EXPECT_EQ(yolox.align, NetworkInput::Align::kTopLeft);
  const NetworkInput yolov8 = recognised({1, 3, 640, 640}, {1, 84, 8400}).description->input;
  EXPECT_FALSE(yolov8.bgr);
  EXPECT_EQ(yolov8.high, 1.0);
  EXPECT_EQ(yolov8.align, NetworkInput::Align::kCenter);
}

TEST(RecogniseDetector, TakesTheNamesOfTheExport) {
  const RecognisedDetector found =
      recognised({1, 3, 640, 640}, {1, 7, 8400}, "{0: 'person', 1: 'car', 2: \"bus\"}");
  ASSERT_TRUE(found.description) << found.reason;
  EXPECT_EQ(found.description->vehicles, (std::map<int, std::string>{{1, "car"}, {2, "bus"}}));
}

TEST(RecogniseDetector, SaysWhatItFoundWhereThatIsNotEnough) {
  EXPECT_FALSE(recognised({1, 3, 640, 640}, {1, 7, 8400}).description);  // classes of what names?
  EXPECT_THAT(recognised({1, 3, 640, 640}, {1, 7, 8400}).reason, HasSubstr("3 classes"));
  EXPECT_FALSE(recognised({1, 3, 640, 640}, {1, 1000}).description);
  EXPECT_THAT(recognised({1, 3, 640, 640}, {1, 1000}).reason, HasSubstr("(1, 1000)"));
  EXPECT_FALSE(recognised({1, 3, 640, 640}, {1, 100, 85}).description);  // no grid has 100 cells
  EXPECT_FALSE(recognised({1, 3, 192, 640}, {1, 4, 192, 640}).description);  // a segmenter
  const std::string names = "{0: 'cat', 1: 'dog', 2: 'cow'}";
  EXPECT_FALSE(recognised({1, 3, 640, 640}, {1, 7, 8400}, names).description);
  const std::string whole = test::declared_onnx({1, 3, 640, 640}, {1, 84, 8400});
  for (std::size_t size = 0; size < whole.size(); ++size) {
    recognise_detector({"cut", whole.substr(0, size)});
  }
}

TEST(RecogniseDetector, KnowsNetworksOfTheirPrograms) {
  CAMBER_REQUIRE_DATA("networks/yolox_nano_coco.onnx");
  const auto of = [](const char* name) {
    return recognise_detector(read_onnx_file(test::data_dir() / "networks" / name));
  };
  const RecognisedDetector yolox = of("yolox_nano_coco.onnx"), fastest = of("FastestDet.onnx");
  ASSERT_TRUE(yolox.description) << yolox.reason;
  EXPECT_EQ(yolox.description->head, DetectorHead::kYolox);
  ASSERT_TRUE(fastest.description) << fastest.reason;
  EXPECT_EQ(fastest.description->head, DetectorHead::kFastestDet);
  EXPECT_FALSE(of("road-segmentation-adas-0001_192x640.onnx").description);
  EXPECT_FALSE(of("twinlitenet_192x640_cv46.onnx").description);
}

}  // namespace
}  // namespace camber
