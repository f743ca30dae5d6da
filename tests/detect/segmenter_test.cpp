// Segmenters: labels at the image's pixels, and networks that OpenCV's joined layers corrupt.

#include "camber/detect/segmenter.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "camber/core/errors.h"
#include "detect/made_onnx.h"
#include "support/test_data.h"

namespace camber {
namespace {

using testing::HasSubstr;

/// Left half red, right half green, the lower quarter black.
Image halves(int width, int height) {
  Image out{width, height, 3, {}};
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const bool black = y >= 3 * height / 4, left = x < width / 2;
      out.data.push_back(!black && left ? 255 : 0);
      out.data.push_back(!black && !left ? 255 : 0);
      out.data.push_back(0);
    }
  }
  return out;
}

int label_at(const Image& labels, int x, int y) {
  return labels.data[static_cast<std::size_t>(y * labels.width + x)];
}

class Halves : public ::testing::Test {
 protected:
  Halves() {
    path_ = folder_.path() / "colors.onnx";
    description_.input.width = 64;
    description_.input.height = 32;
    description_.input.fit = NetworkInput::Fit::kStretch;
    description_.head = SegmenterHead::kArgmax;
    description_.names = {"other", "road", "pavement"};
    description_.classes = {{1}, {2}, {}};
    test::write_file(path_, test::color_segmenter(64, 32));
  }
  std::string refused() const {
    try {
      const Segmenter segmenter(path_, description_);
    } catch (const InputError& error) {
      return error.what();
    }
    return "taken";
  }
  test::TemporaryFolder folder_;
  std::filesystem::path path_;
  SegmenterDescription description_;
};

TEST_F(Halves, EveryPixelTakesTheClassOfTheLargestValue) {
  for (const auto fit : {NetworkInput::Fit::kStretch, NetworkInput::Fit::kLetterbox}) {
    description_.input.fit = fit;
    const Segmenter segmenter(path_, description_);
    for (const auto& [width, height] : {std::pair{64, 32}, {128, 64}, {128, 128}, {50, 40}}) {
      SCOPED_TRACE(std::to_string(width) + " x " + std::to_string(height));
      const Image labels = segmenter.segment(halves(width, height));
      ASSERT_EQ(labels.width, width);
      ASSERT_EQ(labels.data.size(), static_cast<std::size_t>(width) * height);
      int wrong = 0;
      for (int y = 0; y < height; ++y) {
        for (int x = 0; x < width; ++x) {
          // Off the edges by two pixels of the network.
          const int near = 2 * std::max({1, width / 64, height / 32}) + 1;
          if (std::abs(x - width / 2) < near || std::abs(y - 3 * height / 4) < near) continue;
          const int expected = y >= 3 * height / 4 ? 0 : x < width / 2 ? 1 : 2;
          wrong += label_at(labels, x, y) != expected;
        }
      }
      EXPECT_EQ(wrong, 0);
    }
  }
}

TEST_F(Halves, EdgesLieWhereTheColorsMeet) {
  const Segmenter segmenter(path_, description_);
  const Image labels = segmenter.segment(halves(64, 32));
  EXPECT_EQ(label_at(labels, 31, 5), kRoadLabel);
  EXPECT_EQ(label_at(labels, 32, 5), kPavementLabel);
  EXPECT_EQ(label_at(labels, 5, 23), kRoadLabel);
  EXPECT_EQ(label_at(labels, 5, 24), kOtherLabel);
}

TEST_F(Halves, PairsOfValuesAreMapsOfTheirOwn) {
  test::MadeConvolution red, green;
  red.name = "red";
  red.channels = {{{}, 0.5}, {{1.0, 0.0, 0.0}, 0.0}};
  green.name = "green";
  green.channels = {{{}, 0.5}, {{0.0, 1.0, 0.0}, 0.0}};
  test::write_file(path_, test::made_onnx(64, 32, 1, {red, green}));
  EXPECT_THAT(refused(), HasSubstr("expected one (1, 3, rows, columns) for head argmax"));
  description_.head = SegmenterHead::kPairs;
  EXPECT_THAT(refused(),
              HasSubstr("expected an output other (1, 2, rows, columns) for head pairs"));
  description_.names = {"red", "green"};
  description_.classes = {{0}, {}, {1}};
  const Image labels = Segmenter(path_, description_).segment(halves(64, 32));
  EXPECT_EQ(label_at(labels, 10, 5), kRoadLabel);
  EXPECT_EQ(label_at(labels, 50, 5), kVehicleLabel);
  EXPECT_EQ(label_at(labels, 50, 30), kOtherLabel);
}

TEST(Networks, JoinedLayersAreLeftOffWhereTheyCorrupt) {
  CAMBER_REQUIRE_DATA("networks");
  const auto folder = test::data_dir() / "networks";
  SegmenterDescription twin;
  twin.input.width = 640;
  twin.input.height = 192;
  twin.input.fit = NetworkInput::Fit::kStretch;
  twin.head = SegmenterHead::kPairs;
  twin.names = {"da", "ll"};
  twin.classes = {{0}, {}, {}};
  EXPECT_EQ(Segmenter(folder / "twinlitenet_192x640_cv46.onnx", twin).network().layers(),
            "unfused");
  SegmenterDescription intel = twin;
  intel.head = SegmenterHead::kArgmax;
  intel.names = {"other", "road", "curb", "mark"};
  intel.input.bgr = true;
  intel.input.high = 255.0;
  intel.classes = {{1, 3}, {2}, {}};
  EXPECT_EQ(
      Segmenter(folder / "road-segmentation-adas-0001_192x640.onnx", intel).network().layers(),
      "fused");
}

}  // namespace
}  // namespace camber
