#include "camber/cloud/colmap.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "cloud/cloud_files.h"
#include "cloud/memory_meter.h"
#include "support/test_data.h"

namespace camber {
namespace {

using test::put;
using ::testing::HasSubstr;
namespace fs = std::filesystem;

void write(const fs::path& path, const std::string& bytes) {
  std::ofstream(path, std::ios::binary) << bytes;
}

const char kCameras[] =
    "# Camera list with one line of data per camera:\n1 SIMPLE_PINHOLE 640 480 500 320 240.5\n"
    "7 OPENCV 640 480 500 501 320 240 0.1 0 0 0\n";
const char kImages[] =
    "# two lines each\n3 1 0 0 0 0.5 -1 2 1 left/a b.png\n10 20 42 30 40 -1\n"
    "4 0.7071067811865476 0 0 0.7071067811865476 0 0 0 7 c.png\n\n";
const char kPoints[] = "42 1.5 2.5 -3.5 10 20 30 0.75 3 0 4 1\n43 0 0 1 1 2 3 -1\n";

std::string cameras_bin() {
  std::string out;
  put(out, std::uint64_t{2});
  put(out, std::uint32_t{1});
  put(out, std::int32_t{0});
  put(out, std::uint64_t{640});
  put(out, std::uint64_t{480});
  for (const double v : {500.0, 320.0, 240.5}) put(out, v);
  put(out, std::uint32_t{7});
  put(out, std::int32_t{4});
  put(out, std::uint64_t{640});
  put(out, std::uint64_t{480});
  for (const double v : {500.0, 501.0, 320.0, 240.0, 0.1, 0.0, 0.0, 0.0}) put(out, v);
  return out;
}

std::string images_bin() {
  std::string out;
  put(out, std::uint64_t{2});
  put(out, std::uint32_t{3});
  for (const double v : {1.0, 0.0, 0.0, 0.0, 0.5, -1.0, 2.0}) put(out, v);
  put(out, std::uint32_t{1});
  out += std::string("left/a b.png") + '\0';
  put(out, std::uint64_t{2});
  put(out, 10.0);
  put(out, 20.0);
  put(out, std::int64_t{42});
  put(out, 30.0);
  put(out, 40.0);
  put(out, std::int64_t{-1});
  put(out, std::uint32_t{4});
  for (const double v : {std::sqrt(0.5), 0.0, 0.0, std::sqrt(0.5), 0.0, 0.0, 0.0}) put(out, v);
  put(out, std::uint32_t{7});
  out += std::string("c.png") + '\0';
  put(out, std::uint64_t{0});
  return out;
}

std::string points_bin() {
  std::string out;
  put(out, std::uint64_t{2});
  put(out, std::uint64_t{42});
  for (const double v : {1.5, 2.5, -3.5}) put(out, v);
  for (const int c : {10, 20, 30}) put(out, static_cast<std::uint8_t>(c));
  put(out, 0.75);
  put(out, std::uint64_t{2});
  for (const std::int32_t v : {3, 0, 4, 1}) put(out, v);
  put(out, std::uint64_t{43});
  for (const double v : {0.0, 0.0, 1.0}) put(out, v);
  for (const int c : {1, 2, 3}) put(out, static_cast<std::uint8_t>(c));
  put(out, -1.0);
  put(out, std::uint64_t{0});
  return out;
}

class Colmap : public ::testing::TestWithParam<bool> {
 protected:
  void write_model(const fs::path& folder) const {
    if (GetParam()) {
      write(folder / "cameras.bin", cameras_bin());
      write(folder / "images.bin", images_bin());
      write(folder / "points3D.bin", points_bin());
    } else {
      write(folder / "cameras.txt", kCameras);
      write(folder / "images.txt", kImages);
      write(folder / "points3D.txt", kPoints);
    }
  }
};

TEST_P(Colmap, ReadsCamerasImagesPointsAndTracks) {
  const test::TemporaryFolder folder;
  write_model(folder.path());
  const ColmapModel model = read_colmap_model(folder.path());
  ASSERT_EQ(model.cameras.size(), 2u);
  EXPECT_EQ(model.cameras[0].model, "SIMPLE_PINHOLE");
  const auto camera = model.cameras[0].pinhole();
  ASSERT_TRUE(camera.has_value());
  EXPECT_EQ(camera->width, 640);
  EXPECT_EQ(camera->fy, 500.0);
  EXPECT_EQ(camera->cx, 319.5);  // COLMAP's pixel centres lie at halves
  EXPECT_EQ(camera->cy, 240.0);
  EXPECT_EQ(model.cameras[1].id, 7);
  EXPECT_EQ(model.cameras[1].parameters.size(), 8u);
  EXPECT_FALSE(model.cameras[1].pinhole().has_value());

  ASSERT_EQ(model.images.size(), 2u);
  EXPECT_EQ(model.images[0].name, "left/a b.png");
  EXPECT_EQ(model.images[0].camera_from_world.translation(), Eigen::Vector3d(0.5, -1, 2));
  EXPECT_EQ(model.images[0].point_ids, std::vector<std::int64_t>({42, -1}));
  EXPECT_EQ(model.images[0].points[1], Eigen::Vector2d(30, 40));
  EXPECT_LT(
      (model.images[1].camera_from_world * Eigen::Vector3d(1, 0, 0) - Eigen::Vector3d(0, 1, 0))
          .norm(),
      1e-15);
  EXPECT_TRUE(model.images[1].points.empty());

  ASSERT_EQ(model.points.size(), 2u);
  EXPECT_EQ(model.points[0].id, 42u);
  EXPECT_EQ(model.points[0].position, Eigen::Vector3d(1.5, 2.5, -3.5));
  EXPECT_EQ(model.points[0].track[1], std::make_pair(4, 1));
  EXPECT_EQ(model.points[1].error, -1.0);

  const RoadCloud from_model = model.cloud();
  const RoadCloud from_folder = read_cloud(folder.path());
  for (const RoadCloud* cloud : {&from_model, &from_folder}) {
    EXPECT_FALSE(cloud->metric);
    ASSERT_EQ(cloud->size(), 2u);
    EXPECT_EQ(cloud->points[0], Eigen::Vector3f(1.5f, 2.5f, -3.5f));
    EXPECT_EQ(cloud->colors[0], (std::array<std::uint8_t, 3>{10, 20, 30}));
    EXPECT_EQ(cloud->labels.at("track_length"), std::vector<int>({2, 0}));
    EXPECT_EQ(cloud->scalars.at("error")[0], 0.75f);
  }
}

TEST_P(Colmap, FilesThatAreCutOrFlippedAreErrorsOrSound) {
  const std::string name = GetParam() ? "points3D.bin" : "points3D.txt";
  const std::string points = GetParam() ? points_bin() : kPoints;
  for (std::size_t length = 0; length < points.size(); ++length) {
    test::MemoryMeter meter;
    const std::string error = test::read_error(points.substr(0, length), name);
    EXPECT_LT(meter.peak(), 1u << 20);
    if (GetParam()) {
      EXPECT_THAT(error, HasSubstr("expected")) << length;
    }
  }
  for (std::size_t bit = 0; bit < 8 * points.size(); ++bit) {
    std::string damaged = points;
    damaged[bit / 8] = static_cast<char>(damaged[bit / 8] ^ (1 << (bit % 8)));
    test::MemoryMeter meter;
    test::read_error(damaged, name);
    EXPECT_LT(meter.peak(), 1u << 20) << bit;
  }
  // The other two files.
  const std::string extension = GetParam() ? ".bin" : ".txt";
  const auto check = [&](bool cameras, const std::string& bytes, const std::string& file) {
    test::MemoryMeter meter;
    try {
      if (cameras) {
        parse_colmap_cameras(bytes.data(), bytes.size(), file);
      } else {
        parse_colmap_images(bytes.data(), bytes.size(), file);
      }
    } catch (const InputError& error) {
      EXPECT_THAT(error.what(), HasSubstr(file + ": "));
    }
    EXPECT_LT(meter.peak(), 1u << 20);
  };
  for (const bool cameras : {true, false}) {
    const std::string file = (cameras ? "cameras" : "images") + extension;
    const std::string whole =
        cameras ? (GetParam() ? cameras_bin() : kCameras) : (GetParam() ? images_bin() : kImages);
    for (std::size_t length = 0; length < whole.size(); ++length) {
      check(cameras, whole.substr(0, length), file);
    }
    for (std::size_t bit = 0; bit < 8 * whole.size(); ++bit) {
      std::string damaged = whole;
      damaged[bit / 8] = static_cast<char>(damaged[bit / 8] ^ (1 << (bit % 8)));
      check(cameras, damaged, file);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Forms, Colmap, ::testing::Bool(),
                         [](const auto& instance) { return instance.param ? "Binary" : "Text"; });

TEST(ColmapErrors, SayFilePlaceAndWhatWasExpected) {
  const test::TemporaryFolder folder;
  EXPECT_THROW(read_colmap_model(folder.path()), InputError);
  write(folder.path() / "images.txt", kImages);
  write(folder.path() / "points3D.txt", kPoints);
  const auto message = [&](const std::string& cameras) -> std::string {
    write(folder.path() / "cameras.txt", cameras);
    try {
      read_colmap_model(folder.path());
    } catch (const InputError& error) {
      return error.what();
    }
    return "";
  };
  EXPECT_EQ(message(kCameras), "");
  EXPECT_THAT(message("1 PINHOLE 640 480 500 500 320\n"),
              HasSubstr("cameras.txt: line 1: found 3 parameters, expected 4 for PINHOLE"));
  EXPECT_THAT(message("\n1 SPHERE 640 480 1\n"), HasSubstr("line 2: found camera model 'SPHERE'"));
  EXPECT_THAT(message("1 PINHOLE wide 480 1 1 1 1\n"), HasSubstr("found 'wide' for a width"));
  std::string huge;
  put(huge, std::uint64_t{1} << 60);
  EXPECT_THAT(test::read_error(huge, "points3D.bin"),
              HasSubstr("byte 0: found 1152921504606846976 as the number of points"));
}

}  // namespace
}  // namespace camber
