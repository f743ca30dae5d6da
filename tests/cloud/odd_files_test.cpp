// Hand-made files: unusual but sound ones, and lying or damaged ones.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "cloud/cloud_files.h"
#include "cloud/memory_meter.h"
#include "support/test_data.h"

namespace camber {
namespace {

using test::put;
using test::read_error;
using test::read_from_memory;
using ::testing::HasSubstr;

std::string pcd(const std::string& fields, const std::string& sizes, const std::string& types,
                const std::string& counts, const std::string& width, const std::string& height,
                const std::string& points, const std::string& data) {
  return "# .PCD v0.7\nVERSION 0.7\nFIELDS " + fields + "\nSIZE " + sizes + "\nTYPE " + types +
         "\nCOUNT " + counts + "\nWIDTH " + width + "\nHEIGHT " + height +
         "\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS " + points + "\nDATA " + data + "\n";
}

std::string ply(const std::string& format, const std::string& body) {
  return "ply\nformat " + format + " 1.0\n" + body + "end_header\n";
}

const char kXyz[] = "property float x\nproperty float y\nproperty float z\n";

TEST(Pcd, PaddedOrganisedBinaryOfManyTypes) {
  std::string bytes = pcd("x y z _ rgb label big", "4 4 4 1 4 1 8", "F F F U F U I",
                          "1 1 1 4 1 1 1", "2", "2", "4", "binary");
  for (int i = 0; i < 4; ++i) {
    put(bytes, static_cast<float>(i));
    put(bytes, static_cast<float>(10 + i));
    put(bytes, i == 2 ? std::nanf("") : static_cast<float>(20 + i));
    put(bytes, std::uint32_t{0xdeadbeef});
    put(bytes, std::uint32_t{0x00102030} + static_cast<std::uint32_t>(i));
    put(bytes, static_cast<std::uint8_t>(200 + i));
    put(bytes, static_cast<std::int64_t>(-5 - i));
  }
  for (const std::size_t padding : {std::size_t{0}, std::size_t{4000}}) {
    const CloudFile file = read_from_memory(bytes + std::string(padding, '\0'), "a.pcd");
    ASSERT_EQ(file.cloud.size(), 4u);
    EXPECT_EQ(file.report.width, 2u);
    EXPECT_EQ(file.report.height, 2u);
    EXPECT_EQ(file.report.non_finite, 1u);
    EXPECT_EQ(file.cloud.points[3], Eigen::Vector3f(3, 13, 23));
    EXPECT_EQ(file.cloud.colors[1], (std::array<std::uint8_t, 3>{0x10, 0x20, 0x31}));
    EXPECT_EQ(file.cloud.labels.at("label"), std::vector<int>({200, 201, 202, 203}));
    EXPECT_EQ(file.cloud.labels.at("big"), std::vector<int>({-5, -6, -7, -8}));
  }
  EXPECT_THAT(read_error(bytes + "rest", "a.pcd"), HasSubstr("4 bytes behind the last point"));
}

TEST(Pcd, AsciiOddities) {
  const std::string head =
      "VERSION .5\r\nCOLUMNS x y z rgb n\r\nSIZE 4 4 4 4 4\r\nTYPE F F F F F\r\nCOUNT 1 1 1 1 3\r\n"
      "WIDTH 3\r\nHEIGHT 1\r\nPOINTS 3\r\nDATA ascii\r\n";
  const CloudFile file = read_from_memory(
      head +
          "1 2 3 4.2108e+06 7 8 9\r\n\r\n nan nan\tnan 255 1 2 3\r\n-1e3 2.5E-1 +3 65280 1 2 inf",
      "a.pcd");
  ASSERT_EQ(file.cloud.size(), 3u);
  EXPECT_EQ(file.cloud.colors[0], (std::array<std::uint8_t, 3>{0x80, 0x80, 0xE0}));
  EXPECT_EQ(file.cloud.colors[1], (std::array<std::uint8_t, 3>{0, 0, 255}));
  EXPECT_EQ(file.cloud.colors[2], (std::array<std::uint8_t, 3>{0, 255, 0}));
  EXPECT_EQ(file.cloud.scalars.at("n_1"), std::vector<float>({8, 2, 2}));
  EXPECT_EQ(file.report.non_finite, 1u);
  EXPECT_EQ(file.report.non_finite_attributes, 1u);
  EXPECT_EQ(file.cloud.points[2].y(), 0.25f);
}

TEST(Pcd, AsciiWithCommasAndMissingValues) {
  const std::string head =
      pcd("x y z rgb s", "4 4 4 4 4", "F F F F F", "1 1 1 1 1", "2", "1", "2", "ascii");
  const CloudFile file = read_from_memory(head + "1,2,3,255,\n,2,3,65280,5\n", "a.pcd");
  ASSERT_EQ(file.cloud.size(), 2u);
  EXPECT_EQ(file.report.non_finite, 1u);
  EXPECT_EQ(file.report.non_finite_attributes, 1u);
  EXPECT_EQ(file.cloud.colors[1], (std::array<std::uint8_t, 3>{0, 255, 0}));
  // A float may be missing, three bytes of colour may not.
  const std::string missing = head + "1,2,3,255,4\n1,2,3,,5\n";
  EXPECT_THAT(read_error(missing, "a.pcd"), HasSubstr("found no value, expected a colour"));
  ReadOptions lenient;
  lenient.lenient = true;
  EXPECT_EQ(read_from_memory(missing, "a.pcd", lenient).cloud.size(), 1u);
}

TEST(Pcd, CompressedWithAndWithoutPaddingColumns) {
  // All bytes plain: runs of up to 32.
  const auto pack = [](const std::string& bytes) {
    std::string out;
    for (std::size_t i = 0; i < bytes.size(); i += 32) {
      const std::string run = bytes.substr(i, 32);
      out += static_cast<char>(run.size() - 1);
      out += run;
    }
    return out;
  };
  for (const bool with_padding : {false, true}) {
    std::string columns;
    for (const float v : {1.0f, 2.0f, 3.0f, 4.0f, 5.0f, 6.0f}) put(columns, v);
    if (with_padding) columns += std::string(6, 'p');
    columns += "\x07\x08";
    const std::string packed = pack(columns);
    std::string bytes =
        pcd("x y z _ l", "4 4 4 1 1", "F F F U U", "1 1 1 3 1", "2", "1", "2", "binary_compressed");
    put(bytes, static_cast<std::uint32_t>(packed.size()));
    put(bytes, static_cast<std::uint32_t>(columns.size()));
    const CloudFile file = read_from_memory(bytes + packed, "a.pcd");
    ASSERT_EQ(file.cloud.size(), 2u);
    EXPECT_EQ(file.cloud.points[1], Eigen::Vector3f(2, 4, 6));
    EXPECT_EQ(file.cloud.labels.at("l"), std::vector<int>({7, 8}));
  }
}

TEST(Pcd, HeadersThatLieAreErrorsBeforeMemoryIsTaken) {
  const struct {
    std::string bytes;
    const char* message;
  } cases[] = {
      {pcd("x y z", "4 4 4", "F F F", "1 1 1", "4294967295", "4294967295", "18446744065119617025",
           "binary"),
       "found the end of the file after at most 0 points"},
      {pcd("x y z", "4 4 4", "F F F", "1 1 1", "4294967295", "1", "4294967295", "ascii"),
       "found the end of the file after at most 0 points"},
      {pcd("x y z", "4 4 4", "F F F", "1 1 1", "4294967296", "4294967296", "0", "binary"),
       "expected numbers below 4294967296"},
      {pcd("x y z", "4 4 4", "F F F", "1 1 1", "2", "1", "3", "binary"),
       "expected WIDTH x HEIGHT = 2"},
      {pcd("x y z", "4 4 4", "F F F", "1 1 1", "-2", "1", "3", "binary"), "found '-2' after WIDTH"},
      {pcd("x y z", "4 4 4", "F F F", "1 1 16777216", "1", "1", "1", "binary"), "expected 1"},
      {pcd("x y z", "4 4 4", "F F F", "1 1 99999999", "1", "1", "1", "binary"), "found count"},
      {pcd("x y z", "4 4 3", "F F F", "1 1 1", "0", "1", "0", "binary"), "expected 1, 2, 4 or 8"},
      {pcd("x y z", "4 4 2", "F F F", "1 1 1", "0", "1", "0", "binary"),
       "expected F of 4 or 8 bytes"},
      {pcd("x y z", "4 4 4", "F F Q", "1 1 1", "0", "1", "0", "binary"), "expected I, U or F"},
      {pcd("x y z", "4 4", "F F F", "1 1 1", "0", "1", "0", "binary"), "one for each of 3 fields"},
      {pcd("x y x", "4 4 4", "F F F", "1 1 1", "0", "1", "0", "binary"), "found field 'x' twice"},
      {pcd("a b c", "4 4 4", "F F F", "1 1 1", "0", "1", "0", "binary"), "found no field 'x'"},
      {pcd("x y z", "4 4 4", "F F F", "1 1 1", "0", "1", "0", "zipped"),
       "expected ascii, binary or"},
      {pcd("x y z", "4 4 4", "F F F", "1 1 1", "1", "1", "1", "ascii") + "10 20\n",
       "line 12: found 2 values, expected 3"},
      {pcd("x y z", "4 4 4", "F F F", "1 1 1", "1", "1", "1", "ascii") + "1 2 3 4\n",
       "line 12: found more than 3 values"},
      {pcd("x y z", "4 4 4", "F F F", "1 1 1", "1", "1", "1", "ascii") + "1 two 3\n",
       "line 12: found 'two', expected a number"},
      {pcd("x y z l", "4 4 4 1", "F F F U", "1 1 1 1", "1", "1", "1", "ascii") + "1 2 3 256\n",
       "line 12: found '256', expected a number in the range"},
      {pcd("x y z", "4 4 4", "F F F", "1 1 1", "1000000", "1", "1000000", "binary_compressed") +
           std::string("\x02\0\0\0\0\x1b\xb7\0\0a", 10),
       "expected at most 440 from 2 compressed ones"},
      {pcd("x y z", "4 4 4", "F F F", "1 1 1", "1", "1", "1", "binary_compressed") +
           std::string("\xff\0\0\0\x0c\0\0\0", 8),
       "expected at most the 0 that follow"},
  };
  for (const auto& c : cases) {
    test::MemoryMeter meter;
    EXPECT_THAT(read_error(c.bytes, "a.pcd"), HasSubstr(c.message));
    EXPECT_LT(meter.peak(), 300000u) << c.message;
  }
}

TEST(Pcd, LenientReadingSalvagesAndCounts) {
  ReadOptions lenient;
  lenient.lenient = true;
  const std::string head = pcd("x y z", "4 4 4", "F F F", "1 1 1", "9", "1", "9", "ascii");
  const CloudFile file = read_from_memory(head + "1 2 3\n1 2\n4 5 6\n7 8 9", "a.pcd", lenient);
  EXPECT_EQ(file.cloud.size(), 3u);
  const std::vector<std::pair<std::string, std::uint64_t>> dropped = {{"bad line", 1},
                                                                      {"truncated", 5}};
  EXPECT_EQ(file.report.dropped, dropped);
  std::string binary = pcd("x y z", "4 4 4", "F F F", "1 1 1", "9", "1", "9", "binary");
  for (int i = 0; i < 7; ++i) put(binary, static_cast<float>(i));
  const CloudFile short_file = read_from_memory(binary, "a.pcd", lenient);
  EXPECT_EQ(short_file.cloud.size(), 2u);
  EXPECT_EQ(short_file.report.dropped[0],
            std::make_pair(std::string("truncated"), std::uint64_t{7}));
}

TEST(Ply, ListsAndElementsAroundTheVertices) {
  for (const bool big : {false, true}) {
    std::string bytes =
        ply(big ? "binary_big_endian" : "binary_little_endian",
            "comment a remark\nobj_info more\nelement empty 5\nelement face 2\n"
            "property uchar flags\nproperty list uint16 int8 vertex_indices\n"
            "element vertex 3\nproperty list uchar double samples\n" +
                std::string(kXyz) + "property short s\nelement tail 2\nproperty double d\n");
    for (const int corners : {3, 4}) {
      put(bytes, std::uint8_t{9});
      put(bytes, static_cast<std::uint16_t>(corners), big);
      for (int k = 0; k < corners; ++k) put(bytes, static_cast<std::int8_t>(k % 3));
    }
    for (int i = 0; i < 3; ++i) {
      put(bytes, static_cast<std::uint8_t>(i));
      for (int k = 0; k < i; ++k) put(bytes, 0.5, big);
      for (int k = 0; k < 3; ++k) put(bytes, static_cast<float>(10 * i + k), big);
      put(bytes, static_cast<std::int16_t>(-i), big);
    }
    put(bytes, 1.0, big);
    put(bytes, 2.0, big);
    ReadOptions options;
    options.triangles = true;
    const CloudFile file = read_from_memory(bytes, "a.ply", options);
    ASSERT_EQ(file.cloud.size(), 3u);
    EXPECT_EQ(file.report.faces, 2u);
    EXPECT_EQ(file.cloud.points[2], Eigen::Vector3f(20, 21, 22));
    EXPECT_EQ(file.cloud.labels.at("s"), std::vector<int>({0, -1, -2}));
    const std::vector<std::array<std::uint32_t, 3>> triangles = {{0, 1, 2}, {0, 1, 2}, {0, 2, 0}};
    EXPECT_EQ(file.triangles, triangles);
    EXPECT_TRUE(read_from_memory(bytes, "a.ply").triangles.empty());
    EXPECT_THAT(read_error(bytes.substr(0, bytes.size() - 1), "a.ply"), HasSubstr("'tail'"));
    EXPECT_THAT(read_error(bytes + "x", "a.ply"), HasSubstr("1 bytes behind the last element"));
  }
}

TEST(Ply, AsciiFacesAndLineEnds) {
  const std::string lines = "ply\nformat ascii 1.0\nelement vertex 3\n" + std::string(kXyz) +
                            "element face 1\nproperty list uchar int vertex_index\nend_header\n"
                            "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
  ReadOptions options;
  options.triangles = true;
  for (const char* const ending : {"\n", "\r\n", "\r"}) {
    std::string text;
    for (const char c : lines) text += c == '\n' ? std::string(ending) : std::string(1, c);
    const CloudFile file = read_from_memory(text, "a.ply", options);
    EXPECT_EQ(file.cloud.size(), 3u);
    EXPECT_EQ(file.triangles.size(), 1u);
  }
  std::string bad = lines;
  bad.replace(bad.find("3 0 1 2"), 7, "3 0 1 3");
  EXPECT_THAT(read_error(bad, "a.ply", options), HasSubstr("line 13: found a face with vertex 3"));
  EXPECT_EQ(read_error(bad, "a.ply"), "");  // faces that nobody wants are not looked into
  bad.replace(bad.find("3 0 1 3"), 7, "9 0 1 2");
  EXPECT_THAT(read_error(bad, "a.ply"), HasSubstr("line 13: found a list of 9"));
}

TEST(Ply, BinaryAfterCarriageReturns) {
  std::string bytes =
      "ply\r\nformat binary_little_endian 1.0\r\nelement vertex 1\r\nproperty uchar x\r\n"
      "property uchar y\r\nproperty uchar z\r\nend_header\r\n";
  EXPECT_EQ(read_from_memory(bytes + "\n\r\n", "a.ply").cloud.points[0],
            Eigen::Vector3f(10, 13, 10));
  std::string old_mac;
  for (const char c : bytes) {
    if (c != '\n') old_mac += c;
  }
  EXPECT_EQ(read_from_memory(old_mac + "\n\r\n", "a.ply").cloud.points[0],
            Eigen::Vector3f(10, 13, 10));
}

TEST(Ply, ColorsOfAllKinds) {
  const auto color = [](const std::string& type, const std::string& values) {
    const std::string text =
        ply("ascii", "element vertex 2\n" + std::string(kXyz) + "property " + type +
                         " red\nproperty " + type + " green\nproperty " + type + " blue\n") +
        "0 0 0 " + values + "\n0 0 1 0 0 0\n";
    return read_from_memory(text, "a.ply").cloud.colors.at(0);
  };
  using Color = std::array<std::uint8_t, 3>;
  EXPECT_EQ(color("uchar", "1 2 255"), (Color{1, 2, 255}));
  EXPECT_EQ(color("char", "1 2 200"), (Color{1, 2, 200}));
  EXPECT_EQ(color("ushort", "256 65535 32768"), (Color{1, 255, 128}));
  EXPECT_EQ(color("ushort", "255 7 0"), (Color{255, 7, 0}));
  EXPECT_EQ(color("float", "1.0 0.5 0"), (Color{255, 128, 0}));
  EXPECT_EQ(color("float", "255 127.6 nan"), (Color{255, 128, 0}));
}

TEST(Ply, HeadersThatLieAreErrorsBeforeMemoryIsTaken) {
  const std::string little = "binary_little_endian";
  const struct {
    std::string bytes;
    const char* message;
  } cases[] = {
      {ply(little, "element vertex 18446744073709551615\n" + std::string(kXyz)),
       "of element 'vertex'"},
      {ply("ascii", "element vertex 1000000000000\n" + std::string(kXyz)), "of element 'vertex'"},
      {ply(little, "element vertex 18446744073709551616\n" + std::string(kXyz)),
       "expected 'element NAME"},
      {ply(little, "element vertex -1\n" + std::string(kXyz)), "expected 'element NAME COUNT'"},
      {ply(little, "element vertex 1000000000000\n"), "found no field 'x'"},
      {ply(little, "element vertex 0\n" + std::string(kXyz) +
                       "element face 4000000000\nproperty list int int vertex_indices\n"),
       "of element 'face'"},
      {ply(little, "element vertex 0\n" + std::string(kXyz) +
                       "element face 1\nproperty list uint int vertex_indices\n") +
           "\xff\xff\xff\xff",
       "found the end of the file after 0 of element 'face'"},
      {ply(little, "element vertex 0\n" + std::string(kXyz) +
                       "element face 1\nproperty list int int vertex_indices\n") +
           "\xff\xff\xff\xff",
       "expected 0 or more"},
      {ply(little, "element vertex 0\n" + std::string(kXyz) +
                       "element face 1\nproperty list float int vertex_indices\n"),
       "counted in floats"},
      {ply(little, "element vertex 0\n" + std::string(kXyz) + "property float x\n"), "'x' twice"},
      {ply(little, "element vertex 0\n" + std::string(kXyz) + "element vertex 0\n"),
       "second element"},
      {ply(little, "element vertex 0\nproperty quaternion q\n"),
       "found property type 'quaternion'"},
      {ply("binary", "element vertex 0\n" + std::string(kXyz)), "found format 'binary'"},
      {"ply\nelement vertex 0\n" + std::string(kXyz) + "end_header\n", "expected a format line"},
      {"ply\nformat ascii 1.0\nelement vertex 0\n" + std::string(kXyz), "expected end_header"},
      {"ply\nformat ascii 1.0\nvertex 0\n", "line 3: found 'vertex'"},
      {"plyx\n", "found no known format"},
      {ply("ascii", "comment camber origin 1 2\nelement vertex 0\n" + std::string(kXyz)),
       "line 3: found '' in 'camber origin'"},
      {ply("ascii", "element vertex 1\n" + std::string(kXyz) + "property int i\n") + "1 2 3 1.5\n",
       "expected a whole number"},
      {ply("ascii", "element vertex 1\n" + std::string(kXyz)) + "1 2 3\n4 5 6\n",
       "6 bytes behind the last element"},
  };
  for (const auto& c : cases) {
    test::MemoryMeter meter;
    EXPECT_THAT(read_error(c.bytes, "a.what"), HasSubstr(c.message));
    EXPECT_LT(meter.peak(), 300000u) << c.message;
  }
}

TEST(Ply, WholeNumbersBeyondIntBecomeScalars) {
  const std::string text = ply("ascii", "element vertex 2\n" + std::string(kXyz) +
                                            "property uint small\nproperty uint large\n"
                                            "property int64 huge\n") +
                           "0 0 0 7 4294967295 9223372036854775807\n0 0 0 8 1 1\n";
  const RoadCloud cloud = read_from_memory(text, "a.ply").cloud;
  EXPECT_EQ(cloud.labels.at("small"), std::vector<int>({7, 8}));
  EXPECT_EQ(cloud.scalars.at("large"), std::vector<float>({4294967295.0f, 1.0f}));
  EXPECT_EQ(cloud.scalars.at("huge"), std::vector<float>({9223372036854775807.0f, 1.0f}));
}

TEST(Files, LongHeadersAndLinesStayLinearInMemory) {
  std::string header = "ply\nformat ascii 1.0\n";
  for (int i = 0; i < 5000; ++i) header += "element e" + std::to_string(i) + " 0\n";
  test::MemoryMeter meter;
  EXPECT_THAT(read_error(header, "a.ply"), HasSubstr("more than 4096 elements"));
  EXPECT_THAT(read_error("ply\nformat ascii 1.0\ncomment " + std::string(1 << 20, 'x'), "a.ply"),
              HasSubstr("found a line of more than 65536 bytes"));
  EXPECT_LT(meter.peak(), 8u << 20);
}

TEST(Files, AFileReadInManyWindowsGivesTheSameAsInMemory) {
  const test::TemporaryFolder folder;
  // Records that do not divide the window, so that they lie across its ends.
  RoadCloud cloud = test::make_full_cloud(30011);
  for (const CloudFormat format : {CloudFormat::kPly, CloudFormat::kPcd}) {
    for (const CloudEncoding encoding : {CloudEncoding::kBinary, CloudEncoding::kAscii}) {
      const std::string bytes = test::write_to_memory(cloud, format, encoding);
      const std::filesystem::path path = folder.path() / "cloud";
      std::ofstream(path, std::ios::binary) << bytes;
      const RoadCloud from_file = read_cloud(path);
      EXPECT_EQ(from_file.points, cloud.points);
      EXPECT_EQ(from_file.labels, cloud.labels);
      EXPECT_EQ(from_file.covariances, cloud.covariances);
    }
  }
}

}  // namespace
}  // namespace camber
