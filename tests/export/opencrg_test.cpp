#include "camber/export/opencrg.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <fstream>
#include <functional>

#include "camber/core/errors.h"
#include "support/test_data.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

constexpr float kUnknown = std::numeric_limits<float>::quiet_NaN();

/// A road along x from (10, 20), 4 m long, sections at v = -1, 0, 2, height 10 i + j mm.
CrgData small_road() {
  CrgData data;
  data.comment = "a small road\n$ that tries to begin a block";
  data.start_x = 10.0;
  data.start_y = 20.0;
  data.start_z = 100.0;
  data.has_start_z = true;
  data.increment = 2.0;
  data.v = {-1.0, 0.0, 2.0};
  data.v_right = -1.0;
  data.v_left = 2.0;
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      data.heights.push_back(static_cast<float>(0.010 * i + 0.001 * j));
    }
  }
  data.modifiers = CrgModifiers();
  return data;
}

std::string written(const CrgData& data) {
  std::ostringstream out;
  write_crg(data, out);
  return out.str();
}

/// Reads a text as a file.
CrgData read_text_as_crg(const std::string& text) {
  const test::TemporaryFolder folder;
  const fs::path file = folder.path() / "road.crg";
  std::ofstream(file, std::ios::binary) << text;
  return read_crg(file);
}

std::string refusal(const std::string& text) {
  try {
    read_text_as_crg(text);
  } catch (const InputError& error) {
    return error.what();
  }
  return "read";
}

std::string replaced(std::string text, const std::string& what, const std::string& by) {
  const std::size_t at = text.find(what);
  EXPECT_NE(at, std::string::npos) << what;
  return at == std::string::npos ? text : text.replace(at, what.size(), by);
}

TEST(OpenCrg, HeightsByHand) {
  const CrgRoad road(small_road());
  EXPECT_DOUBLE_EQ(road.last_u(), 4.0);
  EXPECT_NEAR(road.height(0.0, -1.0), 100.0, 1e-8);
  EXPECT_NEAR(road.height(2.0, 0.0), 100.011, 1e-8);
  EXPECT_NEAR(road.height(3.0, 1.0), 100.0 + 0.015 + 0.0015, 1e-8);  // the middle of a cell
  EXPECT_NEAR(road.height_at(13.0, 21.0), 100.0 + 0.015 + 0.0015, 1e-8);
  EXPECT_NEAR(road.height(-5.0, 9.0), 100.002, 1e-8);  // the corner is kept
}

TEST(OpenCrg, BankingAndSlopeAreAdded) {
  CrgData data = small_road();
  data.banking = {0.0, 0.1, 0.2};
  data.slope = {0.0, 0.05, -0.1};
  const CrgRoad road(data);
  // z along the line: 100, 100.1, 99.9
  EXPECT_NEAR(road.height(2.0, 2.0), 100.1 + 0.1 * 2.0 + 0.012, 1e-8);
  EXPECT_NEAR(road.height(3.0, 0.0), 100.0 + 0.016, 1e-8);
  EXPECT_NEAR(road.height(4.0, -1.0), 99.9 - 0.2 + 0.020, 1e-8);
  EXPECT_NEAR(road.node(2, 0), 99.9 - 0.2 + 0.020, 1e-8);
}

TEST(OpenCrg, CurvedLineComesBackFromPositions) {
  CrgData data = small_road();
  data.heights.assign(3 * 41, 0.0f);
  data.increment = 0.5;
  for (int i = 0; i <= 40; ++i) data.phi.push_back(0.02 * i);
  const CrgRoad road(data);
  for (double u = 0.1; u < 20.0; u += 0.37) {
    for (double v = -1.0; v <= 2.0; v += 0.5) {
      const Eigen::Vector2d xy = road.position(u, v), uv = road.coordinates(xy.x(), xy.y());
      EXPECT_NEAR(uv.x(), u, 1e-6);
      EXPECT_NEAR(uv.y(), v, 1e-9);
    }
  }
}

TEST(OpenCrg, BorderModes) {
  CrgData data = small_road();
  data.options.border_u = CrgBorder::kNone;
  EXPECT_TRUE(std::isnan(CrgRoad(data).height(4.1, 0.0)));
  data.options.border_u = CrgBorder::kZero;
  data.options.offset_u = 0.5;
  EXPECT_DOUBLE_EQ(CrgRoad(data).height(4.1, 0.0), 0.5);
  data.options.border_u = CrgBorder::kKeep;
  EXPECT_NEAR(CrgRoad(data).height(4.1, 0.0), 100.021 + 0.5, 1e-8);
  data.options.border_u = CrgBorder::kRepeat;
  EXPECT_NEAR(CrgRoad(data).height(5.0, 0.0), CrgRoad(data).height(1.0, 0.0), 1e-12);
  data.options.border_u = CrgBorder::kReflect;
  EXPECT_NEAR(CrgRoad(data).height(5.0, 0.0), CrgRoad(data).height(3.0, 0.0), 1e-12);
  EXPECT_NEAR(CrgRoad(data).height(-1.0, 0.0), CrgRoad(data).height(1.0, 0.0), 1e-12);
}

TEST(OpenCrg, UnknownCells) {
  CrgData data = small_road();
  data.heights[4] = kUnknown;
  EXPECT_TRUE(std::isnan(CrgRoad(data).height(1.0, 0.5)));
  EXPECT_TRUE(std::isnan(CrgRoad(data).node(1, 1)));
  data.modifiers->unknown = CrgUnknown::kLast;
  EXPECT_NEAR(CrgRoad(data).node(1, 1), 100.010, 1e-8);  // its right neighbour
  data.modifiers.reset();
  EXPECT_NEAR(CrgRoad(data).node(1, 1), 100.010, 1e-8);  // what a file without the block means
  EXPECT_TRUE(std::isnan(CrgRoad(data, false).node(1, 1)));
  data.heights[3] = kUnknown;
  EXPECT_NEAR(CrgRoad(data).node(1, 0), 100.012, 1e-8);  // nothing to its right: from the left
}

TEST(OpenCrg, FilesGiveTheDataBack) {
  for (const CrgEncoding encoding : {CrgEncoding::kText, CrgEncoding::kTextDouble,
                                     CrgEncoding::kBinary, CrgEncoding::kBinaryDouble}) {
    CrgData data = small_road();
    data.encoding = encoding;
    data.phi = {0.0, 0.01, -0.02};
    data.banking = {0.1, -0.1, 0.25};
    data.slope = {0.0, -0.5, 0.5};
    data.heights[4] = kUnknown;
    data.end_phi = -0.02;
    const CrgData back = read_text_as_crg(written(data));
    EXPECT_EQ(back.encoding, encoding);
    EXPECT_EQ(back.v, data.v);
    EXPECT_EQ(back.sections(), 3u);
    EXPECT_TRUE(back.modifiers.has_value());
    for (std::size_t i = 0; i < 9; ++i) {
      EXPECT_EQ(std::isnan(back.heights[i]), i == 4);
      if (i == 4) continue;
      EXPECT_NEAR(back.heights[i], data.heights[i], 1e-7f);  // digits of LRFI
    }
    for (std::size_t i = 1; i < 3; ++i) {
      EXPECT_EQ(back.phi[i], crg_rounded(data.phi[i], encoding));
      EXPECT_EQ(back.slope[i], crg_rounded(data.slope[i], encoding));
    }
    EXPECT_EQ(back.banking[2], 0.25);
    EXPECT_EQ(written(back), written(data)) << to_string(encoding);
  }
}

TEST(OpenCrg, TextKeepsItsColumns) {
  EXPECT_DOUBLE_EQ(crg_rounded(-0.12345678, CrgEncoding::kText), -0.1234568);
  EXPECT_DOUBLE_EQ(crg_rounded(-123.45678, CrgEncoding::kText), -123.45678);
  EXPECT_DOUBLE_EQ(crg_rounded(4123456.789, CrgEncoding::kText), 4123456.79);
  CrgData data = small_road();
  data.heights[0] = 1e12f;
  EXPECT_THROW(written(data), std::invalid_argument);
}

TEST(OpenCrg, HeaderLinesFitTheirColumns) {
  CrgData data = small_road();
  data.comment = std::string(200, 'x');
  std::istringstream lines(written(data));
  std::string line;
  while (std::getline(lines, line) && line.rfind("$$$$", 0) != 0) EXPECT_LE(line.size(), 72u);
}

TEST(OpenCrg, DamagedFilesAreRefusedWithTheirPlace) {
  const std::string good = written(small_road());
  ASSERT_EQ(refusal(good), "read");
  EXPECT_THAT(refusal(""), ::testing::HasSubstr("found no records"));
  EXPECT_THAT(refusal("ply\n"), ::testing::HasSubstr("line 1: found"));
  EXPECT_THAT(refusal(replaced(good, "#:LRFI", "#:XXXX")),
              ::testing::HasSubstr("expected LRFI, LDFI, KRBI or KDBI"));
  EXPECT_THAT(refusal(replaced(good, "INCREMENT  = 2\n", "INCREMENT  = -2\n")),
              ::testing::HasSubstr("REFERENCE_LINE_INCREMENT is -2"));
  EXPECT_THAT(refusal(replaced(good, "0.0100000", "0.01x0000")),
              ::testing::HasSubstr("expected a number or *missing*"));
  EXPECT_THAT(refusal(good.substr(0, good.size() - 31)),
              ::testing::HasSubstr("found 2 cross sections, expected the 3 of the header"));
  EXPECT_THAT(refusal(good + " 0.0000000 0.0000000 0.0000000\n"),
              ::testing::HasSubstr("more than the 3 cross sections"));
  EXPECT_THAT(refusal(replaced(good, "at v = 0.000000", "at v = 2.000000")),
              ::testing::HasSubstr("two long sections at v = 2"));
  CrgData binary = small_road();
  binary.encoding = CrgEncoding::kBinary;
  const std::string bytes = written(binary);
  EXPECT_THAT(refusal(bytes.substr(0, bytes.size() - 1)),
              ::testing::HasSubstr("found 35 bytes, expected 36 for 3 cross sections"));
  // A header that promises far more than there is must not cost its memory.
  EXPECT_THAT(refusal(replaced(bytes, "END_U      = 4", "END_U      = 4000000000")),
              ::testing::HasSubstr("cross sections of 3 channels"));
}

TEST(OpenCrg, ShortestStepsAndScalesThatLeaveNoNumbers) {
  const std::string good = written(small_road());
  const std::string tiny = replaced(replaced(good, "END_U      = 4\n", "END_U      = 4e-300\n"),
                                    "INCREMENT  = 2\n", "INCREMENT  = 2e-300\n");
  ASSERT_EQ(refusal(tiny), "read");
  const CrgRoad road(read_text_as_crg(tiny), true);
  for (const double u : {-1e9, 0.0, 1e-300, 1e9}) EXPECT_TRUE(std::isfinite(road.heading(u))) << u;
  EXPECT_THAT(
      refusal(replaced(good, "$KD_DEF", "$ROAD_CRG_MODS\nSCALE_LENGTH = 1e-308\n$\n$KD_DEF")),
      ::testing::HasSubstr("scale_length is 1e-308, expected 1e-06 to 1000000"));
}

TEST(OpenCrg, NamedFiles) {
  const test::TemporaryFolder folder;
  const auto put = [&](const char* name, const std::string& text) {
    std::ofstream(folder.path() / name, std::ios::binary) << text;
    return folder.path() / name;
  };
  CrgData data = small_road();
  data.options.border_u = CrgBorder::kNone;
  put("base.crg", replaced(written(data), "$KD_DEFINITION",
                           "$ROAD_CRG_OPTS\nBORDER_MODE_U = 0\n$\n$KD_DEFINITION"));
  const auto naming = [](const std::string& name, const std::string& more) {
    return "$CT\n$\n$ROAD_CRG_FILE ! a comment\n* another\n  " + name + " ! and one\n$\n" + more;
  };
  const CrgData plain = read_crg(put("plain.crg", naming("base.crg", "")));
  EXPECT_EQ(plain.options.border_u, CrgBorder::kNone);
  ASSERT_EQ(plain.files.size(), 2u);
  EXPECT_EQ(plain.files[1].filename(), "base.crg");
  const CrgData other =
      read_crg(put("other.crg", naming("base.crg", "$ROAD_CRG_OPTS\nBORDER_MODE_U = 3\n$\n")));
  EXPECT_EQ(other.options.border_u, CrgBorder::kRepeat);
  const auto refused = [&](const fs::path& file, const char* part) {
    try {
      read_crg(file);
      ADD_FAILURE() << file;
    } catch (const InputError& error) {
      EXPECT_THAT(error.what(), ::testing::HasSubstr(part));
    }
  };
  refused(put("missing.crg", naming("not/there.crg", "")), "not/there.crg' that it names");
  refused(put("circle.crg", naming("circle.crg", "")), "name each other");
  refused(put("variable.crg", naming("$CAMBER_NOT_SET/x.crg", "")), "CAMBER_NOT_SET");
  ::setenv("CAMBER_CRG_TEST", folder.path().c_str(), 1);
  EXPECT_EQ(read_crg(put("set.crg", naming("$CAMBER_CRG_TEST/base.crg", ""))).sections(), 3u);
  ::unsetenv("CAMBER_CRG_TEST");
}

TEST(OpenCrg, WhatANamedFileHoldsIsNotQuoted) {
  const test::TemporaryFolder folder;
  const auto put = [&](const char* name, const std::string& text) {
    std::ofstream(folder.path() / name, std::ios::binary) << text;
    return folder.path() / name;
  };
  const std::string road = written(small_road());
  const auto refusal_of = [&](const std::string& secret) {
    put("secret.txt", secret);
    try {
      read_crg(put("road.crg", "$ROAD_CRG_FILE\nsecret.txt\n$\n"));
    } catch (const InputError& error) {
      return std::string(error.what());
    }
    return std::string("read");
  };
  const std::vector<std::string> secrets = {"MARKER",
                                            "$CT\n$\n$ROAD_CRG\nMARKER\n",
                                            "$CT\n$\n$ROAD_CRG\nX = MARKER\n",
                                            "$KD_DEFINITION\n#:MARKER\n",
                                            "$KD_DEFINITION\nMARKER\n",
                                            "$KD_DEFINITION\nD:MARKER,m\n",
                                            "$ROAD_CRG_FILE\nMARKER\n$\n",
                                            "$ROAD_CRG_FILE\n  $MARKER/x\n$\n",
                                            replaced(road, "D:long section at v", "D:MARKER at v"),
                                            road + "MARKER\n"};
  for (const std::string& secret : secrets) {
    const std::string message = refusal_of(secret);
    EXPECT_THAT(message, ::testing::HasSubstr("secret.txt")) << secret;
    EXPECT_THAT(message, ::testing::HasSubstr("expected an OpenCRG file")) << secret;
    EXPECT_THAT(message, ::testing::Not(::testing::HasSubstr("MARKER"))) << secret;
  }
  put("secret.txt", "$MARKER\n$\n" + road);
  const CrgData data = read_crg(put("road.crg", "$ROAD_CRG_FILE\nsecret.txt\n$\n"));
  ASSERT_EQ(data.remarks.size(), 1u);
  EXPECT_THAT(data.remarks[0], ::testing::HasSubstr("secret.txt: 1 remark"));
  EXPECT_THAT(data.remarks[0], ::testing::Not(::testing::HasSubstr("MARKER")));

  ::setenv("CAMBER_CRG_TEST", "MARKER", 1);
  try {
    read_crg(put("variable.crg", "$ROAD_CRG_FILE\n  $CAMBER_CRG_TEST/x\n$\n"));
    ADD_FAILURE();
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), ::testing::HasSubstr("'$CAMBER_CRG_TEST/x'"));
    EXPECT_THAT(error.what(), ::testing::Not(::testing::HasSubstr("MARKER")));
  }
  ::unsetenv("CAMBER_CRG_TEST");
}

TEST(OpenCrg, SectionsByNumber) {
  const std::string header =
      "$ROAD_CRG\nREFERENCE_LINE_INCREMENT = 1\nLONG_SECTION_V_INCREMENT = 0.5\n$\n"
      "$KD_Definition\n#:LRFI\nD:long section 1,m\nD:long section 2,m\n$\n$$$$\n";
  const CrgData data = read_text_as_crg(header + " 0.0000000 1.0000000\n 2.0000000 3.0000000\n");
  EXPECT_EQ(data.v, (std::vector<double>{0.0, 0.5}));
  EXPECT_EQ(data.remarks.size(), 1u);
  EXPECT_NEAR(CrgRoad(data).height(0.5, 0.25), 1.5, 1e-12);
  EXPECT_THAT(refusal(replaced(header, "section 2", "section 3") + " 0.0000000 1.0000000\n"),
              ::testing::HasSubstr("found long section 3, expected 2"));
}

}  // namespace
}  // namespace camber
