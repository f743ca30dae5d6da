#include "camber/cloud/stream_filters.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <limits>
#include <regex>

#include "camber/cloud/voxel_grid.h"
#include "cloud/cloud_files.h"
#include "cloud/memory_meter.h"
#include "support/test_data.h"

namespace camber {
namespace {

using test::make_full_cloud;
using test::read_from_memory;
namespace fs = std::filesystem;

RoadCloud collect(PointSource& source) {
  CloudBuilder builder(source.header(), false);
  PointBatch batch;
  while (source.next(batch)) builder.add(batch);
  ReadReport report;
  return builder.finish(report);
}

TEST(SelectPoints, KeepsWhatThePredicateSays) {
  const RoadCloud cloud = make_full_cloud(20000);
  std::vector<int> expected;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    if (cloud.points[i].x() > 40.0f) expected.push_back(static_cast<int>(i));
  }
  const auto source = select_points(make_point_source(cloud),
                                    [](const Eigen::Vector3d& x) { return x.x() > 40.0; });
  EXPECT_FALSE(source->header().count.has_value());
  const RoadCloud selected = collect(*source);
  const RoadCloud wanted = cloud.select(expected);
  EXPECT_EQ(selected.points, wanted.points);
  EXPECT_EQ(selected.labels, wanted.labels);
  EXPECT_EQ(selected.covariances, wanted.covariances);
  EXPECT_EQ(source->report().points, expected.size());
  EXPECT_TRUE(collect(*select_points(make_point_source(cloud), [](const Eigen::Vector3d&) {
                return false;
              })).empty());
}

TEST(DropBadPoints, CountsWhatItDrops) {
  RoadCloud cloud;
  const float nan = std::numeric_limits<float>::quiet_NaN();
  cloud.points = {{1, 2, 3},
                  {nan, 0, 0},
                  {2e9f, 0, 0},
                  {4, 5, 6},
                  {0, -std::numeric_limits<float>::infinity(), 0}};
  const auto source = drop_bad_points(make_point_source(cloud));
  EXPECT_EQ(collect(*source).size(), 2u);
  const std::vector<std::pair<std::string, std::uint64_t>> dropped = {{"not finite", 2},
                                                                      {"out of range", 1}};
  EXPECT_EQ(source->report().dropped, dropped);
}

TEST(LabelledCopy, KeepsAllElseAsItWas) {
  const test::TemporaryFolder folder;
  // A time that no float holds.
  std::string text =
      "ply\nformat ascii 1.0\nelement vertex 2\nproperty double x\nproperty double y\n"
      "property double z\nproperty double time\nproperty uchar patch\nend_header\n"
      "1 2 3 1000000000.25 7\n4 5 6 1000000000.5 8\n";
  std::ofstream(folder.path() / "in.ply") << text;
  write_labelled_copy(folder.path() / "in.ply", {}, "ground", {1, 0}, folder.path() / "out.ply");
  auto source = open_point_source(folder.path() / "out.ply");
  PointBatch batch;
  ASSERT_TRUE(source->next(batch));
  ASSERT_EQ(source->header().fields.size(), 6u);
  EXPECT_EQ(source->header().fields[3].name, "time");
  EXPECT_EQ(batch.fields[3].get<double>(1), 1000000000.5);
  EXPECT_EQ(source->header().fields[4].type, ScalarType::kUint8);
  EXPECT_EQ(source->header().fields[5].name, "ground");
  EXPECT_EQ(batch.fields[5].get<int>(0), 1);
  // An attribute of that name is replaced.
  write_labelled_copy(folder.path() / "in.ply", {}, "patch", {-1, 70000},
                      folder.path() / "out.pcd");
  EXPECT_EQ(read_cloud(folder.path() / "out.pcd").labels.at("patch"),
            std::vector<int>({-1, 70000}));
  for (const std::vector<int>& wrong : {std::vector<int>{1}, std::vector<int>{1, 2, 3}}) {
    EXPECT_THROW(write_labelled_copy(folder.path() / "in.ply", {}, "ground", wrong,
                                     folder.path() / "none.ply"),
                 std::invalid_argument);
  }
  EXPECT_FALSE(fs::exists(folder.path() / "none.ply"));
}

TEST(TypedSource, ColumnsOfWholeNumbersBecomeIntegers) {
  const test::TemporaryFolder folder;
  std::string text = "x,y,z,class,mixed,huge\n";
  for (int i = 0; i < 3000; ++i) text += "1,2,3,5,4,3000000000\n";
  text += "1,2,3,6,4.5,1\n";
  std::ofstream(folder.path() / "in.csv") << text;
  const auto source = open_typed_source(folder.path() / "in.csv");
  const auto& fields = source->header().fields;
  EXPECT_EQ(fields[0].type, ScalarType::kFloat64);
  EXPECT_EQ(fields[3].type, ScalarType::kInt32);
  EXPECT_EQ(fields[4].type, ScalarType::kFloat64);
  EXPECT_EQ(fields[5].type, ScalarType::kFloat64);
  EXPECT_EQ(write_points(*source, folder.path() / "out.ply"), 3001u);
  const RoadCloud cloud = read_cloud(folder.path() / "out.ply");
  EXPECT_EQ(cloud.labels.at("class").back(), 6);
  EXPECT_EQ(cloud.scalars.at("mixed").back(), 4.5f);
  EXPECT_EQ(cloud.scalars.at("huge")[0], 3e9f);
}

/// The colours of the points of a LAS file without extra bytes.
std::vector<std::array<int, 3>> las_colors(const fs::path& path) {
  std::vector<std::array<int, 3>> out;
  const auto source = open_point_source(path);
  const auto& fields = source->header().fields;
  const FieldRoles roles = find_roles(fields);
  PointBatch batch;
  while (source->next(batch)) {
    for (std::size_t i = 0; i < batch.count; ++i) {
      std::array<int, 3> color{};
      for (std::size_t c = 0; c < 3; ++c) {
        const auto f = static_cast<std::size_t>(roles.color[c]);
        color[c] = static_cast<int>(batch.fields[f].number(fields[f].type, i));
      }
      out.push_back(color);
    }
  }
  return out;
}

TEST(TypedSource, ColorsOfLasFillSixteenBitsAllAlike) {
  const test::TemporaryFolder folder;
  const fs::path las = folder.path() / "out.las";
  const auto converted = [&](const char* name, const std::string& text) {
    std::ofstream(folder.path() / name) << text;
    write_points(*open_typed_source(folder.path() / name), las);
    return las_colors(las);
  };
  using Colors = std::vector<std::array<int, 3>>;
  const std::string names = "x,y,z,red,green,blue\n";
  // 8 bits as whole numbers.
  EXPECT_EQ(converted("a.csv", names + "1,2,3,255,128,0\n1,2,3,1,0,200\n"),
            (Colors{{65535, 32896, 0}, {257, 0, 51400}}));
  // The same as fractions: what is at most one is no full white.
  EXPECT_EQ(converted("b.csv", names + "1,2,3,255.0,128.0,0.5\n1,2,3,1.0,0.0,200.0\n"),
            (Colors{{65535, 32896, 129}, {257, 0, 51400}}));
  // Of one, and 16 bits: as they are.
  EXPECT_EQ(converted("c.csv", names + "1,2,3,1.0,0.5,0\n1,2,3,0.25,0,0\n"),
            (Colors{{65535, 32768, 0}, {16384, 0, 0}}));
  EXPECT_EQ(converted("d.csv", names + "1,2,3,1,2,256\n1,2,3,1,0,65535\n"),
            (Colors{{1, 2, 256}, {1, 0, 65535}}));
  const std::string ply =
      "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty "
      "float z\nproperty {0} red\nproperty {0} green\nproperty {0} blue\nend_header\n1 2 3 1 0 "
      "200\n1 2 3 255 255 1\n";
  for (const char* const type : {"uchar", "int", "float", "double"}) {
    EXPECT_EQ(converted("e.ply", std::regex_replace(ply, std::regex("\\{0\\}"), type)),
              (Colors{{257, 0, 51400}, {65535, 65535, 257}}))
        << type;
  }
  EXPECT_EQ(converted("f.ply", std::regex_replace(ply, std::regex("\\{0\\}"), "ushort")),
            (Colors{{1, 0, 200}, {255, 255, 1}}));
  // The greatest value may come late.
  std::string late = names;
  for (int i = 0; i < 20000; ++i) late += "1,2,3,0.5,1,0\n";
  const Colors colors = converted("g.csv", late + "1,2,3,0.5,1,255\n");
  EXPECT_EQ(colors.front(), (std::array<int, 3>{129, 257, 0}));
  EXPECT_EQ(colors.back(), (std::array<int, 3>{129, 257, 65535}));
}

TEST(TypedSource, ColorsOfPlyAndPcdAreBytes) {
  const test::TemporaryFolder folder;
  using Colors = std::vector<std::array<std::uint8_t, 3>>;
  std::vector<std::string> notes;
  const auto converted = [&](const fs::path& input, const std::string& output) {
    const fs::path path = folder.path() / output;
    write_points(*open_typed_source(input, {}, format_from_extension(path)), path, {}, {}, &notes);
    const std::vector<PointField> fields = open_point_source(path)->header().fields;
    const FieldRoles roles = find_roles(fields);
    if (output == "a.ply") {
      for (const int field : roles.color) {
        EXPECT_EQ(fields.at(static_cast<std::size_t>(field)).type, ScalarType::kUint8);
      }
    } else {
      EXPECT_EQ(fields.at(static_cast<std::size_t>(roles.packed_color)).name, "rgb");
    }
    return read_cloud(path).colors;
  };
  const fs::path csv = folder.path() / "in.csv", las = folder.path() / "in.las";
  for (const char* const output : {"a.ply", "a.pcd"}) {
    // The first points are dark; those of the whole file decide.
    std::string text = "x,y,z,red,green,blue\n";
    for (int i = 0; i < 20000; ++i) text += "1,2,3,255,128,0\n";
    std::ofstream(csv) << text << "1,2,3,1,256,65535\n";
    write_points(*open_typed_source(csv), las);
    EXPECT_EQ(las_colors(las).back(), (std::array<int, 3>{1, 256, 65535}));
    for (const fs::path& input : {csv, las}) {
      const Colors colors = converted(input, output);
      EXPECT_EQ(colors.front(), (std::array<std::uint8_t, 3>{0, 0, 0}));
      EXPECT_EQ(colors.back(), (std::array<std::uint8_t, 3>{0, 1, 255}));
      EXPECT_EQ(colors, read_cloud(input).colors);
      ASSERT_FALSE(notes.empty());
      EXPECT_THAT(notes[0], ::testing::HasSubstr("8 bits"));
      // Some points of the file, taken into memory.
      const auto dark =
          select_points(open_typed_source(input, {}, CloudFormat::kPly),
                        [&, i = 0](const Eigen::Vector3d&) mutable { return i++ < 100; });
      EXPECT_EQ(collect(*dark).colors, Colors(100, {0, 0, 0}));
    }
    // Bytes that fill 16 bits, and bytes in 16 bits, are what they were.
    const std::string ply =
        "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty "
        "float z\nproperty TYPE red\nproperty TYPE green\nproperty TYPE blue\nend_header\n1 2 3 1 "
        "0 200\n4 5 6 255 128 7\n";
    for (const char* const type : {"uchar", "ushort", "int", "float"}) {
      const fs::path input = folder.path() / "in.ply";
      std::ofstream(input) << std::regex_replace(ply, std::regex("TYPE"), type);
      write_points(*open_typed_source(input), las);
      for (const fs::path& each : {input, las}) {
        EXPECT_EQ(converted(each, output), (Colors{{1, 0, 200}, {255, 128, 7}})) << type;
        for (const std::string& note : notes) {
          EXPECT_THAT(note, ::testing::Not(::testing::HasSubstr("8 bits")));
        }
      }
    }
    // Fractions.
    std::ofstream(csv) << "x,y,z,r,g,b\n1,2,3,0.3,1.0,0\n4,5,6,0.0,0.5,0.1\n";
    EXPECT_EQ(converted(csv, output), read_cloud(csv).colors);
    EXPECT_EQ(read_cloud(csv).colors[1], (std::array<std::uint8_t, 3>{0, 128, 26}));
  }
}

TEST(TypedSource, DegreesInLasAreOnAGridOfATenthOfAMillimetre) {
  const test::TemporaryFolder folder;
  const fs::path csv = folder.path() / "in.csv", las = folder.path() / "out.las";
  std::vector<std::string> notes;
  std::vector<Eigen::Vector3d> points;
  const auto convert = [&](const std::string& names, const ReadOptions& options = {}) {
    std::ofstream text(csv);
    text.precision(15);
    text << names << '\n';
    for (const Eigen::Vector3d& p : points) {
      text << p.x() << ',' << p.y() << ',' << p.z() << '\n';
    }
    text.close();
    write_points(*open_typed_source(csv, options, CloudFormat::kLas), las, {}, {}, &notes);
    const auto source = open_point_source(las);
    PointBatch batch;
    EXPECT_TRUE(source->next(batch));
    Eigen::Vector3d worst = Eigen::Vector3d::Zero();
    for (std::size_t i = 0; i < batch.count; ++i) {
      for (std::size_t axis = 0; axis < 3; ++axis) {
        const auto a = static_cast<Eigen::Index>(axis);
        const double value = batch.fields[axis].get<double>(i);
        worst[a] = std::max(worst[a], std::abs(value - points[i][a]));
      }
    }
    return worst;
  };
  const std::string degrees = "longitude,latitude,altitude";
  points = {{8.1234567891, 48.7654321987, 300.12345}, {8.1244567892, 48.7664321986, 301.98765}};
  Eigen::Vector3d worst = convert(degrees);
  EXPECT_LT(worst.head<2>().maxCoeff(), 0.51e-9);  // half of a step
  EXPECT_LT(worst.z(), 0.51e-4);
  EXPECT_THAT(notes, testing::IsEmpty());
  // A state: the steps are wider, and still below a millimetre.
  points.push_back({13.5, 54.25, -3.0});
  EXPECT_LT(convert(degrees).head<2>().maxCoeff(), 1.01e-9);
  EXPECT_THAT(notes, testing::IsEmpty());
  // The earth.
  points = {{-179.5, -89.5, 0.0}, {179.9876543, 89.9876543, 8000.0}};
  EXPECT_LT(convert(degrees).head<2>().maxCoeff(), 0.51e-7);
  EXPECT_THAT(notes, testing::ElementsAre(testing::HasSubstr("(0.0111 m on the ground)")));
  // Lengths keep their grid; what may be degrees is said.
  points = {{8.1234567891, 48.7654321987, 300.12345}, {8.1244567892, 48.7664321986, 301.98765}};
  EXPECT_LT(convert("x,y,z").maxCoeff(), 0.51e-4);
  EXPECT_THAT(notes, testing::ElementsAre(testing::HasSubstr("whose unit is not known")));
  ReadOptions options;
  options.crs = coordinate_system_from_epsg(4326);
  EXPECT_LT(convert("x,y,z", options).head<2>().maxCoeff(), 0.51e-9);
  points.push_back({20.0, 40.0, 0.0});
  EXPECT_LT(convert("x,y,z").maxCoeff(), 0.51e-4);
  EXPECT_THAT(notes, testing::IsEmpty());
}

TEST(TypedSource, CoordinatesThatFloatsHoldAreFloatsInPcd) {
  const test::TemporaryFolder folder;
  const fs::path csv = folder.path() / "in.csv", las = folder.path() / "in.las",
                 pcd = folder.path() / "out.pcd";
  const auto converted = [&](const fs::path& input) {
    std::vector<std::string> notes;
    write_points(*open_typed_source(input, {}, CloudFormat::kPcd), pcd, {}, {}, &notes);
    const auto source = open_point_source(pcd);
    const ScalarType type = source->header().fields.at(0).type;
    EXPECT_EQ(source->header().fields.at(2).type, type);
    PointBatch batch;
    Eigen::Vector3d last = Eigen::Vector3d::Zero();
    while (source->next(batch)) {
      for (std::size_t axis = 0; axis < 3; ++axis) {
        last[static_cast<Eigen::Index>(axis)] = batch.fields[axis].number(type, batch.count - 1);
      }
    }
    const bool exact = last == last.array().round().matrix();
    if (type == ScalarType::kFloat32 && exact) {
      EXPECT_THAT(notes, testing::IsEmpty());
    } else {
      EXPECT_THAT(notes, testing::ElementsAre(testing::HasSubstr(
                             type == ScalarType::kFloat32 ? "rounded by up to" : "8-byte floats")));
    }
    return std::pair(type, last);
  };
  std::string text = "x,y,z\n";
  for (int i = 0; i < 20000; ++i) text += "1,2,3\n";
  // A point that decides may come late.
  for (const double far : {8191.999, 8192.0, -200000.123}) {
    const Eigen::Vector3d p(far, 0.1234, -56.789);
    std::ofstream(csv) << text << std::to_string(far) << ",0.1234,-56.789\n";
    write_points(*open_typed_source(csv), las);
    for (const fs::path& input : {csv, las}) {
      const auto [type, last] = converted(input);
      EXPECT_EQ(type, far < 8192.0 && far > 0.0 ? ScalarType::kFloat32 : ScalarType::kFloat64);
      EXPECT_LT((last - p).cwiseAbs().maxCoeff(), type == ScalarType::kFloat32 ? 2.5e-4 : 1e-6);
    }
  }
  // Points that are not finite, or that lenient reading leaves out, do not count.
  std::ofstream(csv) << "x,y,z\nnan,2,3\n4,5,6\n";
  EXPECT_EQ(converted(csv).first, ScalarType::kFloat32);
  std::ofstream(csv) << "x,y,z\n2e9,2,3\n4,5,6\n";
  EXPECT_EQ(converted(csv).first, ScalarType::kFloat64);
  ReadOptions lenient;
  lenient.lenient = true;
  const auto typed = open_typed_source(csv, lenient, CloudFormat::kPcd);
  EXPECT_EQ(typed->header().bounds->max(), Eigen::Vector3d(4, 5, 6));
  // Degrees are small numbers with many digits; 8192 feet are nearer than 8192 m.
  std::ofstream(csv) << "longitude,latitude,z\n8.6821234,49.1234567,100\n";
  EXPECT_EQ(converted(csv).first, ScalarType::kFloat64);
  std::ofstream(csv) << "x_ft,y_ft,z_ft\n20000,2,3\n";
  EXPECT_EQ(converted(csv).first, ScalarType::kFloat32);
  std::ofstream(csv) << "x_ft,y_ft,z_ft\n30000,2,3\n";
  EXPECT_EQ(converted(csv).first, ScalarType::kFloat64);
}

/// Points that no memory holds, made as they are asked for.
class Endless : public PointSource {
 public:
  explicit Endless(std::uint64_t count) : left_(count) {
    for (const char* const name : {"x", "y", "z", "intensity"}) {
      PointField field;
      field.name = name;
      header_.fields.push_back(field);
    }
    header_.count = count;
    values_.resize(4 * kBatchSize);
  }
  bool next(PointBatch& batch) override {
    batch.count = static_cast<std::size_t>(std::min<std::uint64_t>(left_, kBatchSize));
    batch.fields.clear();
    for (std::size_t i = 0; i < batch.count; ++i) {
      const std::uint64_t n = left_ - i;
      values_[4 * i] = static_cast<float>(n % 1000);
      values_[4 * i + 1] = static_cast<float>(n / 1000 % 100);
      values_[4 * i + 2] = static_cast<float>(n % 7);
      values_[4 * i + 3] = 0.5f;
    }
    for (std::size_t f = 0; f < 4; ++f) {
      batch.fields.push_back({reinterpret_cast<const unsigned char*>(values_.data() + f), 16});
    }
    left_ -= batch.count;
    return batch.count > 0;
  }

 private:
  std::uint64_t left_;
  std::vector<float> values_;
};

/// What a PCD's header has behind a key.
std::string pcd_header(const fs::path& file, const std::string& key) {
  std::ifstream in(file);
  for (std::string line; std::getline(in, line);) {
    if (line.rfind(key + " ", 0) == 0) return line.substr(key.size() + 1);
  }
  return "none";
}

TEST(Streams, RowsAndViewpointOfAPcdAreKeptWhereNoPointIsLeftOut) {
  const test::TemporaryFolder folder;
  const fs::path in = folder.path() / "in.pcd";
  std::ofstream(in) << "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 3\n"
                       "HEIGHT 2\nVIEWPOINT 1 2 1.5 0 1 0 0\nPOINTS 6\nDATA ascii\n"
                       "0 0 1\n1 0 1\nnan nan nan\n0 1 1\n1 1 1\n2 1 1\n";
  const fs::path out = folder.path() / "out.pcd";
  for (const CloudEncoding encoding :
       {CloudEncoding::kAscii, CloudEncoding::kBinary, CloudEncoding::kCompressed}) {
    WriteOptions options;
    options.encoding = encoding;
    std::vector<std::string> notes;
    write_points(*open_point_source(in), out, options, {}, &notes);
    EXPECT_TRUE(notes.empty());
    EXPECT_EQ(pcd_header(out, "WIDTH"), "3");
    EXPECT_EQ(pcd_header(out, "HEIGHT"), "2");
    EXPECT_EQ(pcd_header(out, "VIEWPOINT"), "1 2 1.5 0 1 0 0");
    const CloudFile file = read_cloud_file(out);
    EXPECT_EQ(file.report.width, 3u);
    EXPECT_EQ(file.cloud.points[5], Eigen::Vector3f(2, 1, 1));
    // A selection does not know beforehand whether it leaves something out.
    for (const bool all : {true, false}) {
      write_points(*select_points(open_point_source(in),
                                  [all](const Eigen::Vector3d& x) { return all || x.x() < 2.0; }),
                   out, options, {}, &notes);
      EXPECT_EQ(pcd_header(out, "HEIGHT"), all ? "2" : "1");
      EXPECT_EQ(pcd_header(out, "VIEWPOINT"), "1 2 1.5 0 1 0 0");
      EXPECT_EQ(notes.size(), all ? 0u : 1u);
      EXPECT_EQ(read_cloud(out).size(), all ? 6u : 4u);
    }
  }
  std::vector<int> values(6, 4);
  write_labelled_copy(in, {}, "ground", values, out);
  EXPECT_EQ(pcd_header(out, "HEIGHT"), "2");
}

TEST(Streams, AViewpointThatIsNoneIsPassedOver) {
  const std::string head = "FIELDS x y\nSIZE 4 4\nTYPE F F\nCOUNT 1 1\nWIDTH 1\nHEIGHT 1\n";
  const std::string tail = "POINTS 1\nDATA ascii\n1 2\n";
  for (const std::string viewpoint : {"1 2 3", "1 2 3 4 5 6 nan", "a b c d e f g"}) {
    const CloudFile file =
        test::read_from_memory(head + "VIEWPOINT " + viewpoint + "\n" + tail, "a.pcd");
    EXPECT_EQ(file.cloud.size(), 1u);
    EXPECT_THAT(file.report.notes, ::testing::Contains(::testing::HasSubstr("VIEWPOINT")));
  }
}

TEST(Streams, ConvertAndThinInConstantMemory) {
  const test::TemporaryFolder folder;
  constexpr std::uint64_t kCount = 3000000;  // 48 MB
  test::MemoryMeter meter;
  {
    Endless source(kCount);
    EXPECT_EQ(write_points(source, folder.path() / "a.ply"), kCount);
  }
  for (const char* const name : {"b.pcd", "c.las", "d.bin", "e.xyz"}) {
    const auto source = open_point_source(folder.path() / "a.ply");
    EXPECT_EQ(write_points(*source, folder.path() / name), kCount);
  }
  EXPECT_LT(meter.peak(), 8u << 20);
  for (const char* const name : {"b.pcd", "c.las", "d.bin", "e.xyz"}) {
    const auto source = open_point_source(folder.path() / name);
    VoxelGrid grid(source->header(), 10.0);
    PointBatch batch;
    while (source->next(batch)) grid.add(batch);
    const auto thinned = grid.points();
    EXPECT_EQ(*thinned->header().count, 1000u) << name;
  }
  EXPECT_LT(meter.peak(), 12u << 20);
}

}  // namespace
}  // namespace camber
