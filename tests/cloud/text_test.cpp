#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "cloud/cloud_files.h"
#include "cloud/memory_meter.h"

namespace camber {
namespace {

using test::read_error;
using test::read_from_memory;
using ::testing::HasSubstr;

std::vector<Eigen::Vector3f> points(const std::string& text, const ReadOptions& options = {}) {
  return read_from_memory(text, "a.txt", options).cloud.points;
}

TEST(Text, SeparatorsAndLineEnds) {
  const std::vector<Eigen::Vector3f> expected = {{1, 2, 3}, {4.5f, 5, -6}};
  for (const char* const text :
       {"1 2 3\n4.5 5 -6\n", "1,2,3\r\n4.5,5,-6", "1;2;3\n4.5;5;-6\n", "1\t2\t3\n\n  4.5\t5 -6  \n",
        "1, 2 ,3\n4.5 , 5,-6\n",
        "\xef\xbb\xbf"
        "1 2 3\n4.5 5 -6\n",
        "# remark\n1 2 3\n// more\n4.5 5 -6\n", "2\n1 2 3\n4.5 5 -6\n", "x y z\n1 2 3\n4.5 5 -6\n",
        "X;Y;Z\n1;2;3\n4.5;5;-6\n", "\"x\",\"y\",\"z\"\n1,2,3\n4.5,5,-6\n",
        "# x y z\n1 2 3\n4.5 5 -6\n", "//X Y Z\n1 2 3\n4.5 5 -6\n", "z y x\n3 2 1\n-6 5 4.5\n"}) {
    EXPECT_EQ(points(text), expected) << text;
  }
}

TEST(Text, ColumnsByNameByOptionAndByNumber) {
  ReadOptions options;
  options.columns = {"x", "_", "y", "z", "intensity"};
  RoadCloud cloud = read_from_memory("1 word 2 3 0.5\n4 9 5 6 1\n", "points.pcd",
                                     [&] {
                                       ReadOptions o = options;
                                       o.format = CloudFormat::kText;
                                       return o;
                                     }())
                        .cloud;
  EXPECT_EQ(cloud.points[1], Eigen::Vector3f(4, 5, 6));
  EXPECT_EQ(cloud.scalars.at("intensity"), std::vector<float>({0.5f, 1.0f}));
  cloud = read_from_memory("1 2 3 7 8.5\n", "a.xyz").cloud;
  EXPECT_EQ(cloud.labels.at("column_4"), std::vector<int>({7}));
  EXPECT_EQ(cloud.scalars.at("column_5"), std::vector<float>({8.5f}));
  cloud = read_from_memory(
              "x,y,z,red,green,blue,nx,ny,nz,sigma,patch\n1,2,3,10,20,30,0,0,1,0.5,-1\n", "a.csv")
              .cloud;
  EXPECT_EQ(cloud.colors[0], (std::array<std::uint8_t, 3>{10, 20, 30}));
  EXPECT_EQ(cloud.normals[0], Eigen::Vector3f(0, 0, 1));
  EXPECT_EQ(cloud.sigmas[0], 0.5f);
  EXPECT_EQ(cloud.labels.at("patch"), std::vector<int>({-1}));
}

TEST(Text, ColumnsInMetresAreAxes) {
  const RoadCloud cloud =
      read_from_memory("chainage_m,x_m,y_m,z_m\n0.0,1,2,3\n1.0,4,5,6.5\n", "line.csv").cloud;
  ASSERT_EQ(cloud.size(), 2u);
  EXPECT_EQ(cloud.points[1], Eigen::Vector3f(4, 5, 6.5f));
  EXPECT_EQ(cloud.scalars.count("chainage_m") + cloud.labels.count("chainage_m"), 1u);
  // x wins over x_m.
  const RoadCloud both = read_from_memory("x_m,x,y,z\n9,1,2,3\n", "line.csv").cloud;
  EXPECT_EQ(both.points[0], Eigen::Vector3f(1, 2, 3));
  EXPECT_EQ(read_from_memory("x_m y_m z_m\n1 2 3\n", "line.txt").cloud.points[0],
            Eigen::Vector3f(1, 2, 3));
}

TEST(Text, NamesOfSurveyorsAndTheirUnits) {
  const struct {
    const char* text;
    double x, y, z;
    bool metric;
  } cases[] = {
      {"Point,Easting,Northing,Elevation,Code\n7,1,2,3,TREE\n", 1, 2, 3, true},
      {"No,UTM-Ch,UTM-East,UTM-North,Name,Altitude,Date\n1,R,1,2,\"a, b\",3,2008/08/23\n", 1, 2, 3,
       true},
      {"# exported 2021\n# x [m]\ty [m]\tz [m]\tintensity\n1\t2\t3\t9\n", 1, 2, 3, true},
      {"# x [m] y [m] z [m]\n1 2 3\n", 1, 2, 3, true},
      {"N;E;H\n2;1;3\n", 1, 2, 3, true},
      {"x_ft y_ft z_ft\n1 2 3\n", 1, 2, 3, false},
      {"northing (usft),easting (usft),elev (m)\n2,1,3\n", 1, 2, 3, false},
      {"# a b LONGITUDE_CENTROID LATITUDE_CENTROID ELEVATION_CENTROID\n8 9 1 2 3\n", 1, 2, 3,
       false},
      {"lat,lon,alt\n2,1,3\n", 1, 2, 3, false},
      {"x,y,height,easting\n1,2,3,9\n", 1, 2, 3, true},
      {"\"X\",\"Y\",\"Z\"\n\"1\",\"2\",\"3\"\n", 1, 2, 3, true},
  };
  for (const auto& c : cases) {
    const CloudFile file = read_from_memory(c.text, "a.csv");
    ASSERT_EQ(file.cloud.size(), 1u) << c.text;
    EXPECT_EQ(file.cloud.origin + file.cloud.points[0].cast<double>(),
              Eigen::Vector3d(c.x, c.y, c.z))
        << c.text;
    EXPECT_EQ(file.cloud.metric, c.metric) << c.text;
  }
  const CloudFile feet = read_from_memory("x_ft,y_ft,z_m\n1,2,3\n", "a.csv");
  EXPECT_DOUBLE_EQ(feet.report.crs->horizontal.metres, 0.3048);
  EXPECT_EQ(feet.report.crs->vertical.name, "metre");
  EXPECT_EQ(read_from_memory("# in EPSG:26917\n1 2 3\n", "a.xyz").report.crs.has_value(), true);
  // A word where the first row had a number stays an error.
  EXPECT_THAT(read_error("x,y,z,code\n1,2,3,4\n5,6,7,TREE\n", "a.csv"),
              HasSubstr("line 3: found 'TREE'"));
  EXPECT_THAT(read_error("x,y,z\n1,two,3\n", "a.csv"), HasSubstr("line 2: found 'two,3'"));
}

TEST(Text, DecimalCommas) {
  const std::vector<Eigen::Vector3f> expected = {{1.5f, -2.25f, 3}, {4, 5.5f, 60}};
  for (const char* const text :
       {"X;Y;Z\n1,5;-2,25;3\n4;5,5;6e1\n", "1,5 -2,25 3,0\n4,0 5,5 6,0e1\n",
        "x\ty\tz\n1,5\t-2,25\t3,0\n4,0\t5,5\t6,0e1\n", "1,5; -2,25 ;3\r\n4;5,5;60\r\n"}) {
    EXPECT_EQ(points(text), expected) << text;
  }
  // Commas between numbers stay separators.
  EXPECT_EQ(points("1,2,3\n"), (std::vector<Eigen::Vector3f>{{1, 2, 3}}));
  EXPECT_EQ(points("1, 2, 3\n"), (std::vector<Eigen::Vector3f>{{1, 2, 3}}));
}

TEST(Text, LayoutAndNamesThatAreNotUtf8) {
  const CloudFile file = read_from_memory("X;Y;Z;Intensit\xe4t\r\n1;2;3;4\r\n", "a.csv");
  const TextLayout& layout = *file.report.text;
  EXPECT_EQ(layout.header, (std::vector<std::string>{"X;Y;Z;Intensit\xc3\xa4t"}));
  EXPECT_EQ(layout.line_ends, "CR LF");
  EXPECT_EQ(layout.separator, "semicolon");
  EXPECT_EQ(layout.columns, 4u);
  EXPECT_EQ(file.cloud.labels.count("Intensit\xc3\xa4t"), 1u);
}

CloudFile read_ptx(const std::string& text, bool lenient = false) {
  ReadOptions options;
  options.lenient = lenient;
  return read_from_memory(text, "a.ptx", options);
}

TEST(Ptx, ScansWithTheirPoses) {
  const std::string scan =
      "2\n2\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n0 1 0 0\n-1 0 0 0\n0 0 1 0\n100 200 300 1\n";
  const std::string rows = "1 2 3 0.5\n0 0 0 0.5\n4 5 6 0.25\n7 8 9 1\n";
  const CloudFile file = read_ptx(scan + rows + scan + rows);
  ASSERT_EQ(file.cloud.size(), 6u);  // a place without a return a scan
  // (x y z 1) M: the x axis goes to y, y to -x, then the scanner's place.
  const Eigen::Vector3d first = file.cloud.origin + file.cloud.points[0].cast<double>();
  EXPECT_TRUE(first.isApprox(Eigen::Vector3d(98, 201, 303)));
  EXPECT_EQ(file.cloud.scalars.at("intensity")[1], 0.25f);
  EXPECT_EQ(file.report.scans.size(), 2u);
  EXPECT_THAT(file.report.notes.back(), HasSubstr("2 places of the scan without a return"));
  // An empty scan before one with colours.
  const std::string empty =
      "0\n0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n";
  const CloudFile colors = read_ptx(
      empty +
      "1\n1\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n1 2 3 0.5 9 8 7\n");
  EXPECT_EQ(colors.cloud.colors.at(0), (std::array<std::uint8_t, 3>{9, 8, 7}));
}

TEST(Ptx, DamagedFilesAreErrorsAtALine) {
  const std::string head = "2\n1\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n";
  const struct {
    std::string text;
    const char* message;
  } cases[] = {
      {"two\n", "line 1: found 'two', expected the number of a scan's columns"},
      {"2\n", "expected the number of a scan's rows"},
      {"99999999\n99999999\n" + head.substr(4) + "1 2 3 4\n", "more than the file has room for"},
      {"2\n1\n0 0\n", "line 3: found 2 values, expected 3 of the scanner's pose"},
      {head + "1 2 3 4\n", "expected 1 more points of the scan"},
      {head + "1 2\n", "line 11: found 2 values, expected x y z"},
      {head + "1 2 3 4\n1 2 3\n", "line 12: found 3 values, expected 4"},
      {head + "1 2 3 4 300 0 0\n", "line 11: found '300', expected a number in the range"},
  };
  for (const auto& c : cases) {
    EXPECT_THAT(read_error(c.text, "a.ptx"), HasSubstr(c.message)) << c.text;
  }
  EXPECT_EQ(read_ptx(head + "1 2 3 4\n", true).cloud.size(), 1u);
  EXPECT_TRUE(read_ptx("").cloud.empty());
}

TEST(Text, MissingValuesAreNaN) {
  const CloudFile file = read_from_memory("x,y,z,i\n1,2,3,\n4,,6,7\n,,,\n", "a.csv");
  ASSERT_EQ(file.cloud.size(), 3u);
  EXPECT_EQ(file.report.non_finite, 2u);
  EXPECT_EQ(file.report.non_finite_attributes, 1u);
  EXPECT_EQ(file.cloud.scalars.at("i")[1], 7.0f);
}

TEST(Text, AFractionLateInAColumnMakesItAScalar) {
  std::string text = "x y z v w\n";
  for (int i = 0; i < 5000; ++i) text += "1 2 3 4 5\n";
  text += "1 2 3 4.0 5\n";
  const RoadCloud cloud = read_from_memory(text, "a.txt").cloud;
  EXPECT_EQ(cloud.scalars.at("v").size(), 5001u);
  EXPECT_EQ(cloud.labels.at("w").size(), 5001u);
}

TEST(Text, BadFilesAreErrorsAtALine) {
  const struct {
    const char* text;
    const char* message;
  } cases[] = {
      {"1 2 3\n4 5\n", "a.txt: line 2: found 2 values, expected 3"},
      {"1 2 3\n4 5 6 7\n", "line 2: found more than 3 values, expected 3"},
      {"1 2 3\n\n4 five 6\n", "line 3: found 'five', expected a number"},
      {"1,2,3\n4,5,6,\n", "line 2: found more than 3 values"},
      {"X,Y,X\n1,2,3\n", "line 1: found column 'X' twice"},
      {"a b c\n1 2 3\n", "line 1: found 'a b c', expected numbers or the names"},
      {"a,b,c\n1,2,3\n", "line 1: found no field 'x'"},
      {"3\n1 2 3\n4 5 6\n", "found 2 points, expected the 3 of the first line"},
      {"1.5\n1 2 3\n", "line 1: found one value, expected at least x and y"},
      {"99999999999999999999 \n", "line 1: found one value"},
      {"12345678901\n1 2 3\n", "expected no more than the file has room for"},
  };
  for (const auto& c : cases) {
    test::MemoryMeter meter;
    EXPECT_THAT(read_error(c.text, "a.txt"), HasSubstr(c.message)) << c.text;
    EXPECT_LT(meter.peak(), 300000u);
  }
  EXPECT_THAT(read_error(std::string("1 2 \0 3\n", 8), "a.txt"), HasSubstr("found binary data"));
  ReadOptions lenient;
  lenient.lenient = true;
  const CloudFile file = read_from_memory("1 2 3\n4 5\n7 8 9\n", "a.txt", lenient);
  EXPECT_EQ(file.cloud.size(), 2u);
  EXPECT_EQ(file.report.dropped[0], std::make_pair(std::string("bad line"), std::uint64_t{1}));
}

TEST(Text, EmptyFilesAreEmptyClouds) {
  for (const char* const text : {"", "\n\n", "# nothing\n", "x,y,z\n"}) {
    EXPECT_TRUE(points(text).empty()) << text;
  }
}

}  // namespace
}  // namespace camber
