// Feather files against what was written into them, and what is refused.

#include "camber/import/formats/feather.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <lz4frame.h>
#include <zstd.h>

#include <cmath>
#include <fstream>
#include <limits>

#include "camber/core/errors.h"
#include "camber/import/formats/map_boxes.h"
#include "support/feather_writer.h"
#include "support/test_data.h"

namespace camber {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using Kind = FeatherColumn::Kind;

std::string lz4(std::string_view bytes) {
  std::string out(LZ4F_compressFrameBound(bytes.size(), nullptr), '\0');
  out.resize(LZ4F_compressFrame(out.data(), out.size(), bytes.data(), bytes.size(), nullptr));
  return out;
}

std::string zstd(std::string_view bytes) {
  std::string out(ZSTD_compressBound(bytes.size()), '\0');
  out.resize(ZSTD_compress(out.data(), out.size(), bytes.data(), bytes.size(), 3));
  return out;
}

class Feather : public ::testing::Test {
 protected:
  static FeatherTable read(const std::string& bytes) { return read_feather(bytes, "made"); }
  std::filesystem::path written(const std::string& bytes) {
    const auto path = folder_.path() / "table.feather";
    std::ofstream(path, std::ios::binary) << bytes;
    return path;
  }
  static std::string refusal(const std::string& bytes) {
    try {
      read(bytes);
    } catch (const InputError& error) {
      return error.what();
    }
    return "";
  }
  test::TemporaryFolder folder_;
};

/// Columns of every kind, of 300 rows.
std::vector<test::WrittenColumn> all_kinds() {
  std::vector<double> x;
  std::vector<float> y;
  std::vector<std::int64_t> stamps;
  std::vector<std::uint64_t> ids;
  std::vector<std::int32_t> counts;
  std::vector<std::string> words, classes;
  std::vector<bool> missing;
  for (int i = 0; i < 300; ++i) {
    x.push_back(0.1 * i - 7.0);
    y.push_back(0.25F * static_cast<float>(i));
    stamps.push_back(315967000000000000 + i);
    ids.push_back(std::numeric_limits<std::uint64_t>::max() - static_cast<std::uint64_t>(i));
    counts.push_back(-i);
    words.push_back(i % 3 == 0 ? "" : fmt::format("word {}", i));
    classes.push_back(i % 2 == 0 ? "REGULAR_VEHICLE" : "PEDESTRIAN");
    missing.push_back(i % 7 == 3);
  }
  return {{"x", x},
          {"y", y, false, false, missing},
          {"timestamp_ns", stamps},
          {"id", ids},
          {"count", counts},
          {"word", words, true},
          {"class", classes, false, true}};
}

void expect_all_kinds(const FeatherTable& table) {
  ASSERT_EQ(table.rows, 300U);
  ASSERT_EQ(table.columns.size(), 7U);
  std::vector<std::string> names, types;
  for (const FeatherColumn& column : table.columns) {
    names.push_back(column.name);
    types.push_back(column.type);
  }
  EXPECT_THAT(names, ElementsAre("x", "y", "timestamp_ns", "id", "count", "word", "class"));
  EXPECT_THAT(types, ElementsAre("double", "float", "int64", "uint64", "int32", "large_utf8",
                                 "dictionary of utf8"));
  for (std::size_t i = 0; i < 300; ++i) {
    const int n = static_cast<int>(i);
    EXPECT_EQ(table.columns[0].numbers[i], 0.1 * n - 7.0);
    if (n % 7 == 3) {
      EXPECT_TRUE(std::isnan(table.columns[1].numbers[i]));
      EXPECT_EQ(table.columns[1].text(i), "");
    } else {
      EXPECT_EQ(table.columns[1].numbers[i], 0.25 * n);
    }
    EXPECT_EQ(table.columns[2].integers[i], 315967000000000000 + n);
    EXPECT_EQ(table.columns[3].unsigneds[i], std::numeric_limits<std::uint64_t>::max() - i);
    EXPECT_EQ(table.columns[4].integers[i], -n);
    EXPECT_EQ(table.columns[5].texts[i], n % 3 == 0 ? "" : fmt::format("word {}", n));
    EXPECT_EQ(table.columns[6].text(i), n % 2 == 0 ? "REGULAR_VEHICLE" : "PEDESTRIAN");
  }
  EXPECT_TRUE(table.columns[0].missing.empty());
}

TEST_F(Feather, EveryKindOfColumnPlainAndCompressed) {
  expect_all_kinds(read(test::feather_bytes(all_kinds())));
  expect_all_kinds(read(test::feather_bytes(all_kinds(), {0, lz4, 1000})));
  expect_all_kinds(read(test::feather_bytes(all_kinds(), {1, zstd, 1000})));
}

TEST_F(Feather, BatchesFollowEachOther) {
  expect_all_kinds(read(test::feather_bytes(all_kinds(), {-1, {}, 64})));
  expect_all_kinds(read(test::feather_bytes(all_kinds(), {1, zstd, 7})));
}

TEST_F(Feather, TextsOfValuesReadBack) {
  const FeatherTable table = read(test::feather_bytes(
      {{"x", std::vector<double>{0.1, -1e-300}}, {"n", std::vector<std::int64_t>{-5, 7}}}));
  EXPECT_EQ(std::stod(table.columns[0].text(0)), 0.1);
  EXPECT_EQ(std::stod(table.columns[0].text(1)), -1e-300);
  EXPECT_EQ(table.columns[1].text(0), "-5");
}

TEST_F(Feather, ATableWithoutRows) {
  const FeatherTable table =
      read_feather(written(test::feather_bytes({{"x", std::vector<double>{}}})));
  EXPECT_EQ(table.rows, 0U);
  ASSERT_EQ(table.columns.size(), 1U);
  EXPECT_EQ(table.columns[0].kind, Kind::kNumber);
}

TEST_F(Feather, OtherFilesAreNamed) {
  EXPECT_THAT(refusal("FEA1\0\0\0\0"), HasSubstr("version 1"));
  EXPECT_THAT(refusal("x,y\n1,2\n"), HasSubstr("expected a Feather"));
  const std::string whole = test::feather_bytes(all_kinds());
  EXPECT_THAT(refusal(whole.substr(0, whole.size() - 3)), HasSubstr("is it cut?"));
  EXPECT_TRUE(is_feather(std::string_view(whole)));
  EXPECT_FALSE(is_feather(folder_.path() / "nothing"));
}

/// Compressed data of another size than is stated.
TEST_F(Feather, ABufferOfAnotherSizeIsRefused) {
  const auto half = [](std::string_view bytes) { return lz4(bytes.substr(0, bytes.size() / 2)); };
  EXPECT_THAT(refusal(test::feather_bytes(all_kinds(), {0, half, 1000})),
              HasSubstr("bytes that give"));
}

/// Whatever is cut or flipped: a table or one sentence.
TEST_F(Feather, DamagedFilesNeverCrash) {
  std::vector<test::WrittenColumn> columns = all_kinds();
  for (test::WrittenColumn& column : columns) {
    std::visit([](auto& values) { values.resize(5); }, column.values);
    if (!column.missing.empty()) column.missing.resize(5);
  }
  for (const test::FeatherWriting& writing :
       {test::FeatherWriting{-1, {}, 3}, test::FeatherWriting{0, lz4, 1000}}) {
    const std::string whole = test::feather_bytes(columns, writing);
    for (std::size_t size = 0; size < whole.size(); ++size) {
      EXPECT_NE(refusal(whole.substr(0, size)), "") << size;
    }
    int refused = 0;
    for (std::size_t at = 0; at < whole.size(); ++at) {
      for (const int flipped : {0xFF, 0x80, 0x01}) {
        std::string damaged = whole;
        damaged[at] = static_cast<char>(damaged[at] ^ flipped);
        const std::string said = refusal(damaged);
        refused += !said.empty();
        EXPECT_EQ(said.find('\n'), std::string::npos);
      }
    }
    EXPECT_GT(refused, 100);
  }
}

/// Argoverse 2's annotations and poses: the same boxes as by CSV.
TEST_F(Feather, BoxesAreThoseOfTheTableAsText) {
  const auto column = [](const char* name, double first, double second) {
    return test::WrittenColumn{name, std::vector<double>{first, second}};
  };
  const std::vector<test::WrittenColumn> pose = {
      column("qw", 1.0, 0.6),  column("qx", 0.0, 0.0),    column("qy", 0.0, 0.0),
      column("qz", 0.0, 0.8),  column("tx_m", 10.5, 3.0), column("ty_m", -2.0, 4.0),
      column("tz_m", 0.9, 1.0)};
  std::vector<test::WrittenColumn> columns = {
      {"timestamp_ns", std::vector<std::int64_t>{5, 6}},
      {"track_uuid", std::vector<std::string>{"a \"b\", c", "d"}},
      {"category", std::vector<std::string>{"CAR", "BUS"}, false, true},
      column("length_m", 4.0, 12.0),
      column("width_m", 1.8, 2.5),
      column("height_m", 1.5, 3.25)};
  columns.insert(columns.end(), pose.begin(), pose.end());
  const MapBoxFile file = MapBoxFile::read(written(test::feather_bytes(columns, {0, lz4, 1000})));
  EXPECT_STREQ(file.form(), "argoverse2");
  ASSERT_EQ(file.boxes().size(), 2U);
  EXPECT_EQ(file.boxes()[0].center, Eigen::Vector3d(10.5, -2.0, 0.9));
  EXPECT_EQ(file.boxes()[0].timestamp, 5);
  EXPECT_EQ(file.boxes()[1].category, "BUS");
  EXPECT_EQ(file.boxes()[1].height, 3.25);
  EXPECT_NEAR(file.boxes()[1].rotation.z(), 0.8, 1e-12);
  const std::vector<MapBoxNote> notes(2, {"ok", "", 0.05});
  const std::string text = file.encoded(file.boxes(), notes);
  EXPECT_THAT(text, HasSubstr("timestamp_ns,track_uuid,category,length_m"));
  EXPECT_THAT(text, HasSubstr("5,\"a \"\"b\"\", c\",CAR,4,1.8,1.5,1,0,0,0,10.500000,"));
  const auto csv = folder_.path() / "again.csv";
  std::ofstream(csv) << text;
  const MapBoxFile again = MapBoxFile::read(csv);
  ASSERT_EQ(again.boxes().size(), 2U);
  EXPECT_EQ(again.boxes()[0].center, file.boxes()[0].center);

  std::vector<test::WrittenColumn> poses = {{"timestamp_ns", std::vector<std::int64_t>{5, 6}}};
  poses.insert(poses.end(), pose.begin(), pose.end());
  const auto stamped = read_stamped_poses(written(test::feather_bytes(poses)));
  ASSERT_EQ(stamped.size(), 2U);
  EXPECT_EQ(stamped.at(6).translation(), Eigen::Vector3d(3.0, 4.0, 1.0));
}

TEST_F(Feather, WhatBoxesLackIsNamed) {
  const auto said = [&](const std::vector<test::WrittenColumn>& columns) -> std::string {
    try {
      MapBoxFile::read(written(test::feather_bytes(columns)));
    } catch (const InputError& error) {
      return error.what();
    }
    return "";
  };
  std::vector<test::WrittenColumn> columns;
  for (const char* name : {"qw", "qx", "qy", "qz", "tx_m", "ty_m", "tz_m", "length_m", "width_m"}) {
    columns.push_back({name, std::vector<double>{std::string(name) == "qw" ? 1.0 : 0.0}});
  }
  EXPECT_THAT(said(columns), HasSubstr("found no column height_m"));
  columns.push_back({"height_m", std::vector<double>{1.5}, false, false, {true}});
  columns[7].values = columns[8].values = std::vector<double>{2.0};
  EXPECT_THAT(said(columns), HasSubstr("row 1, column height_m: found '', expected metres"));
}

}  // namespace
}  // namespace camber
