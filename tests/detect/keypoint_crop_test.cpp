#include "camber/detect/keypoint_crop.h"

#include <gtest/gtest.h>

#include <limits>
#include <stdexcept>

namespace camber {
namespace {

/// Channel c at (x, y) is value(x, y) + c.
template <typename Value>
Image made_image(int width, int height, const Value& value) {
  Image out{width, height, 3, {}};
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      for (int c = 0; c < 3; ++c) out.data.push_back(static_cast<std::uint8_t>(value(x, y) + c));
    }
  }
  return out;
}

int at(const Image& image, int x, int y, int channel = 0) {
  return image.row(y)[x * image.channels + channel];
}

TEST(KeypointCrop, IsASquareAboutTheBoxWithAMargin) {
  const KeypointCrop crop = keypoint_crop({100.0, 40.0, 180.0, 80.0});
  EXPECT_DOUBLE_EQ(crop.center.x(), 140.0);
  EXPECT_DOUBLE_EQ(crop.center.y(), 60.0);
  EXPECT_DOUBLE_EQ(crop.side, 92.0);
  EXPECT_EQ(crop.size, 64);
}

TEST(KeypointCrop, PointsGoToTheImageAndBack) {
  const KeypointCrop crop = keypoint_crop({100.25, 40.5, 180.75, 81.0}, 48);
  // The crop's middle, between its pixels 23 and 24, is the box's.
  EXPECT_NEAR((crop.to_image({23.5, 23.5}) - crop.center).norm(), 0.0, 1e-12);
  // Its left edge is half a crop pixel left of its pixel 0.
  EXPECT_NEAR(crop.to_image({-0.5, 0.0}).x(), crop.center.x() - 0.5 * crop.side, 1e-12);
  for (const Eigen::Vector2d& point :
       {Eigen::Vector2d(0.0, 0.0), Eigen::Vector2d(47.0, 3.5), Eigen::Vector2d(-20.0, 90.0)}) {
    EXPECT_NEAR((crop.to_crop(crop.to_image(point)) - point).norm(), 0.0, 1e-12);
  }
}

TEST(KeypointCrop, OfTheSameSizeIsACopy) {
  const Image image = made_image(20, 20, [](int x, int y) { return 5 * x + 7 * y; });
  const Image crop = cut_crop(image, {{9.5, 9.5}, 16.0, 16});  // pixels 2 to 17
  for (int y = 0; y < 16; ++y) {
    for (int x = 0; x < 16; ++x) {
      for (int c = 0; c < 3; ++c) ASSERT_EQ(at(crop, x, y, c), at(image, x + 2, y + 2, c));
    }
  }
}

TEST(KeypointCrop, AveragesWhereItShrinks) {
  const Image image = made_image(8, 8, [](int x, int y) { return x % 2 == 0 ? 10 * y : 100; });
  // Crop pixel (1, 1) covers the image's columns and rows 2 and 3: (20 + 100 + 30 + 100) / 4.
  const Image half = cut_crop(image, {{3.5, 3.5}, 8.0, 4});
  EXPECT_EQ(at(half, 1, 1), 63);
  // 1.5 px each: the first pixel covers 0 and half of 1, both ways.
  const Image image2 = made_image(3, 3, [](int x, int) { return x == 0 ? 30 : 90; });
  const Image part = cut_crop(image2, {{1.0, 1.0}, 3.0, 2});
  EXPECT_EQ(at(part, 0, 0), 50);
  EXPECT_EQ(at(part, 1, 1), 90);
}

TEST(KeypointCrop, InterpolatesWhereItGrowsAndStaysWhereThePointsSay) {
  const Image image = made_image(40, 40, [](int x, int y) { return 3 * x + 2 * y; });
  const KeypointCrop crop{{20.3, 18.8}, 8.0, 64};
  const Image pixels = cut_crop(image, crop);
  for (int y = 0; y < 64; y += 9) {
    for (int x = 0; x < 64; x += 9) {
      const Eigen::Vector2d there = crop.to_image(Eigen::Vector2d(x, y));
      // A linear picture is interpolated exactly, but for the rounding to whole values.
      EXPECT_NEAR(at(pixels, x, y), 3.0 * there.x() + 2.0 * there.y(), 0.51);
    }
  }
}

TEST(KeypointCrop, IsGreyOutsideTheImage) {
  const Image image = made_image(10, 10, [](int, int) { return 200; });
  const Image crop = cut_crop(image, {{0.5, 4.5}, 20.0, 20});  // columns -9 to 10
  EXPECT_EQ(at(crop, 0, 10), kKeypointCropPadding);
  EXPECT_EQ(at(crop, 19, 10), kKeypointCropPadding);
  EXPECT_EQ(at(crop, 18, 0), kKeypointCropPadding);
  EXPECT_EQ(at(crop, 18, 10), 200);
  // A crop that shows nothing of the image.
  EXPECT_EQ(at(cut_crop(image, {{1e9, -1e9}, 20.0, 4}), 2, 2), kKeypointCropPadding);
}

TEST(KeypointCrop, RefusesBoxesWithoutExtent) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(keypoint_crop({3.0, 3.0, 3.0, 3.0}), std::invalid_argument);
  EXPECT_THROW(keypoint_crop({3.0, nan, 30.0, 30.0}), std::invalid_argument);
  EXPECT_THROW(keypoint_crop({0.0, 0.0, 30.0, 30.0}, 0), std::invalid_argument);
  EXPECT_THROW(cut_crop({}, keypoint_crop({0.0, 0.0, 30.0, 30.0})), std::invalid_argument);
}

}  // namespace
}  // namespace camber
