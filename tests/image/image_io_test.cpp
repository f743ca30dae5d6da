#include "camber/image/image_io.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>

#include "camber/core/errors.h"
#include "camber/core/random.h"
#include "scene/write_image.h"
#include "support/test_data.h"

namespace camber {
namespace {

using test::picture;
using test::write_bytes;
using test::write_jpeg;
using test::write_png;
using ::testing::HasSubstr;
namespace fs = std::filesystem;

class ImageFile : public ::testing::Test {
 protected:
  fs::path path(const char* name) const { return folder_.path() / name; }

  /// The message of the InputError, after the file's name and ": "; "no error" without one.
  static std::string error_of(const fs::path& file, const std::function<void()>& read) {
    try {
      read();
    } catch (const InputError& error) {
      const std::string message = error.what();
      EXPECT_EQ(message.rfind(file.string() + ": ", 0), 0u) << message;
      EXPECT_EQ(message.find('\n'), std::string::npos);
      return message.substr(file.string().size() + 2);
    }
    return "no error";
  }

  PinholeCamera camera_{20, 12, 15, 15, 10, 6};
  test::TemporaryFolder folder_;
};

TEST_F(ImageFile, ReadsColorsAndGreyOfEveryKindOfPng) {
  const std::vector<std::uint8_t> rgb = picture(20, 12, 3);
  write_png(path("rgb.png"), 20, 12, 2, 8, rgb);
  write_png(path("interlaced.png"), 20, 12, 2, 8, rgb, true);
  EXPECT_EQ(read_color_image(path("rgb.png")).data, rgb);
  EXPECT_EQ(read_color_image(path("interlaced.png")).data, rgb);
  const Image grey = read_gray_image(path("rgb.png"));
  EXPECT_EQ(grey.channels, 1);
  ASSERT_EQ(grey.data.size(), 20u * 12u);
  for (std::size_t i = 0; i < grey.data.size(); ++i) {
    const double exact = 0.299 * rgb[3 * i] + 0.587 * rgb[3 * i + 1] + 0.114 * rgb[3 * i + 2];
    EXPECT_NEAR(grey.data[i], exact, 0.51);  // rounded once
  }

  const std::vector<std::uint8_t> one = picture(20, 12, 1);
  write_png(path("grey.png"), 20, 12, 0, 8, one);
  EXPECT_EQ(read_gray_image(path("grey.png")).data, one);
  const Image color = read_color_image(path("grey.png"));
  EXPECT_EQ(color.channels, 3);
  EXPECT_EQ(color.data[3 * 25 + 1], one[25]);

  std::vector<std::uint8_t> alpha;
  for (std::size_t i = 0; i < one.size(); ++i) {
    alpha.insert(alpha.end(), {rgb[3 * i], rgb[3 * i + 1], rgb[3 * i + 2], 100});
  }
  write_png(path("alpha.png"), 20, 12, 6, 8, alpha);
  EXPECT_EQ(read_color_image(path("alpha.png")).data, rgb);

  std::vector<std::uint8_t> wide;
  for (const std::uint8_t v : one) wide.insert(wide.end(), {v, v});  // v * 257
  write_png(path("wide.png"), 20, 12, 0, 16, wide);
  EXPECT_EQ(read_gray_image(path("wide.png")).data, one);
}

TEST_F(ImageFile, SamplesThatLeaveTheUpperBitsUnusedAreRefused) {
  const std::vector<std::uint8_t> one = picture(20, 12, 1);
  const auto write = [&](int bits) {
    std::vector<std::uint8_t> wide;
    for (const std::uint8_t v : one) {
      const int sample = v * ((1 << bits) - 1) / 255;
      wide.insert(wide.end(),
                  {static_cast<std::uint8_t>(sample >> 8), static_cast<std::uint8_t>(sample)});
    }
    write_png(path("wide.png"), 20, 12, 0, 16, wide);
  };
  const auto read = [&] { read_gray_image(path("wide.png")); };
  write(12);
  EXPECT_EQ(error_of(path("wide.png"), read),
            "found 16-bit samples that use the lower 12 bits alone, expected values that fill 16 "
            "bits: multiply them by 16");
  write(10);
  EXPECT_EQ(error_of(path("wide.png"), read),
            "found 16-bit samples that use the lower 10 bits alone, expected values that fill 16 "
            "bits: multiply them by 64");
  write(14);
  EXPECT_NO_THROW(read());
}

TEST_F(ImageFile, HeadersSayTheSize) {
  write_png(path("a.png"), 21, 13, 2, 8, picture(21, 13, 3));
  write_jpeg(path("a.jpg"), 40, 30, 1, picture(40, 30, 1));
  const ImageInfo png = read_image_info(path("a.png"));
  EXPECT_EQ(png.format, "PNG");
  EXPECT_EQ(png.width, 21);
  EXPECT_EQ(png.height, 13);
  EXPECT_EQ(png.channels, 3);
  EXPECT_EQ(png.bits, 8);
  const ImageInfo jpeg = read_image_info(path("a.jpg"));
  EXPECT_EQ(jpeg.format, "JPEG");
  EXPECT_EQ(jpeg.width, 40);
  EXPECT_EQ(jpeg.height, 30);
  EXPECT_EQ(jpeg.channels, 1);
}

TEST_F(ImageFile, ReadsJpeg) {
  // A smooth picture: JPEG at quality 95 keeps it within a few grey values.
  std::vector<std::uint8_t> smooth;
  for (int y = 0; y < 32; ++y) {
    for (int x = 0; x < 48; ++x) smooth.push_back(static_cast<std::uint8_t>(40 + 2 * x + 3 * y));
  }
  write_jpeg(path("a.jpg"), 48, 32, 1, smooth);
  const Image image = read_gray_image(path("a.jpg"));
  ASSERT_EQ(image.data.size(), smooth.size());
  for (std::size_t i = 0; i < smooth.size(); ++i) EXPECT_NEAR(image.data[i], smooth[i], 6);
}

TEST_F(ImageFile, FrameImagesMustHaveTheCamerasSize) {
  write_png(path("a.png"), 20, 12, 2, 8, picture(20, 12, 3));
  const FrameImage frame = read_frame_image(path("a.png"), camera_);
  EXPECT_EQ(frame.color.channels, 3);
  EXPECT_EQ(frame.gray.width, 20);
  PinholeCamera other = camera_;
  other.width = 21;
  EXPECT_EQ(error_of(path("a.png"), [&] { read_frame_image(path("a.png"), other); }),
            "found an image of 20 x 12 pixels, expected the camera's 21 x 12");
}

TEST_F(ImageFile, MissingForeignAndEmptyFilesAreRefused) {
  const auto read = [&](const char* name) {
    return error_of(path(name), [&] { read_color_image(path(name)); });
  };
  EXPECT_EQ(read("none.png"), "no such file");
  write_bytes(path("empty.png"), "");
  EXPECT_EQ(read("empty.png"), "found an empty file, expected a PNG or JPEG image");
  write_bytes(path("text.png"), "hello");
  EXPECT_EQ(read("text.png"), "found a file that is neither PNG nor JPEG, expected an image");
  fs::create_directory(path("folder.png"));
  EXPECT_EQ(read("folder.png"), "is a folder, expected a file");
}

TEST_F(ImageFile, EveryCutOfAnImageIsRefused) {
  write_png(path("whole.png"), 8, 5, 2, 8, picture(8, 5, 3));
  write_jpeg(path("whole.jpg"), 16, 8, 3, picture(16, 8, 3));
  for (const char* name : {"whole.png", "whole.jpg"}) {
    const std::string bytes = test::read_bytes(path(name));
    for (std::size_t length = 0; length < bytes.size(); ++length) {
      write_bytes(path("cut"), bytes.substr(0, length));
      const std::string message = error_of(path("cut"), [&] { read_color_image(path("cut")); });
      EXPECT_NE(message, "no error") << name << " cut to " << length << " of " << bytes.size();
    }
    write_bytes(path("cut"), bytes.substr(0, bytes.size() * 2 / 3));
    EXPECT_THAT(error_of(path("cut"), [&] { read_color_image(path("cut")); }),
                HasSubstr("found a truncated"));
  }
}

TEST_F(ImageFile, EveryFlippedByteOfAPngIsNoticed) {
  write_png(path("whole.png"), 8, 5, 2, 8, picture(8, 5, 3));
  const std::string bytes = test::read_bytes(path("whole.png"));
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    std::string damaged = bytes;
    damaged[i] = static_cast<char>(damaged[i] ^ 0x10);
    write_bytes(path("damaged"), damaged);
    EXPECT_NE(error_of(path("damaged"), [&] { read_color_image(path("damaged")); }), "no error")
        << "byte " << i;
  }
}

TEST_F(ImageFile, DamagedJpegsAreReadOrRefused) {
  write_jpeg(path("whole.jpg"), 16, 8, 3, picture(16, 8, 3));
  const std::string bytes = test::read_bytes(path("whole.jpg"));
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    std::string damaged = bytes;
    damaged[i] = static_cast<char>(damaged[i] ^ 0x10);
    write_bytes(path("damaged"), damaged);
    try {
      read_color_image(path("damaged"));
    } catch (const InputError&) {
    }
  }
}

TEST_F(ImageFile, SizesThatTheFileCannotHoldTakeNoMemory) {
  // A true header of 60000 x 60000 pixels with no pixels behind it.
  write_png(path("small.png"), 20, 12, 0, 8, picture(20, 12, 1));
  std::string bytes = test::read_bytes(path("small.png"));
  // IHDR of a 60000 x 60000 grey image, with its right checksum.
  const unsigned char header[] = {0x00, 0x00, 0xEA, 0x60, 0x00, 0x00, 0xEA, 0x60, 8, 0, 0, 0, 0};
  bytes.replace(16, 13, reinterpret_cast<const char*>(header), 13);
  std::uint32_t crc = 0xFFFFFFFFu;
  for (std::size_t i = 12; i < 29; ++i) {
    crc ^= static_cast<unsigned char>(bytes[i]);
    for (int k = 0; k < 8; ++k) crc = (crc >> 1) ^ (crc & 1 ? 0xEDB88320u : 0u);
  }
  crc = ~crc;
  for (int k = 0; k < 4; ++k) bytes[29 + k] = static_cast<char>(crc >> (24 - 8 * k));
  write_bytes(path("bomb.png"), bytes);
  EXPECT_THAT(error_of(path("bomb.png"), [&] { read_color_image(path("bomb.png")); }),
              HasSubstr("promises 60000 x 60000 pixels"));
}

TEST_F(ImageFile, LabelsKeepTheirValues) {
  std::vector<std::uint8_t> labels;
  for (int i = 0; i < 20 * 12; ++i) labels.push_back(static_cast<std::uint8_t>(i % 4));
  write_png(path("grey.png"), 20, 12, 0, 8, labels);
  write_png(path("two_bits.png"), 20, 12, 0, 2, labels);
  write_png(path("palette.png"), 20, 12, 3, 8, labels);
  write_png(path("small_palette.png"), 20, 12, 3, 2, labels);
  for (const char* name : {"grey.png", "two_bits.png", "palette.png", "small_palette.png"}) {
    const Image image = read_label_image(path(name), camera_);
    EXPECT_EQ(image.data, labels) << name;
    EXPECT_EQ(image.channels, 1);
  }
  write_png(path("rgb.png"), 20, 12, 2, 8, picture(20, 12, 3));
  EXPECT_EQ(error_of(path("rgb.png"), [&] { read_label_image(path("rgb.png"), camera_); }),
            "found a PNG of 3 channel(s) of 8 bits, expected a PNG of one channel of 8 bits");
  write_png(path("size.png"), 20, 13, 0, 8, picture(20, 13, 1));
  EXPECT_EQ(error_of(path("size.png"), [&] { read_label_image(path("size.png"), camera_); }),
            "found an image of 20 x 13 pixels, expected the camera's 20 x 12");
  const Image second = read_label_channel(path("rgb.png"), 1);
  EXPECT_EQ(second.data[22], picture(20, 12, 3)[3 * 22 + 1]);
  EXPECT_THROW(read_label_channel(path("grey.png"), 1), InputError);
}

TEST_F(ImageFile, WritesPng) {
  const Image color{20, 12, 3, picture(20, 12, 3)}, grey{20, 12, 1, picture(20, 12, 1)};
  write_png(color, path("color.png"));
  write_png(grey, path("grey.png"));
  EXPECT_EQ(read_color_image(path("color.png")).data, color.data);
  EXPECT_EQ(read_label_image(path("grey.png"), camera_).data, grey.data);
  EXPECT_THROW(write_png(Image{20, 12, 2, picture(20, 12, 2)}, path("a.png")),
               std::invalid_argument);
  EXPECT_THROW(write_png(Image{20, 12, 3, grey.data}, path("a.png")), std::invalid_argument);
  EXPECT_THROW(write_png(grey, path("no_folder/a.png")), OutputError);
}

TEST_F(ImageFile, PngOfADrawingAndOfNoise) {
  const auto size = [&](const Image& image, PngCompression compression) {
    const std::string bytes = encode_png(image, compression);
    write_bytes(path("a.png"), bytes);
    EXPECT_EQ(read_color_image(path("a.png")).data, image.data);
    return bytes.size();
  };
  Image drawing{200, 150, 3, std::vector<std::uint8_t>(200 * 150 * 3, 240)}, noise = drawing;
  const CounterRandom random(1);
  for (std::size_t i = 0; i < drawing.data.size(); ++i) {
    if (i / 600 % 40 < 3 || i / 3 % 50 == 0) drawing.data[i] = 20;        // a grid of lines
    noise.data[i] = static_cast<std::uint8_t>(100 + random.bits(i) % 8);  // 3 bits a sample
  }
  EXPECT_LT(size(drawing, PngCompression::kFast), drawing.data.size() / 100);
  EXPECT_LT(size(noise, PngCompression::kFast), noise.data.size() * 9 / 16);
  size(drawing, PngCompression::kSmall);
  size(noise, PngCompression::kSmall);
}

TEST_F(ImageFile, KittiDepthAndDisparity) {
  std::vector<std::uint8_t> samples;
  for (int i = 0; i < 20 * 12; ++i) {
    const int value = i == 0 ? 0 : 256 * i + 128;  // i + 0.5
    samples.push_back(static_cast<std::uint8_t>(value >> 8));
    samples.push_back(static_cast<std::uint8_t>(value & 255));
  }
  write_png(path("depth.png"), 20, 12, 0, 16, samples);
  const DepthImage depth = read_depth_image(path("depth.png"), "kitti", camera_);
  EXPECT_TRUE(std::isnan(depth.metres[0]));
  EXPECT_EQ(depth.metres[7], 7.5f);
  EXPECT_EQ(depth.metres[239], 239.5f);
  const DepthImage from_disparity = read_disparity_image(path("depth.png"), camera_, 0.5);
  EXPECT_TRUE(std::isnan(from_disparity.metres[0]));
  EXPECT_FLOAT_EQ(from_disparity.metres[7], 15.0f * 0.5f / 7.5f);
  EXPECT_THROW(read_disparity_image(path("depth.png"), camera_, 0.0), std::invalid_argument);
  write_png(path("byte.png"), 20, 12, 0, 8, picture(20, 12, 1));
  EXPECT_EQ(
      error_of(path("byte.png"), [&] { read_depth_image(path("byte.png"), "kitti", camera_); }),
      "found a PNG of 1 channel(s) of 8 bits, expected a PNG of one channel of 16 bits (metres * "
      "256)");
  EXPECT_THROW(read_depth_image(path("depth.png"), "npy", camera_), std::invalid_argument);
}

TEST_F(ImageFile, SynthiaDepth) {
  // 100 m is 1677721.5 steps: value 1677722 = 0x19999A, red the low byte.
  std::vector<std::uint8_t> samples(20 * 12 * 3, 0xFF);
  samples[0] = 0x9A;
  samples[1] = 0x99;
  samples[2] = 0x19;
  write_png(path("depth.png"), 20, 12, 2, 8, samples);
  const DepthImage depth = read_depth_image(path("depth.png"), "synthia", camera_);
  EXPECT_NEAR(depth.metres[0], 100.0, 1e-4);  // half a step is 3e-5 m
  EXPECT_TRUE(std::isnan(depth.metres[1]));   // 1000 m: sky
  // The same with an alpha channel, as SYNTHIA's own files have.
  std::vector<std::uint8_t> with_alpha;
  for (std::size_t i = 0; i < 20 * 12; ++i) {
    with_alpha.insert(with_alpha.end(),
                      {samples[3 * i], samples[3 * i + 1], samples[3 * i + 2], 255});
  }
  write_png(path("alpha.png"), 20, 12, 6, 8, with_alpha);
  EXPECT_EQ(read_depth_image(path("alpha.png"), "synthia", camera_).metres[0], depth.metres[0]);
}

TEST(SharedImages, DepthImagesAgreeWithTheTruePlanesUnderTheCars) {
  CAMBER_REQUIRE_DATA("steep-scenes/dev_00/truth/depth");
  // The bottom row of the picture shows the road a few metres ahead.
  const PinholeCamera kitti{1242, 375, 721.5377, 721.5377, 609.5593, 172.854};
  const DepthImage a = read_depth_image(
      test::data_dir() / "steep-scenes/dev_00/truth/depth/000000.png", "kitti", kitti);
  EXPECT_NEAR(a.metres[374 * 1242 + 609], 1.65 / ((374 - 172.854) / 721.5377), 0.6);
  const PinholeCamera synthia{960, 540, 423.8151, 423.8151, 479.75, 269.75};
  const DepthImage b = read_depth_image(
      test::data_dir() / "steep-scenes/dev_01/truth/depth/000000.png", "synthia", synthia);
  EXPECT_NEAR(b.metres[539 * 960 + 480], 1.95 / ((539 - 269.75) / 423.8151), 0.6);
}

}  // namespace
}  // namespace camber
