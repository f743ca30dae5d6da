#include "camber/import/kitti_labels.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "camber/core/errors.h"
#include "scene/write_image.h"
#include "support/test_data.h"

namespace camber {
namespace {

using test::write_bytes;
namespace fs = std::filesystem;

const char* const kTrackingRow =
    "48 1 Car 0 0 2.690273 765.744863 151.980301 1057.222841 254.512275 1.726279 1.736098 4.712874 "
    "5.434643 1.389847 13.434062 3.066446";
const char* const kObjectRow =
    "Pedestrian 0.25 2 -0.20 712.40 143.00 810.73 307.92 1.89 0.48 1.20 1.84 1.47 8.41 0.01";

class LabelFile : public ::testing::Test {
 protected:
  fs::path put(const std::string& text) {
    const fs::path path = folder_.path() / "labels.txt";
    write_bytes(path, text);
    return path;
  }
  std::string error_of(const std::string& text) {
    const fs::path path = put(text);
    try {
      read_kitti_labels(path);
    } catch (const InputError& error) {
      return std::string(error.what()).substr(path.string().size() + 2);
    }
    return "no error";
  }
  test::TemporaryFolder folder_;
};

TEST_F(LabelFile, ReadsTrackingRows) {
  const KittiLabelFile file = read_kitti_labels(
      put(std::string(kTrackingRow) + "\r\n\n" +
          "48 -1 DontCare -1 -1 -10.0 555.03 170.05 590.94 188.49 -1000 -1000 -1000 -10 -1 -1 -1"));
  EXPECT_EQ(file.form, KittiLabelForm::kTracking);
  ASSERT_EQ(file.labels.size(), 2u);
  const KittiLabel& car = file.labels[0];
  EXPECT_EQ(car.frame, 48);
  EXPECT_EQ(car.track, 1);
  EXPECT_EQ(car.type, "Car");
  EXPECT_EQ(car.truncated, 0);
  EXPECT_EQ(car.occluded, 0);
  EXPECT_EQ(car.alpha, 2.690273);
  EXPECT_EQ(car.box.x1, 765.744863);
  EXPECT_EQ(car.box.y2, 254.512275);
  EXPECT_EQ(car.height, 1.726279);
  EXPECT_EQ(car.width, 1.736098);
  EXPECT_EQ(car.length, 4.712874);
  EXPECT_EQ(car.location, Eigen::Vector3d(5.434643, 1.389847, 13.434062));
  EXPECT_EQ(car.rotation_y, 3.066446);
  EXPECT_TRUE(std::isnan(car.score));
  EXPECT_TRUE(car.has_box3());
  EXPECT_EQ(car.line, 1);
  EXPECT_TRUE(file.labels[1].dont_care());
  EXPECT_FALSE(file.labels[1].has_box3());
  EXPECT_EQ(file.labels[1].line, 3);
}

TEST_F(LabelFile, ReadsObjectRowsAndScores) {
  const KittiLabelFile file =
      read_kitti_labels(put(std::string(kObjectRow) + "\n" + kObjectRow + " -3.5e-1\n"));
  EXPECT_EQ(file.form, KittiLabelForm::kObject);
  ASSERT_EQ(file.labels.size(), 2u);
  EXPECT_EQ(file.labels[0].type, "Pedestrian");
  EXPECT_EQ(file.labels[0].truncated, 0.25);
  EXPECT_EQ(file.labels[0].occluded, 2);
  EXPECT_EQ(file.labels[0].frame, -1);
  EXPECT_EQ(file.labels[1].score, -0.35);
  const KittiLabelFile marked = read_kitti_labels(put(std::string("\xEF\xBB\xBF") + kObjectRow));
  ASSERT_EQ(marked.labels.size(), 1u);
  EXPECT_EQ(marked.labels[0].type, "Pedestrian");
  EXPECT_TRUE(read_kitti_labels(put("")).labels.empty());
  EXPECT_TRUE(read_kitti_labels(put("\n \t\n")).labels.empty());
}

TEST_F(LabelFile, ErrorsNameLineAndColumn) {
  EXPECT_EQ(error_of("48 1 Car 0 0 2.7 765 152\n"),
            "line 1: found 8 columns, expected 17 (KITTI tracking labels) or 18 with a score");
  EXPECT_EQ(error_of(std::string(kObjectRow) + "\nCar 0 0 1 2 3\n"),
            "line 2: found 6 columns, expected 15 (KITTI object labels) or 16 with a score");
  EXPECT_EQ(error_of("48 1 Car 0 0 2.7 765 152 abc 254 1.7 1.7 4.7 5.4 1.3 13.4 3.0"),
            "line 1, column 26: found 'abc', expected the box's right side in pixels");
  EXPECT_EQ(error_of("48 1 Car 0 0 2.7 765 152 nan 254 1.7 1.7 4.7 5.4 1.3 13.4 3.0"),
            "line 1, column 26: found 'nan', expected the box's right side in pixels");
  EXPECT_EQ(error_of("48 1 Car 0 0 2.7 765 152 inf 254 1.7 1.7 4.7 5.4 1.3 13.4 3.0"),
            "line 1, column 26: found 'inf', expected the box's right side in pixels");
  EXPECT_EQ(error_of("4.5 1 Car 0 0 2.7 765 152 999 254 1.7 1.7 4.7 5.4 1.3 13.4 3.0"),
            "line 1, column 1: found '4.5', expected a frame number");
  EXPECT_EQ(error_of("48 1 Car 0 7 2.7 765 152 999 254 1.7 1.7 4.7 5.4 1.3 13.4 3.0"),
            "line 1, column 12: found '7', expected the occlusion, an integer from -1 to 3");
  EXPECT_EQ(error_of("48 1 Car 0 0 2.7 765 152 700 254 1.7 1.7 4.7 5.4 1.3 13.4 3.0"),
            "line 1, column 18: found the box 765 152 700 254, expected left <= right and top <= "
            "bottom");
  EXPECT_EQ(error_of("48 1 3 0 0 2.7 765 152 999 254 1.7 1.7 4.7 5.4 1.3 13.4 3.0"),
            "line 1, column 6: found '3', expected a type like Car");
  EXPECT_EQ(error_of(std::string("48 1\0 Car", 9)),
            "line 1, column 5: found a null byte, expected text");
}

TEST_F(LabelFile, AnyDamageIsReadOrRefused) {
  const std::string text = std::string(kTrackingRow) + "\n" + kTrackingRow + " 0.5\n";
  for (std::size_t length = 0; length < text.size(); length += 3) error_of(text.substr(0, length));
  for (std::size_t i = 0; i < text.size(); i += 2) {
    for (const int bit : {0, 4, 6}) {
      std::string damaged = text;
      damaged[i] = static_cast<char>(damaged[i] ^ (1 << bit));
      error_of(damaged);
    }
  }
}

TEST_F(LabelFile, SurvivesWritingAndReading) {
  for (const std::string& text : {std::string(kTrackingRow) + "\n",
                                  std::string(kObjectRow) + " 0.75\n" + kObjectRow + " 0.5\n"}) {
    const KittiLabelFile file = read_kitti_labels(put(text));
    const fs::path again = folder_.path() / "again.txt";
    write_kitti_labels(file, again);
    const KittiLabelFile read = read_kitti_labels(again);
    ASSERT_EQ(read.labels.size(), file.labels.size());
    EXPECT_EQ(read.form, file.form);
    for (std::size_t i = 0; i < read.labels.size(); ++i) {
      const KittiLabel &a = file.labels[i], &b = read.labels[i];
      EXPECT_EQ(a.type, b.type);
      EXPECT_EQ(a.frame, b.frame);
      EXPECT_EQ(a.track, b.track);
      EXPECT_EQ(a.truncated, b.truncated);
      EXPECT_EQ(a.occluded, b.occluded);
      EXPECT_EQ(a.alpha, b.alpha);
      EXPECT_EQ(a.box.x1, b.box.x1);
      EXPECT_EQ(a.box.y2, b.box.y2);
      EXPECT_EQ(a.location, b.location);
      EXPECT_EQ(a.length, b.length);
      EXPECT_EQ(a.rotation_y, b.rotation_y);
      EXPECT_EQ(std::isnan(a.score), std::isnan(b.score));
      if (!std::isnan(a.score)) {
        EXPECT_EQ(a.score, b.score);
      }
    }
  }
  KittiLabelFile bad;
  bad.labels.emplace_back();
  bad.labels[0].type = "two words";
  EXPECT_THROW(write_kitti_labels(bad, folder_.path() / "bad.txt"), std::invalid_argument);
  EXPECT_FALSE(fs::exists(folder_.path() / "bad.txt"));
}

TEST(SharedLabels, AllOfThemRead) {
  CAMBER_REQUIRE_DATA("kitti-tracking-labels");
  const auto count = [](const char* name) {
    return read_kitti_labels(test::data_dir() / "kitti-tracking-labels/label_02" / name)
        .labels.size();
  };
  EXPECT_EQ(count("0003.txt"), 861u);
  EXPECT_EQ(count("0009.txt"), 5157u);
}

}  // namespace
}  // namespace camber
