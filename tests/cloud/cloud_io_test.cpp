// Round trips, recognition of formats, and what all readers share.

#include "camber/cloud/cloud_io.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdio>
#include <limits>

#include "cloud/cloud_files.h"
#include "cloud/memory_meter.h"
#include "support/test_data.h"

namespace camber {
namespace {

using test::make_full_cloud;
using test::read_error;
using test::read_from_memory;
using test::write_to_memory;
using ::testing::HasSubstr;

struct Encoding {
  const char* name;
  CloudFormat format;
  CloudEncoding encoding;
  float tolerance = 0.0f;  // m, of a coordinate
};

class RoundTrip : public ::testing::TestWithParam<Encoding> {
 protected:
  // Text has no mark of its own; the others are known by their content.
  std::string name() const {
    return GetParam().format == CloudFormat::kText ? "cloud.xyz" : "cloud";
  }
};

/// LAS points always have these; where a cloud has none they hold one value.
void drop_standard_las_labels(RoadCloud& cloud) {
  for (const char* const name :
       {"class_flags", "classification", "edge_of_flight_line", "intensity", "number_of_returns",
        "point_source_id", "return_number", "scan_angle_rank", "scan_direction_flag",
        "user_data"}) {
    const auto found = cloud.labels.find(name);
    if (found == cloud.labels.end()) continue;
    for (const int value : found->second) EXPECT_EQ(value, found->second[0]) << name;
    cloud.labels.erase(found);
  }
}

void expect_equal(const RoadCloud& a, const RoadCloud& b, float tolerance = 0.0f) {
  EXPECT_EQ(a.frame, b.frame);
  EXPECT_EQ(a.metric, b.metric);
  EXPECT_EQ(a.origin, b.origin);
  if (tolerance == 0.0f) {
    EXPECT_EQ(a.points, b.points);
  } else {
    ASSERT_EQ(a.size(), b.size());
    for (std::size_t i = 0; i < a.size(); ++i) {
      EXPECT_LE((a.points[i] - b.points[i]).cwiseAbs().maxCoeff(), tolerance);
    }
  }
  EXPECT_EQ(a.colors, b.colors);
  EXPECT_EQ(a.sigmas, b.sigmas);
  EXPECT_EQ(a.covariances, b.covariances);
  EXPECT_EQ(a.normals, b.normals);
  EXPECT_EQ(a.labels, b.labels);
  EXPECT_EQ(a.scalars, b.scalars);
}

TEST_P(RoundTrip, KeepsEveryAttributeBitForBit) {
  for (const std::size_t count : {1u, 2u, 1023u, 20000u}) {
    const RoadCloud cloud = make_full_cloud(count);
    const std::string bytes = write_to_memory(cloud, GetParam().format, GetParam().encoding);
    CloudFile file = read_from_memory(bytes, name());
    if (is_las(GetParam().format)) drop_standard_las_labels(file.cloud);
    expect_equal(cloud, file.cloud, GetParam().tolerance);
    EXPECT_EQ(file.report.format, GetParam().format);
    EXPECT_EQ(file.report.points, count);
    EXPECT_EQ(file.report.non_finite, 0u);
    EXPECT_TRUE(file.report.dropped.empty());
  }
}

TEST_P(RoundTrip, KeepsTheEmptyCloud) {
  RoadCloud cloud;
  cloud.frame = CloudFrame::kZUp;
  CloudFile file =
      read_from_memory(write_to_memory(cloud, GetParam().format, GetParam().encoding), name());
  if (is_las(GetParam().format)) drop_standard_las_labels(file.cloud);
  expect_equal(cloud, file.cloud);
}

TEST_P(RoundTrip, KeepsOriginAndScale) {
  RoadCloud cloud = make_full_cloud(300);
  cloud.frame = CloudFrame::kZUp;
  cloud.metric = false;
  cloud.origin = {289000.0, 4321000.0, 100.5};
  const CloudFile file =
      read_from_memory(write_to_memory(cloud, GetParam().format, GetParam().encoding), name());
  EXPECT_EQ(file.cloud.frame, CloudFrame::kZUp);
  EXPECT_FALSE(file.cloud.metric);
  EXPECT_EQ(file.cloud.origin, cloud.origin);
  ASSERT_EQ(file.cloud.size(), cloud.size());
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    // Half a unit in the last place of a double near 4.3e6, then of a float near 50.
    EXPECT_LE((file.cloud.points[i] - cloud.points[i]).norm(),
              1e-8f + 4e-6f + 1.8f * GetParam().tolerance);
  }
}

TEST_P(RoundTrip, KeepsAndCountsPointsThatAreNotFinite) {
  RoadCloud cloud = make_full_cloud(10);
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const float infinity = std::numeric_limits<float>::infinity();
  cloud.points[3] = {nan, nan, nan};
  cloud.points[5].y() = infinity;
  cloud.points[6].z() = -infinity;
  cloud.scalars["intensity"][7] = nan;
  if (is_las(GetParam().format)) {
    EXPECT_THROW(write_to_memory(cloud, GetParam().format), std::invalid_argument);
    return;
  }
  const std::string bytes = write_to_memory(cloud, GetParam().format, GetParam().encoding);
  const CloudFile file = read_from_memory(bytes, name());
  ASSERT_EQ(file.cloud.size(), 10u);
  EXPECT_EQ(file.report.non_finite, 3u);
  EXPECT_EQ(file.report.non_finite_attributes, 1u);
  EXPECT_TRUE(std::isnan(file.cloud.points[3].x()));
  EXPECT_EQ(file.cloud.points[5].y(), infinity);
  EXPECT_EQ(file.cloud.points[6].z(), -infinity);

  ReadOptions lenient;
  lenient.lenient = true;
  const CloudFile salvaged = read_from_memory(bytes, name(), lenient);
  EXPECT_EQ(salvaged.cloud.size(), 7u);
  EXPECT_EQ(salvaged.cloud.points[3], cloud.points[4]);
  EXPECT_EQ(salvaged.cloud.labels.at("patch")[3], cloud.labels.at("patch")[4]);
  ASSERT_EQ(salvaged.report.dropped.size(), 1u);
  EXPECT_EQ(salvaged.report.dropped[0].first, "not finite");
  EXPECT_EQ(salvaged.report.dropped[0].second, 3u);
}

TEST_P(RoundTrip, CutAtEveryLengthNeverCrashesAndNeverPassesForWhole) {
  const std::string bytes =
      write_to_memory(make_full_cloud(3), GetParam().format, GetParam().encoding);
  const bool ascii = GetParam().encoding == CloudEncoding::kAscii;
  ReadOptions lenient;
  lenient.lenient = true;
  for (std::size_t length = 0; length < bytes.size(); ++length) {
    const std::string cut = bytes.substr(0, length);
    const std::string name = std::string("cut.") + std::string(to_string(GetParam().format));
    test::MemoryMeter meter;
    const std::string error = read_error(cut, name);
    EXPECT_LT(meter.peak(), 4u << 20) << length;
    if (error.empty()) {
      // The last number of a text may lose digits, or the line its end, without leaving a trace.
      const std::size_t last_blank = bytes.find_last_of(' ');
      // Text does not say how many points it has.
      // LAZ without its table of chunks has all points, and a note.
      const bool without_table = GetParam().format == CloudFormat::kLaz &&
                                 read_from_memory(cut, name).cloud.size() == 3 &&
                                 !read_from_memory(cut, name).report.notes.empty();
      EXPECT_TRUE(GetParam().format == CloudFormat::kText || without_table ||
                  (ascii && length > last_blank + 1))
          << "cut at " << length;
    } else {
      EXPECT_THAT(error, HasSubstr(name + ": "));
      EXPECT_THAT(error, HasSubstr("expected")) << error;
    }
    try {
      const CloudFile file = read_from_memory(cut, name, lenient);
      EXPECT_LE(file.cloud.size(), 3u);
      file.cloud.validate();
    } catch (const InputError&) {
    }
  }
}

TEST_P(RoundTrip, EveryBitOfTheFileFlippedGivesAnErrorOrASoundCloud) {
  const std::string bytes =
      write_to_memory(make_full_cloud(2), GetParam().format, GetParam().encoding);
  const std::string name = std::string("flipped.") + std::string(to_string(GetParam().format));
  for (const bool lenient : {false, true}) {
    ReadOptions options;
    options.lenient = lenient;
    for (std::size_t bit = 0; bit < 8 * bytes.size(); ++bit) {
      std::string damaged = bytes;
      damaged[bit / 8] = static_cast<char>(damaged[bit / 8] ^ (1 << (bit % 8)));
      test::MemoryMeter meter;
      try {
        const CloudFile file = read_from_memory(damaged, name, options);
        file.cloud.validate();
        EXPECT_LE(file.cloud.size(), bytes.size());
      } catch (const InputError& error) {
        EXPECT_THAT(error.what(), HasSubstr(name + ": "));
      }
      EXPECT_LT(meter.peak(), 4u << 20) << "bit " << bit;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(
    Formats, RoundTrip,
    ::testing::Values(Encoding{"PcdBinary", CloudFormat::kPcd, CloudEncoding::kBinary},
                      Encoding{"PcdAscii", CloudFormat::kPcd, CloudEncoding::kAscii},
                      Encoding{"PcdCompressed", CloudFormat::kPcd, CloudEncoding::kCompressed},
                      Encoding{"PlyLittle", CloudFormat::kPly, CloudEncoding::kBinary},
                      Encoding{"PlyBig", CloudFormat::kPly, CloudEncoding::kBigEndian},
                      Encoding{"PlyAscii", CloudFormat::kPly, CloudEncoding::kAscii},
                      // Steps of 0.1 mm, half of one and the rounding of a float near 50.
                      Encoding{"Las", CloudFormat::kLas, CloudEncoding::kBinary, 5.3e-5f},
                      Encoding{"Laz", CloudFormat::kLaz, CloudEncoding::kBinary, 5.3e-5f},
                      Encoding{"TextBlanks", CloudFormat::kText, CloudEncoding::kBinary},
                      Encoding{"TextCommas", CloudFormat::kText, CloudEncoding::kCommas}),
    [](const auto& instance) { return std::string(instance.param.name); });

TEST(KittiBin, KeepsCoordinatesAndIntensity) {
  RoadCloud cloud;
  cloud.points = {{1.0f, 2.0f, 3.0f}, {4.0f, 5.0f, -6.0f}};
  cloud.scalars["intensity"] = {0.25f, 0.5f};
  const std::string bytes = write_to_memory(cloud, CloudFormat::kKittiBin);
  EXPECT_EQ(bytes.size(), 32u);
  expect_equal(cloud, read_from_memory(bytes, "000000.bin").cloud);
  cloud.scalars.clear();
  EXPECT_EQ(read_from_memory(write_to_memory(cloud, CloudFormat::kKittiBin), "000000.bin")
                .cloud.scalars.at("intensity"),
            std::vector<float>({0.0f, 0.0f}));
}

TEST(KittiBin, OddSizesAndForeignContentAreErrors) {
  RoadCloud cloud;
  cloud.points = {{1.0f, 2.0f, 3.0f}, {4.0f, 5.0f, -6.0f}};
  const std::string bytes = write_to_memory(cloud, CloudFormat::kKittiBin);
  EXPECT_EQ(read_error(bytes + "x", "a.bin"),
            "a.bin: found 33 bytes, expected a multiple of 16 (float32 x y z reflectance)");
  ReadOptions lenient;
  lenient.lenient = true;
  EXPECT_EQ(read_from_memory(bytes + "x", "a.bin", lenient).cloud.size(), 2u);
  EXPECT_THAT(read_error("This is text, sixteen bytes wide", "a.bin"),
              HasSubstr("byte 0: found the coordinate"));
  std::string broken = bytes;
  broken.replace(20, 4, std::string("\x00\x00\xc0\x7f", 4));  // NaN
  EXPECT_THAT(read_error(broken, "a.bin"), HasSubstr("byte 20: found the coordinate"));
  EXPECT_EQ(read_from_memory(broken, "a.bin", lenient).cloud.size(), 1u);
  EXPECT_TRUE(read_from_memory("", "a.bin").cloud.empty());
}

TEST(Lenient, DropsDuplicatesAndPointsOutOfRange) {
  RoadCloud cloud;
  cloud.points = {{1, 2, 3}, {1e20f, 0, 0}, {1, 2, 3}, {0.0f, 1, 1}, {-0.0f, 1, 1}, {2, 2, 2}};
  cloud.labels["id"] = {0, 1, 2, 3, 4, 5};
  ReadOptions lenient;
  lenient.lenient = true;
  const CloudFile file =
      read_from_memory(write_to_memory(cloud, CloudFormat::kPly), "a.ply", lenient);
  EXPECT_EQ(file.cloud.labels.at("id"), std::vector<int>({0, 3, 5}));
  const std::vector<std::pair<std::string, std::uint64_t>> dropped = {{"out of range", 1},
                                                                      {"duplicate", 2}};
  EXPECT_EQ(file.report.dropped, dropped);
}

TEST(Formats, AreFoundByContentThenByExtension) {
  const RoadCloud cloud = make_full_cloud(2);
  const std::string ply = write_to_memory(cloud, CloudFormat::kPly);
  const std::string pcd = write_to_memory(cloud, CloudFormat::kPcd);
  EXPECT_EQ(read_from_memory(ply, "odd.pcd").report.format, CloudFormat::kPly);
  EXPECT_EQ(read_from_memory(pcd, "odd.bin").report.format, CloudFormat::kPcd);
  EXPECT_EQ(read_from_memory(pcd, "none").report.format, CloudFormat::kPcd);
  EXPECT_EQ(read_from_memory(ply, "ODD.PLY").report.format, CloudFormat::kPly);
  EXPECT_THAT(read_error("\x01\x02\x03\x04", "noise.dat"), HasSubstr("found no known format"));
  EXPECT_THAT(read_error("ASTM-E57 and more", "a.bin"), HasSubstr("expected 48 bytes"));
  EXPECT_THAT(read_error("whatever", "mesh.obj"), HasSubstr("Wavefront OBJ"));
  EXPECT_EQ(format_from_extension("A.PLY"), CloudFormat::kPly);
  EXPECT_EQ(format_from_extension("a.b.csv"), CloudFormat::kText);
  EXPECT_EQ(format_from_extension("ply"), std::nullopt);
}

TEST(Files, AreWrittenAtomicallyAndReadBack) {
  const test::TemporaryFolder folder;
  const RoadCloud cloud = make_full_cloud(50000);  // many times the reader's window
  for (const char* const name : {"a.ply", "a.pcd"}) {
    write_cloud(cloud, folder.path() / name);
    expect_equal(cloud, read_cloud(folder.path() / name));
    WriteOptions ascii;
    ascii.encoding = CloudEncoding::kAscii;
    write_cloud(cloud, folder.path() / name, ascii);
    expect_equal(cloud, read_cloud(folder.path() / name));
  }
  WriteOptions compressed;
  compressed.encoding = CloudEncoding::kCompressed;
  write_cloud(cloud, folder.path() / "b.pcd", compressed);
  expect_equal(cloud, read_cloud(folder.path() / "b.pcd"));
  EXPECT_THROW(write_cloud(cloud, folder.path() / "b.ply", compressed), std::invalid_argument);
  EXPECT_THROW(write_cloud(cloud, folder.path() / "b.what"), std::invalid_argument);
  EXPECT_THROW(write_cloud(cloud, folder.path() / "none" / "b.ply"), OutputError);
  EXPECT_THROW(read_cloud(folder.path() / "none.ply"), InputError);
  EXPECT_THROW(read_cloud(folder.path()), InputError);
  EXPECT_FALSE(std::filesystem::exists(folder.path() / "b.ply"));
  RoadCloud bad = cloud;
  bad.sigmas.pop_back();
  EXPECT_THROW(write_cloud(bad, folder.path() / "c.ply"), std::invalid_argument);
  RoadCloud nameless;  // a reader would find a property without a name
  nameless.points = {{1, 2, 3}};
  nameless.scalars[""] = {0.5f};
  EXPECT_THROW(write_cloud(nameless, folder.path() / "d.ply"), std::invalid_argument);
}

TEST(RoadPly, HasThePropertiesOfAReconstruction) {
  RoadCloud cloud;
  cloud.frame = CloudFrame::kCamera;
  cloud.points = {{1, 2, 3}};
  cloud.colors = {{4, 5, 6}};
  cloud.sigmas = {0.5f};
  cloud.labels["patch"] = {-1};
  const std::string bytes = write_to_memory(cloud, CloudFormat::kPly);
  EXPECT_EQ(bytes.substr(0, bytes.find("end_header\n") + 11),
            "ply\nformat binary_little_endian 1.0\ncomment camber frame camera\n"
            "element vertex 1\nproperty float x\nproperty float y\nproperty float z\n"
            "property uchar red\nproperty uchar green\nproperty uchar blue\n"
            "property float sigma\nproperty int patch\nend_header\n");
  cloud.metric = false;
  EXPECT_THAT(write_to_memory(cloud, CloudFormat::kPcd), HasSubstr("# camber metric false\n"));
}

TEST(Streams, WithAnUnknownCountFillItInAtTheEnd) {
  const RoadCloud cloud = make_full_cloud(12345);
  for (const CloudFormat format : {CloudFormat::kPly, CloudFormat::kPcd}) {
    for (const CloudEncoding encoding : {CloudEncoding::kBinary, CloudEncoding::kAscii}) {
      std::ostringstream out;
      const auto source = make_point_source(cloud);
      PointStreamHeader header = source->header();
      header.count.reset();
      const auto sink = make_point_sink(out, header, format, encoding);
      PointBatch batch;
      while (source->next(batch)) sink->write(batch);
      sink->finish();
      expect_equal(cloud, read_from_memory(out.str(), "a").cloud);
    }
  }
}

TEST(Pcd, SaysWherePointTypesOfPclWouldStayEmpty) {
  RoadCloud cloud;
  cloud.points = {{1, 2, 3}};
  for (const double east : {0.0, 8000.0, 456000.0}) {
    cloud.origin.x() = east;
    for (const CloudEncoding encoding : {CloudEncoding::kBinary, CloudEncoding::kCompressed}) {
      const auto source = make_point_source(cloud);
      std::ostringstream out;
      const auto sink = make_point_sink(out, source->header(), CloudFormat::kPcd, encoding);
      PointBatch batch;
      while (source->next(batch)) sink->write(batch);
      sink->finish();
      EXPECT_EQ(sink->notes().size(), east > 8000.0 ? 1u : 0u);
      EXPECT_THAT(out.str(), HasSubstr(east > 8000.0 ? "SIZE 8 8 8\n" : "SIZE 4 4 4\n"));
      const RoadCloud again = read_from_memory(out.str(), "a.pcd").cloud;
      EXPECT_EQ(again.origin, cloud.origin);
      EXPECT_EQ(again.points, cloud.points);
    }
  }
}

TEST(AttributeNames, ThatWouldBeOneStayTwo) {
  RoadCloud cloud;
  cloud.points = {{1, 2, 3}};
  cloud.normals = {{0, 0, 1}};
  cloud.labels["a b"] = {1};
  cloud.labels["a_b"] = {2};
  cloud.labels["a\tb"] = {3};
  cloud.labels["normal_x"] = {4};
  for (const auto& [format, name, notes] :
       {std::tuple(CloudFormat::kPly, "a.ply", 2u), std::tuple(CloudFormat::kPcd, "a.pcd", 3u),
        std::tuple(CloudFormat::kText, "a.xyz", 2u)}) {
    const auto source = make_point_source(cloud);
    std::ostringstream out;
    const auto sink = make_point_sink(out, source->header(), format, CloudEncoding::kAscii);
    PointBatch batch;
    while (source->next(batch)) sink->write(batch);
    sink->finish();
    EXPECT_EQ(sink->notes().size(), notes) << name;
    EXPECT_THAT(sink->notes().back(), HasSubstr("since another one is 'a_b'"));
    const RoadCloud again = read_from_memory(out.str(), name).cloud;
    EXPECT_EQ(again.normals, cloud.normals) << name;
    EXPECT_EQ(again.labels.at("a_b"), std::vector<int>{2}) << name;
    EXPECT_EQ(again.labels.at("a_b_"), std::vector<int>{3}) << name;
    EXPECT_EQ(again.labels.at("a_b__"), std::vector<int>{1}) << name;
    EXPECT_EQ(again.labels.at(format == CloudFormat::kPcd ? "normal_x_" : "normal_x"),
              std::vector<int>{4})
        << name;
  }
}

TEST(Origin, IsChosenWhereCoordinatesAreLarge) {
  std::string text =
      "ply\nformat ascii 1.0\nelement vertex 3\nproperty double x\nproperty double y\n"
      "property double z\nend_header\n";
  text += "500123.125 4871234.001 170.5\n500124.25 4871235.002 171\n500125 4871236.003 172\n";
  const CloudFile file = read_from_memory(text, "utm.ply");
  EXPECT_EQ(file.cloud.origin, Eigen::Vector3d(500000, 4871000, 0));
  EXPECT_FLOAT_EQ(file.cloud.points[0].x(), 123.125f);
  EXPECT_FLOAT_EQ(file.cloud.points[2].y(), 236.003f);
  // Said to be float, but written with all digits.
  std::string as_float = text;
  for (std::size_t at; (at = as_float.find("double")) != std::string::npos;) {
    as_float.replace(at, 6, "float");
  }
  EXPECT_FLOAT_EQ(read_from_memory(as_float, "utm.ply").cloud.points[2].y(), 236.003f);
}

TEST(CloudIo, DegreesHaveAnOriginSoThatFloatsHoldThem) {
  const auto farthest = [](const std::string& header, double x, double y, double width) {
    std::string text = header;
    std::vector<Eigen::Vector2d> truth;
    for (int i = 0; i < 100; ++i) {
      truth.emplace_back(x + width * 1e-4 * i * i, y + width * 1e-2 * i);
      char row[80];
      std::snprintf(row, sizeof row, "%.12f,%.12f,300.5\n", truth.back().x(), truth.back().y());
      text += row;
    }
    const RoadCloud cloud = read_from_memory(text, "a.csv").cloud;
    double worst = 0.0;
    for (std::size_t i = 0; i < truth.size(); ++i) {
      const Eigen::Vector3d p = cloud.origin + cloud.points[i].cast<double>();
      worst = std::max(worst, (p.head<2>() - truth[i]).cwiseAbs().maxCoeff());
    }
    return worst;
  };
  // A float at 48 is 2e-6 off, 0.2 m.
  EXPECT_LT(farthest("longitude,latitude,z\n", 8.1234567, 48.7654321, 1e-3), 1e-10);
  EXPECT_LT(farthest("longitude,latitude,z\n", 8.1234567, 48.7654321, 1.0), 1e-7);
  EXPECT_LT(farthest("x,y,z\n", 8.1234567, 48.7654321, 1e-2), 1e-9);
  EXPECT_GT(farthest("x,y,z\n", 8.1234567, 48.7654321, 10.0), 1e-7);
  EXPECT_TRUE(read_from_memory("x,y,z\n1.5,48.5,3\n2,50,3\n", "a.csv").cloud.origin.isZero(0.0));
  // Along a parallel, and a single point.
  const auto place = [](const std::string& text) {
    const RoadCloud cloud = read_from_memory("lon,lat,z\n" + text, "a.csv").cloud;
    return Eigen::Vector3d(cloud.origin + cloud.points[0].cast<double>());
  };
  EXPECT_NEAR(place("8.1234567891,48.7654321987,0\n8.2,48.7654321987,0\n").y(), 48.7654321987,
              1e-10);
  EXPECT_NEAR(place("-71.123456789,-48.7654321987,0\n").x(), -71.123456789, 1e-10);
}

}  // namespace
}  // namespace camber
