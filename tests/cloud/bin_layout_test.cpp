#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "cloud/cloud_files.h"

namespace camber {
namespace {

using test::put;
using test::read_error;
using test::read_from_memory;
using ::testing::AllOf;
using ::testing::HasSubstr;

/// A scan of a flat place: rings around the sensor, 1.8 m below it.
/// @param columns  what follows x, y and z: i intensity to 1, I to 255, r ring, t seconds, e of 0
/// to
///                 1.5, 0 zeros
std::string scan(std::size_t points, const std::string& columns, bool shuffled = false) {
  const CounterRandom random(7);
  std::string bytes;
  for (std::size_t k = 0; k < points; ++k) {
    const std::size_t i = shuffled ? k * 7919 % points : k;
    const double angle = random.uniform(10 * i, 0.0, 6.28), ring = static_cast<double>(i % 32);
    const double distance = 1.8 / std::tan(0.05 + 0.02 * ring);
    put(bytes, static_cast<float>(distance * std::cos(angle)));
    put(bytes, static_cast<float>(distance * std::sin(angle)));
    put(bytes, static_cast<float>(-1.8 + random.normal(10 * i + 1) * 0.02));
    for (const char column : columns) {
      const double value = column == 'i'   ? random.uniform(10 * i + 3)
                           : column == 'I' ? std::floor(256.0 * random.uniform(10 * i + 3))
                           : column == 'r' ? ring
                           : column == 't' ? 1e-6 * static_cast<double>(i)
                           : column == 'e' ? 1.5 * random.uniform(10 * i + 5)
                                           : 0.0;
      put(bytes, static_cast<float>(value));
    }
  }
  return bytes;
}

struct Form {
  const char* columns;
  std::vector<std::string> scalars;
};

class BinForms : public ::testing::TestWithParam<Form> {};

TEST_P(BinForms, AreToldByTheirNumbers) {
  for (const std::size_t points : {100u, 20000u, 20001u, 100003u}) {
    for (const bool shuffled : {false, true}) {
      const std::string bytes = scan(points, GetParam().columns, shuffled);
      const CloudFile file = read_from_memory(bytes, "scan.bin");
      ASSERT_EQ(file.cloud.size(), points);
      for (std::size_t i = 0; i < points; ++i) {
        ASSERT_NEAR(file.cloud.points[i].z(), -1.8f, 0.2f) << i;
      }
      std::vector<std::string> names;
      for (const auto& [name, values] : file.cloud.scalars) names.push_back(name);
      EXPECT_THAT(names, ::testing::UnorderedElementsAreArray(GetParam().scalars));
      // Other forms than the one that the name promises are named.
      EXPECT_EQ(file.report.notes.size(), GetParam().scalars.size() == 1 ? 0u : 1u);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Programs, BinForms,
                         ::testing::Values(Form{"i", {"intensity"}}, Form{"I", {"intensity"}},
                                           Form{"0", {"intensity"}}, Form{"", {}},
                                           Form{"Ir", {"intensity", "ring"}},
                                           Form{"ir", {"intensity", "ring"}},
                                           Form{"it", {"intensity", "column_5"}},
                                           Form{"irt", {"intensity", "ring", "column_6"}},
                                           Form{"iet", {"intensity", "column_5", "column_6"}}));

TEST(BinLayout, FormsThatNobodyKnowsAreRefused) {
  EXPECT_THAT(read_error(scan(2000, "0i000"), "a.bin"),
              AllOf(HasSubstr("8 floats a point"), HasSubstr("--columns")));
}

TEST(BinLayout, WhatFitsSeveralFormsIsRefusedWithTheirNames) {
  const CounterRandom random(3);
  std::string noise, zeros(6000, '\0');
  for (std::size_t i = 0; i < 1500; ++i) put(noise, static_cast<float>(random.uniform(i)));
  EXPECT_THAT(read_error(noise, "a.bin"),
              AllOf(HasSubstr("4 floats a point (x,y,z,intensity)"), HasSubstr("6 floats a point"),
                    HasSubstr("--columns")));
  EXPECT_THAT(read_error(zeros, "a.bin"),
              AllOf(HasSubstr("4 floats"), HasSubstr("5 floats a point (x,y,z,intensity,ring)")));
  ReadOptions options;
  options.columns = {"x", "y", "z", "intensity"};
  EXPECT_EQ(read_from_memory(noise, "a.bin", options).cloud.size(), 375u);
}

TEST(BinLayout, CutFilesAreNotTakenForOtherForms) {
  const std::string kitti = scan(2000, "i");
  // Multiples of 20 and of 24 bytes.
  EXPECT_THAT(read_error(kitti.substr(0, 20 * 1501), "a.bin"), HasSubstr("multiple of 16"));
  EXPECT_THAT(read_error(kitti.substr(0, 24 * 1201), "a.bin"), HasSubstr("multiple of 16"));
  EXPECT_THAT(read_error(scan(2000, "ir").substr(0, 16 * 1001), "a.bin"),
              HasSubstr("multiple of 20"));
  ReadOptions lenient;
  lenient.lenient = true;
  EXPECT_EQ(read_from_memory(kitti.substr(0, 20 * 1501), "a.bin", lenient).cloud.size(), 1876u);
}

TEST(BinLayout, ColumnsAreThoseOfTheOptions) {
  const std::string bytes = scan(500, "Ir");
  ReadOptions options;
  options.columns = {"_", "y", "x", "Intensity", "line"};
  const CloudFile file = read_from_memory(bytes, "scan.pcd.bin", options);
  ASSERT_EQ(file.cloud.size(), 500u);
  float x = 0.0f, y = 0.0f;
  std::memcpy(&y, bytes.data() + 20 * 9 + 4, 4);
  std::memcpy(&x, bytes.data() + 20 * 9 + 8, 4);
  EXPECT_EQ(file.cloud.points[9], Eigen::Vector3f(x, y, 0.0f));
  EXPECT_EQ(file.cloud.scalars.at("line")[9], 9.0f);
  options.columns = {"x", "y", "z", "i"};
  EXPECT_EQ(read_from_memory(bytes, "a.bin", options).cloud.size(), 625u);
  options.columns = {"x", "y", "z", "a", "b", "c"};
  EXPECT_THAT(read_error(bytes, "a.bin", options), HasSubstr("multiple of 24"));
  options.columns = {"x", "y", "z", "z", "b"};
  EXPECT_THAT(read_error(bytes, "a.bin", options), HasSubstr("'z' twice"));
  options.columns = {"x", "z", "a", "b"};
  EXPECT_THAT(read_error(bytes, "a.bin", options), HasSubstr("no field 'y'"));
}

}  // namespace
}  // namespace camber
