#include "camber/image/video.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <opencv2/core.hpp>
#include <opencv2/videoio.hpp>

#include "camber/core/errors.h"
#include "support/test_data.h"

namespace camber {
namespace {

namespace fs = std::filesystem;
using test::read_text;
using testing::HasSubstr;

constexpr int kWidth = 96, kHeight = 64, kFrames = 24;
const PinholeCamera kCamera = {kWidth, kHeight, 100, 100, 48, 32};

/// Frame i is of intensity 10 i, its left quarter bright.
class Videos : public ::testing::Test {
 protected:
  fs::path write(const std::string& name, const char* c) {
    const fs::path path = folder_.path() / name;
    cv::VideoWriter writer(path.string(), cv::CAP_FFMPEG,
                           cv::VideoWriter::fourcc(c[0], c[1], c[2], c[3]), 25.0,
                           cv::Size(kWidth, kHeight));
    EXPECT_TRUE(writer.isOpened());
    for (int i = 0; i < kFrames; ++i) {
      cv::Mat picture(kHeight, kWidth, CV_8UC3, cv::Scalar::all(10 * i));
      picture.colRange(0, kWidth / 4).setTo(cv::Scalar::all(255));
      writer.write(picture);
    }
    return path;
  }
  static int level(const FrameImage& image) { return image.gray.row(kHeight / 2)[kWidth - 8]; }
  void put(const fs::path& path, const std::string& bytes) {
    std::ofstream(path, std::ios::binary) << bytes;
  }
  test::TemporaryFolder folder_;
};

TEST_F(Videos, EveryFrameHasItsTimeAndItsPicture) {
  for (const auto& [name, codec] :
       {std::pair("a.mp4", "avc1"), std::pair("b.avi", "MJPG"), std::pair("c.mkv", "mp4v")}) {
    SCOPED_TRACE(name);
    const fs::path path = write(name, codec);
    const VideoScan scan = scan_video(path);
    EXPECT_EQ(scan.info.width, kWidth);
    EXPECT_EQ(scan.info.height, kHeight);
    EXPECT_EQ(scan.info.rotation_deg, 0);
    EXPECT_EQ(scan.damaged, 0);
    ASSERT_EQ(scan.times.size(), static_cast<std::size_t>(kFrames));
    for (int i = 0; i < kFrames; ++i)
      EXPECT_NEAR(scan.times[static_cast<std::size_t>(i)], i / 25.0, 0.0011);  // mkv: ms
    FrameImageReader reader;
    for (const int i : {0, 3, 22, 23, 5}) {  // on, then back
      const FrameImage image = reader.read(path.string() + "#" + std::to_string(i), kCamera);
      EXPECT_NEAR(level(image), 10 * i, 4) << i;  // of a lossy codec
      EXPECT_GT(image.color.row(0)[0], 240);
    }
    const std::vector<FrameImage> several =
        read_frame_images({path.string() + "#7", path.string() + "#2", path.string() + "#7"},
                          Undistortion(kCamera), 2);
    EXPECT_NEAR(level(several[0]), 70, 4);
    EXPECT_NEAR(level(several[1]), 20, 4);
    EXPECT_EQ(several[0].gray.pixels, several[2].gray.pixels);
    try {
      reader.read(path.string() + "#24", kCamera);
      FAIL();
    } catch (const InputError& error) {
      EXPECT_THAT(error.what(),
                  HasSubstr("found 24 whole frames in the video, expected a frame 24"));
    }
  }
}

TEST_F(Videos, ACutOneHasItsWholeFrames) {
  const fs::path path = write("a.avi", "MJPG");
  const std::string bytes = read_text(path);
  const fs::path cut = folder_.path() / "cut.avi";
  std::size_t at = bytes.find("movi");
  for (int i = 0; i < 13; ++i) at = bytes.find("00dc", at + 4);
  put(cut, bytes.substr(0, at + 100));  // within frame 12
  const VideoScan scan = scan_video(cut);
  EXPECT_EQ(scan.times.size(), 12u);
  EXPECT_EQ(scan.damaged, 1);
  EXPECT_EQ(scan.info.stated_frames, kFrames);
  FrameImageReader reader;
  const int last = static_cast<int>(scan.times.size()) - 1;
  EXPECT_NEAR(level(reader.read(cut.string() + "#" + std::to_string(last), kCamera)), 10 * last, 4);
}

TEST_F(Videos, ThatAskToBeTurnedAre) {
  std::string bytes = read_text(write("a.mp4", "avc1"));
  const std::size_t header = bytes.find("tkhd");
  ASSERT_NE(header, std::string::npos);
  const unsigned char quarter[36] = {0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0xff, 0xff, 0,    0, 0, 0,
                                     0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0,    0,    0x40, 0, 0, 0};
  bytes.replace(header + 44, 36, reinterpret_cast<const char*>(quarter), 36);
  const fs::path turned = folder_.path() / "turned.mp4";
  put(turned, bytes);
  const VideoScan scan = scan_video(turned);
  EXPECT_EQ(scan.info.rotation_deg, 90);
  EXPECT_EQ(scan.info.width, kHeight);
  EXPECT_EQ(scan.info.height, kWidth);
  const auto video = open_video(turned);
  ASSERT_TRUE(video->next());
  const Image image = video->image();
  EXPECT_EQ(image.width, kHeight);
  EXPECT_GT(image.row(2)[3 * 40], 240);  // what was left is above
  EXPECT_LT(image.row(kWidth - 3)[3 * 40], 16);
}

TEST_F(Videos, ThatCannotBeReadAreRefused) {
  const fs::path text = folder_.path() / "text.mp4";
  put(text, "this is no video");
  for (const fs::path& path : {text, folder_.path() / "none.mp4", folder_.path()}) {
    EXPECT_THROW(open_video(path), InputError) << path;
  }
  const std::string bytes = read_text(write("a.mp4", "avc1"));
  const fs::path list = folder_.path() / "list.txt";
  put(list, "ffconcat version 1.0\nfile a.mp4\n");
  try {
    open_video(list);
    ADD_FAILURE() << "the frames of a file that a list names were read";
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), HasSubstr("it names other files"));
  }
  for (std::size_t length = 16; length < bytes.size(); length += bytes.size() / 40) {
    put(text, bytes.substr(0, length));
    try {
      EXPECT_LE(scan_video(text).times.size(), static_cast<std::size_t>(kFrames));
    } catch (const InputError&) {
    }
  }
}

TEST_F(Videos, FramesAreNamedByTheirNumber) {
  const auto name = video_frame_name("drive.mp4#120");
  ASSERT_TRUE(name);
  EXPECT_EQ(name->file, "drive.mp4");
  EXPECT_EQ(name->index, 120);
  for (const char* other : {"a.png", "a#b.png", "a#", "#5", "a#-1", "a#99999999999"}) {
    EXPECT_FALSE(video_frame_name(other)) << other;
  }
  const fs::path file = folder_.path() / "picture#7";
  put(file, "x");
  EXPECT_FALSE(video_frame_name(file));  // a file of that name wins
  EXPECT_EQ(image_file_of("drive.mp4#3"), "drive.mp4");
  EXPECT_EQ(image_file_of(file), file);
}

}  // namespace
}  // namespace camber
