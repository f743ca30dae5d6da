#include "camber/image/raw_pixels.h"

#include <gtest/gtest.h>

namespace camber {
namespace {

using Bytes = std::vector<std::uint8_t>;

std::optional<Image> decoded(const std::string& encoding, int width, int height, std::size_t step,
                             const Bytes& data) {
  return decode_raw_pixels({width, height, encoding, step, data.data()});
}

TEST(RawPixels, GreyAndColoursWithPaddedRows) {
  // Two rows of two pixels and a byte of padding.
  const auto grey = decoded("mono8", 2, 2, 3, {1, 2, 99, 3, 4, 99});
  ASSERT_TRUE(grey);
  EXPECT_EQ(grey->channels, 1);
  EXPECT_EQ(grey->data, (Bytes{1, 2, 3, 4}));
  const Bytes colors = {1, 2, 3, 4, 5, 6, 99, 7, 8, 9, 10, 11, 12, 99};
  EXPECT_EQ(decoded("rgb8", 2, 2, 7, colors)->data, (Bytes{1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12}));
  for (const char* name : {"bgr8", "8UC3"}) {
    EXPECT_EQ(decoded(name, 2, 2, 7, colors)->data, (Bytes{3, 2, 1, 6, 5, 4, 9, 8, 7, 12, 11, 10}));
  }
  EXPECT_EQ(decoded("rgba8", 1, 2, 4, {1, 2, 3, 4, 5, 6, 7, 8})->data, (Bytes{1, 2, 3, 5, 6, 7}));
  EXPECT_EQ(decoded("bgra8", 1, 2, 4, {1, 2, 3, 4, 5, 6, 7, 8})->data, (Bytes{3, 2, 1, 7, 6, 5}));
}

TEST(RawPixels, EachBayerPatternGivesTheColourThatItSaw) {
  // A surface of one colour (R 200, G 120, B 40), seen through each pattern, is that colour again
  // at every pixel: bilinear interpolation of constants.
  const std::string cells = "rgb";
  const Bytes values = {200, 120, 40};
  for (const std::string pattern : {"rggb", "bggr", "gbrg", "grbg"}) {
    Bytes mosaic;
    for (int y = 0; y < 6; ++y) {
      for (int x = 0; x < 8; ++x) {
        const char cell = pattern[static_cast<std::size_t>(2 * (y % 2) + x % 2)];
        mosaic.push_back(values[cells.find(cell)]);
      }
    }
    const auto image = decoded("bayer_" + pattern + "8", 8, 6, 8, mosaic);
    ASSERT_TRUE(image);
    ASSERT_EQ(image->data.size(), 8u * 6u * 3u);
    for (std::size_t i = 0; i < image->data.size(); ++i) {
      ASSERT_EQ(image->data[i], values[i % 3]) << pattern << " at " << i;
    }
  }
}

TEST(RawPixels, LumaWithHalvedColours) {
  // Y 128 with neutral colours is grey; each order of its bytes.
  const Bytes uyvy = {128, 60, 128, 180, 128, 60, 128, 180};
  const Bytes yuy2 = {60, 128, 180, 128, 60, 128, 180, 128};
  for (const auto& image :
       {decoded("yuv422", 2, 2, 4, uyvy), decoded("yuv422_yuy2", 2, 2, 4, yuy2)}) {
    EXPECT_FALSE(image);  // smaller than a cell on either side
  }
  const auto wide = [](const Bytes& row) {
    Bytes out;
    for (int y = 0; y < 4; ++y) out.insert(out.end(), row.begin(), row.end());
    return out;
  };
  const auto a = decoded("yuv422", 4, 4, 8, wide(uyvy));
  const auto b = decoded("yuv422_yuy2", 4, 4, 8, wide(yuy2));
  ASSERT_TRUE(a && b);
  EXPECT_EQ(a->data, b->data);
  // BT.601: 1.164 (Y - 16)
  EXPECT_NEAR(a->data[0], 1.164 * 44, 1.0);
  EXPECT_NEAR(a->data[3], 1.164 * 164, 1.0);
}

TEST(RawPixels, NothingForWhatCannotBeDecoded) {
  const Bytes data(64, 0);
  EXPECT_FALSE(decoded("32FC1", 4, 4, 16, data));
  EXPECT_FALSE(decoded("", 4, 4, 16, data));
  EXPECT_FALSE(decoded("rgb8", 4, 4, 11, data));        // a row of 12 bytes
  EXPECT_FALSE(decoded("bayer_rggb8", 5, 4, 8, data));  // half a cell
  EXPECT_FALSE(decoded("bayer_rggb8", 2, 2, 8, data));  // one cell alone
  EXPECT_FALSE(decoded("mono8", 0, 4, 16, data));
  EXPECT_TRUE(decoded("mono8", 5, 4, 8, data));
}

}  // namespace
}  // namespace camber
