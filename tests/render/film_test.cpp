#include "camber/render/film.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/videoio.hpp>

#include "camber/core/errors.h"
#include "camber/image/video.h"
#include "camber/render/contact_sheet.h"
#include "camber/render/picture_file.h"
#include "support/test_data.h"

namespace camber {
namespace {

namespace fs = std::filesystem;

/// Grey with a bright half, left or right.
Image half_picture(int width, int height, bool left) {
  Image picture = make_picture(width, height, 40);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      if ((x < width / 2) != left) continue;
      std::uint8_t* p = &picture.data[3 * (static_cast<std::size_t>(y) * width + x)];
      p[0] = 220;  // red
      p[1] = 200;
      p[2] = 40;
    }
  }
  return picture;
}

class Film : public ::testing::TestWithParam<std::string> {
 protected:
  fs::path path() const { return folder_.path() / ("film" + GetParam()); }
  std::size_t files() const {
    return static_cast<std::size_t>(
        std::distance(fs::directory_iterator(folder_.path()), fs::directory_iterator{}));
  }
  test::TemporaryFolder folder_;
};

TEST_P(Film, HoldsItsPicturesInOrderAndTime) {
  FilmWriter film(path(), 12.5);
  EXPECT_EQ(film.codec(), "");
  for (int i = 0; i < 7; ++i) film.add(half_picture(321, 180, i % 2 == 0));  // an odd width
  EXPECT_FALSE(fs::exists(path()));
  film.finish();
  EXPECT_NE(film.codec(), "");
  EXPECT_EQ(files(), 1u);
  cv::VideoCapture reader(path().string());
  ASSERT_TRUE(reader.isOpened());
  EXPECT_NEAR(reader.get(cv::CAP_PROP_FPS), 12.5, 0.01);
  cv::Mat frame;
  for (int i = 0; i < 7; ++i) {
    ASSERT_TRUE(reader.read(frame)) << i;
    EXPECT_EQ(frame.cols, 322);
    EXPECT_EQ(frame.rows, 180);
    const cv::Vec3b bright = frame.at<cv::Vec3b>(90, i % 2 == 0 ? 60 : 260),
                    dark = frame.at<cv::Vec3b>(90, i % 2 == 0 ? 260 : 60);
    EXPECT_NEAR(bright[2], 220, 25);  // blue, green, red
    EXPECT_NEAR(bright[0], 40, 25);
    EXPECT_NEAR(dark[2], 40, 25);
  }
  EXPECT_FALSE(reader.read(frame));
}

TEST_P(Film, PartsAreJoinedInOrder) {
  std::vector<fs::path> parts;
  int drawn = 0;
  for (const int count : {6, 9, 1}) {
    parts.push_back(folder_.path() / ("part" + std::to_string(parts.size()) + GetParam()));
    FilmWriter film(parts.back(), 12.5);
    for (int i = 0; i < count; ++i) film.add(half_picture(320, 180, drawn++ % 3 == 0));
    film.finish();
  }
  join_films(parts, path());
  EXPECT_EQ(files(), 4u);
  cv::VideoCapture reader(path().string());
  ASSERT_TRUE(reader.isOpened());
  EXPECT_NEAR(reader.get(cv::CAP_PROP_FPS), 12.5, 0.05);
  cv::Mat frame;
  for (int i = 0; i < drawn; ++i) {
    ASSERT_TRUE(reader.read(frame)) << i;
    EXPECT_NEAR(frame.at<cv::Vec3b>(90, i % 3 == 0 ? 60 : 260)[2], 220, 25) << i;
    EXPECT_NEAR(frame.at<cv::Vec3b>(90, i % 3 == 0 ? 260 : 60)[2], 40, 25) << i;
  }
  EXPECT_FALSE(reader.read(frame));
  const std::unique_ptr<VideoReader> timed = open_video(path());  // OpenCV has no last times
  for (int i = 0; i < drawn; ++i) {
    ASSERT_TRUE(timed->next());
    EXPECT_NEAR(timed->time_s(), 0.08 * i, 0.001);
  }
  // Of another size: no film, and no part of one.
  fs::remove(path());
  FilmWriter other(parts[1], 12.5);
  other.add(half_picture(160, 90, true));
  other.finish();
  EXPECT_THROW(join_films(parts, path()), InputError);
  EXPECT_EQ(files(), 3u);
}

TEST_P(Film, NothingIsLeftBehindWithoutAnEnd) {
  {
    FilmWriter film(path(), 10.0);
    film.add(half_picture(64, 64, true));
    EXPECT_THROW(film.add(half_picture(66, 64, true)), std::invalid_argument);
  }
  EXPECT_EQ(files(), 0u);
  {
    FilmWriter film(path(), 10.0);
    EXPECT_THROW(film.finish(), std::invalid_argument);
  }
  EXPECT_EQ(files(), 0u);
}

TEST_P(Film, BadPlacesAndRates) {
  EXPECT_THROW(FilmWriter("/nonexistent-folder/film" + GetParam(), 10.0), OutputError);
  fs::create_directory(path());
  EXPECT_THROW(FilmWriter(path(), 10.0), OutputError);
  EXPECT_THROW(FilmWriter(folder_.path() / "film.gif", 10.0), std::invalid_argument);
  for (const double rate : {0.0, -1.0, 1000.0, std::nan("")}) {
    EXPECT_THROW(FilmWriter(folder_.path() / ("f" + GetParam()), rate), std::invalid_argument);
  }
  EXPECT_EQ(files(), 1u);
}

INSTANTIATE_TEST_SUITE_P(Containers, Film, ::testing::Values(".avi", ".mp4"),
                         [](const auto& made) { return made.param.substr(1); });

TEST(ContactSheet, PlacesPicturesInRowsAndColumns) {
  ContactSheetOptions options;
  options.width = 1000;
  ContactSheet sheet(5, options);
  for (int i = 0; i < 5; ++i) {
    sheet.add(half_picture(400, 100, i % 2 == 0), "picture " + std::to_string(i));
  }
  EXPECT_THROW(sheet.add(half_picture(400, 100, true), "one more"), std::invalid_argument);
  EXPECT_EQ(sheet.columns(), 1);  // five wide pictures
  const Image& drawn = sheet.sheet();
  EXPECT_LE(drawn.width, 1000);
  EXPECT_GE(drawn.width, 400);  // not shrunk without need
  // Each row's bright half alternates.
  const int pitch = (drawn.height - 1) / 5;
  for (int i = 0; i < 5; ++i) {
    const int y = i * pitch + 40;
    const auto red = [&](int x) {
      return drawn.data[3 * (static_cast<std::size_t>(y) * drawn.width + x)];
    };
    EXPECT_EQ(red(100), i % 2 == 0 ? 220 : 40) << i;
    EXPECT_EQ(red(300), i % 2 == 0 ? 40 : 220) << i;
  }
}

TEST(ContactSheet, ShrinksToItsWidthAndChecksItsInput) {
  ContactSheetOptions options;
  options.width = 500;
  options.columns = 3;
  ContactSheet sheet(4, options);
  for (int i = 0; i < 4; ++i) sheet.add(half_picture(400, 300, true), "a caption, far too long");
  EXPECT_EQ(sheet.columns(), 3);
  EXPECT_LE(sheet.sheet().width, 500);
  EXPECT_GT(sheet.sheet().width, 480);
  ContactSheet mixed(2, options);
  mixed.add(half_picture(400, 300, true), "");
  EXPECT_THROW(mixed.add(half_picture(300, 400, true), ""), std::invalid_argument);
  EXPECT_THROW(ContactSheet(0), std::invalid_argument);
  options.width = 0;
  EXPECT_THROW(ContactSheet(1, options), std::invalid_argument);
  options.width = 100;
  options.columns = 50;
  ContactSheet narrow(60, options);
  EXPECT_THROW(narrow.add(half_picture(400, 300, true), ""), std::invalid_argument);
}

}  // namespace
}  // namespace camber
