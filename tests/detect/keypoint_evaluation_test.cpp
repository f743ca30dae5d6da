#include "camber/detect/keypoint_evaluation.h"

#include <gtest/gtest.h>

#include <cmath>
#include <fstream>

#include "camber/core/errors.h"
#include "support/test_data.h"

namespace camber {
namespace {

/// Crops whose keypoints all lie at (20, 30) and are visible, found without error.
struct Made {
  std::vector<KeypointCropTruth> crops;
  std::vector<PredictedKeypoints> found;

  explicit Made(std::size_t count) : crops(count), found(count) {
    for (std::size_t i = 0; i < count; ++i) {
      crops[i].points.fill({20.0, 30.0});
      crops[i].box_side = 40.0;
      found[i].fill({{20.0, 30.0}, 1.0, 0.9});
    }
  }
};

TEST(EvaluateKeypoints, CountsErrorsByTheirLimits) {
  Made made(1);
  made.found[0][0].at = {22.0, 30.0};  // 2 px: near, 2 sigma
  made.found[0][1].at = {20.0, 33.5};  // 3.5 px: not near, below a tenth of the box
  made.found[0][2].at = {24.5, 30.0};  // 4.5 px: neither
  made.crops[0].visibility[2] = KeypointVisibility::kHiddenByOther;
  made.crops[0].points[3] = {-5.0, 30.0};  // outside: not counted
  const KeypointEvaluation e = evaluate_keypoints(made.crops, made.found);
  EXPECT_EQ(e.overall.all.count, 35U);
  EXPECT_EQ(e.overall.visible.count, 34U);
  EXPECT_EQ(e.overall.hidden.count, 1U);
  EXPECT_NEAR(e.overall.all.pck_2px, 33.0 / 35.0, 1e-12);
  EXPECT_NEAR(e.overall.all.pck_alpha, 34.0 / 35.0, 1e-12);
  EXPECT_NEAR(e.overall.visible.pck_alpha, 1.0, 1e-12);
  EXPECT_EQ(e.overall.hidden.pck_alpha, 0.0);
  // Coordinates: of 70, one is 2 sigma off, one 3.5, one 4.5.
  EXPECT_NEAR(e.overall.all.inside_sigmas[0], 67.0 / 70.0, 1e-12);
  EXPECT_NEAR(e.overall.all.inside_sigmas[1], 68.0 / 70.0, 1e-12);
  EXPECT_NEAR(e.overall.all.inside_sigmas[2], 68.0 / 70.0, 1e-12);
  EXPECT_EQ(e.by_keypoint[1].all.offset, Eigen::Vector2d(0.0, 3.5));
  EXPECT_EQ(e.by_keypoint[3].all.count, 0U);
  EXPECT_TRUE(std::isnan(e.by_keypoint[3].all.pck_2px));
}

TEST(EvaluateKeypoints, TheMedianOfTwoIsTheirMean) {
  Made made(2);
  made.found[0][0].at = {21.0, 30.0};
  made.found[1][0].at = {23.0, 30.0};
  const KeypointEvaluation e = evaluate_keypoints(made.crops, made.found);
  EXPECT_NEAR(e.by_keypoint[0].all.median, 2.0, 1e-12);
  EXPECT_EQ(e.by_keypoint[0].all.offset, Eigen::Vector2d(2.0, 0.0));
}

TEST(EvaluateKeypoints, RanksKeypointsForTheirPrecision) {
  Made made(4);
  // Keypoint 0 of four crops by falling probability: right, hidden (a false one), right, too far.
  const double probabilities[] = {0.9, 0.8, 0.7, 0.6};
  for (std::size_t i = 0; i < 4; ++i) made.found[i][0].visible = probabilities[i];
  made.crops[1].visibility[0] = KeypointVisibility::kHiddenByCar;
  made.found[3][0].at = {30.0, 30.0};
  const KeypointEvaluation e = evaluate_keypoints(made.crops, made.found);
  // Three to be found: recall 1/3 at precision 1, 2/3 at 2/3; the third is never found.
  EXPECT_NEAR(e.apk[0], (1.0 + 2.0 / 3.0) / 3.0, 1e-12);
  EXPECT_NEAR(e.apk[1], 1.0, 1e-12);
  EXPECT_NEAR(e.mean_apk, (35.0 + (1.0 + 2.0 / 3.0) / 3.0) / 36.0, 1e-12);
  EXPECT_NEAR(e.visibility_right, 143.0 / 144.0, 1e-12);
  EXPECT_NEAR(e.visible_by_probability[8], 0.0, 1e-12);
  EXPECT_TRUE(std::isnan(e.visible_by_probability[2]));
}

TEST(EvaluateKeypoints, SortsCropsByHeightAndHeading) {
  Made made(3);
  made.crops[0].box_height = 30.0;
  made.crops[1].box_height = 300.0;  // the third has none
  made.crops[0].azimuth = 1.5;       // from behind
  made.crops[1].azimuth = -3.1;      // from the left
  made.crops[2].azimuth = 0.1;       // from the right
  const KeypointEvaluation e = evaluate_keypoints(made.crops, made.found);
  EXPECT_EQ(e.by_height[1].all.count, 36U);
  EXPECT_EQ(e.by_height[4].all.count, 36U);
  EXPECT_EQ(e.by_height[2].all.count, 0U);
  EXPECT_EQ(e.by_heading[0].name, "right");
  EXPECT_EQ(e.by_heading[0].all.count, 36U);
  EXPECT_EQ(e.by_heading[2].all.count, 36U);
  EXPECT_EQ(e.by_heading[4].name, "left");
  EXPECT_EQ(e.by_heading[4].all.count, 36U);
  const std::string table = keypoint_table(e);
  EXPECT_NE(table.find("3 crops"), std::string::npos);
  EXPECT_NE(table.find("0 left rear wheel"), std::string::npos);
}

TEST(EvaluateKeypoints, RefusesAnotherNumberOfPredictions) {
  Made made(2);
  made.found.pop_back();
  EXPECT_THROW(evaluate_keypoints(made.crops, made.found), std::invalid_argument);
}

/// An array as NumPy writes it.
template <typename Value>
void write_npy(const std::filesystem::path& path, const std::string& type, const std::string& shape,
               const std::vector<Value>& values) {
  std::string header =
      "{'descr': '" + type + "', 'fortran_order': False, 'shape': (" + shape + "), }";
  header.resize(117, ' ');
  header += '\n';
  std::ofstream file(path, std::ios::binary);
  file << "\x93NUMPY\x01" << '\0' << static_cast<char>(header.size()) << '\0' << header;
  file.write(reinterpret_cast<const char*>(values.data()),
             static_cast<std::streamsize>(values.size() * sizeof(Value)));
}

class KeypointCropsFolder : public ::testing::Test {
 protected:
  void SetUp() override {
    folder = temporary_.path() / "crops";
    std::filesystem::remove_all(folder);
    std::filesystem::create_directories(folder);
    std::vector<unsigned char> pixels(2 * 64 * 64 * 3, 7), hidden(2 * 36, 0);
    pixels[64 * 64 * 3] = 99;
    hidden[36 + 5] = 2;
    std::vector<float> points(2 * 36 * 2, 3.5F);
    points[2 * 36 + 1] = -8.0F;
    write_npy(folder / "images.npy", "|u1", "2, 64, 64, 3", pixels);
    write_npy(folder / "visibility.npy", "|u1", "2, 36", hidden);
    write_npy(folder / "keypoints.npy", "<f4", "2, 36, 2", points);
    write_npy<float>(folder / "boxes.npy", "<f4", "2, 4", {0, 0, 0, 0, 4, 10, 54, 30});
    write_npy<float>(folder / "heading.npy", "<f4", "2, 3", {0, 0, 0, 1.25F, 0, 20});
  }
  test::TemporaryFolder temporary_;
  std::filesystem::path folder;
};

TEST_F(KeypointCropsFolder, IsRead) {
  const std::vector<KeypointCropTruth> crops = read_keypoint_crops(folder);
  ASSERT_EQ(crops.size(), 2U);
  EXPECT_EQ(crops[1].crop.data[0], 99);
  EXPECT_EQ(crops[1].points[0], Eigen::Vector2d(3.5, -8.0));
  EXPECT_EQ(crops[1].visibility[5], KeypointVisibility::kHiddenByOther);
  EXPECT_EQ(crops[1].box_side, 50.0);
  EXPECT_EQ(crops[1].azimuth, 1.25);
  EXPECT_EQ(read_keypoint_crops(folder, 64, 1).size(), 1U);
}

TEST_F(KeypointCropsFolder, OfAnyNumberOfPixelsHasTheSameUnits) {
  EXPECT_EQ(read_keypoint_crops(folder, 128)[0].crop.width, 128);
  EXPECT_EQ(read_keypoint_crops(folder, 128)[1].points[0], Eigen::Vector2d(3.5, -8.0));
  write_npy(folder / "images.npy", "|u1", "2, 128, 128, 3",
            std::vector<unsigned char>(2 * 128 * 128 * 3, 7));
  const std::vector<KeypointCropTruth> crops = read_keypoint_crops(folder, 128);
  ASSERT_EQ(crops.size(), 2U);
  EXPECT_EQ(crops[1].crop.width, 128);
  // Pixel 3.5 of 128 is the boundary of the second and the third pixel of 64.
  EXPECT_EQ(crops[1].points[0], Eigen::Vector2d(1.5, -4.25));
  EXPECT_EQ(crops[1].box_side, 25.0);
  const std::vector<KeypointCropTruth> small = read_keypoint_crops(folder, 64);
  EXPECT_EQ(small[1].crop.width, 64);
  EXPECT_EQ(small[1].crop.data[5], 7);
  EXPECT_EQ(small[1].points[0], Eigen::Vector2d(1.5, -4.25));
  write_npy(folder / "images.npy", "|u1", "2, 64, 32, 3",
            std::vector<unsigned char>(2 * 64 * 32 * 3, 7));
  EXPECT_THROW(read_keypoint_crops(folder, 64), InputError);
}

TEST_F(KeypointCropsFolder, RefusesDamagedArrays) {
  const auto refused = [&](const char* name, const auto& damage) {
    SetUp();
    damage(folder / name);
    EXPECT_THROW(read_keypoint_crops(folder), InputError) << name;
  };
  refused("images.npy", [](const auto& path) { std::filesystem::remove(path); });
  refused("images.npy", [](const auto& path) { std::filesystem::resize_file(path, 9000); });
  refused("images.npy", [](const auto& path) { std::filesystem::resize_file(path, 50); });
  refused("keypoints.npy", [](const auto& path) { std::ofstream(path) << "no array"; });
  refused("boxes.npy", [](const auto& path) {
    write_npy<float>(path, "<f4", "1, 4", {0, 0, 4, 4});
  });
  refused("boxes.npy", [](const auto& path) {
    write_npy<float>(path, "<f8", "2, 4", {0, 0, 4, 4, 0, 0, 4, 4});
  });
  refused("boxes.npy", [](const auto& path) {
    write_npy<float>(path, "<f4", "2, 99999999999999999999", {0, 0, 4, 4});
  });
  // More than a machine's memory, in a file of some hundred bytes.
  refused("boxes.npy", [](const auto& path) {
    write_npy<float>(path, "<f4", "4000000000, 4", {0, 0, 4, 4});
  });
  refused("visibility.npy", [](const auto& path) {
    write_npy(path, "|u1", "2, 36", std::vector<unsigned char>(2 * 36, 4));
  });
}

}  // namespace
}  // namespace camber
