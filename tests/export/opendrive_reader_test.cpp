// Roads of OpenDRIVE files: against hand-computed places, libOpenDRIVE, and what others write.

#include "camber/export/opendrive_reader.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "camber/core/errors.h"
#include "support/test_data.h"

namespace camber {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using ::testing::HasSubstr;

std::vector<fs::path> files_of_others() {
  std::vector<fs::path> out;
  for (const char* name : {"SShapeSuperelevatedRoad", "crest-curve", "rtron_basic_sample_01",
                           "straight_road_default"}) {
    out.push_back(test::data_dir() / "format-files/opendrive" / (std::string(name) + ".xodr"));
  }
  return out;
}

XodrFile parsed(const std::string& road) {
  const test::TemporaryFolder folder;
  const fs::path file = folder.path() / "road.xodr";
  std::ofstream(file) << "<OpenDRIVE><header revMajor=\"1\" revMinor=\"7\">"
                         "<geoReference><![CDATA[+proj=utm +zone=32]]></geoReference></header>"
                      << road << "</OpenDRIVE>";
  return read_xodr(file);
}

/// A road with a lane of 3 m a side and this plan view, profile and lanes' extras.
std::string road_of(const std::string& plan, double length, const std::string& profiles = "",
                    const std::string& left = "", const std::string& level = "false") {
  return "<road id=\"7\" name=\"main\" length=\"" + std::to_string(length) + "\"><planView>" +
         plan + "</planView>" + profiles +
         "<lanes><laneOffset s=\"0\" a=\"0.5\" b=\"0\" c=\"0\" d=\"0\"/><laneSection s=\"0\"><left>"
         "<lane id=\"1\" type=\"driving\" level=\"" +
         level + "\"><width sOffset=\"0\" a=\"3\" b=\"0.01\" c=\"0\" d=\"0\"/>" + left +
         "</lane></left><right><lane id=\"-1\" type=\"driving\">"
         "<width sOffset=\"0\" a=\"3\" b=\"0\" c=\"0\" "
         "d=\"0\"/></lane></right></laneSection></lanes>"
         "</road>";
}

const char* const kLine =
    "<geometry s=\"0\" x=\"10\" y=\"20\" hdg=\"0\" length=\"100\"><line/></geometry>";

TEST(OpenDriveReader, AStraightRoadIsWhereItStands) {
  const XodrFile file = parsed(road_of(kLine, 100,
                                       "<elevationProfile><elevation s=\"0\" a=\"5\" b=\"0.1\" "
                                       "c=\"0\" d=\"0\"/></elevationProfile>"));
  EXPECT_EQ(file.geo_reference, "+proj=utm +zone=32");
  const XodrSurface road(file.road("7"));
  EXPECT_DOUBLE_EQ(road.left(10.0), 3.0 + 0.01 * 10.0 + 0.5);
  EXPECT_DOUBLE_EQ(road.right(10.0), 2.5);
  const Eigen::Vector3d at = road.point(30.0, 2.0);
  EXPECT_NEAR(at.x(), 40.0, 1e-12);
  EXPECT_NEAR(at.y(), 22.0, 1e-12);
  EXPECT_NEAR(at.z(), 8.0, 1e-12);
}

TEST(OpenDriveReader, ArcsAndSpiralsTurn) {
  // A quarter of a circle of 50 m to the left.
  const double quarter = 0.5 * M_PI * 50.0;
  const XodrFile arc =
      parsed(road_of("<geometry s=\"0\" x=\"0\" y=\"0\" hdg=\"0\" length=\"" +
                         std::to_string(quarter) + "\"><arc curvature=\"0.02\"/></geometry>",
                     quarter));
  const XodrSurface round(arc.roads[0]);
  EXPECT_NEAR((round.position(quarter) - Eigen::Vector2d(50, 50)).norm(), 0.0, 1e-9);
  EXPECT_NEAR(round.heading(quarter), 0.5 * M_PI, 1e-12);
  EXPECT_NEAR(round.curvature(10.0), 0.02, 1e-12);
  // A clothoid from straight to 1/50 m over 50 m: the end by its series in the turned angle, 0.5.
  const XodrFile bend = parsed(
      road_of("<geometry s=\"0\" x=\"0\" y=\"0\" hdg=\"0\" length=\"50\"><spiral curvStart=\"0\" "
              "curvEnd=\"0.02\"/></geometry>",
              50));
  const XodrSurface spiral(bend.roads[0]);
  const double angle = 0.5;
  double x = 0.0, y = 0.0, term = 1.0;  // angle^n / n!
  for (int n = 0; n < 12; ++n) {
    const double part = term / (2 * n + 1) * (n % 4 < 2 ? 1.0 : -1.0);
    (n % 2 == 0 ? x : y) += 50.0 * part;
    term *= angle / (n + 1);
  }
  EXPECT_NEAR(spiral.position(50.0).x(), x, 1e-9);
  EXPECT_NEAR(spiral.position(50.0).y(), y, 1e-9);
  EXPECT_NEAR(spiral.heading(50.0), angle, 1e-12);
}

TEST(OpenDriveReader, CubicsGoByLengthOrShare) {
  const char* const plan =
      "<geometry s=\"0\" x=\"0\" y=\"0\" hdg=\"0\" length=\"10\"><paramPoly3 pRange=\"{}\" "
      "aU=\"0\" "
      "bU=\"{}\" cU=\"0\" dU=\"0\" aV=\"0\" bV=\"0\" cV=\"{}\" dV=\"0\"/></geometry>";
  const auto with = [&](const std::string& range, const std::string& b, const std::string& c) {
    std::string text = plan;
    for (const std::string& part : {range, b, c}) text.replace(text.find("{}"), 2, part);
    return parsed(road_of(text, 10));
  };
  const XodrFile share = with("normalized", "10", "1"), length = with("arcLength", "1", "0.01");
  EXPECT_NEAR((XodrSurface(share.roads[0]).position(5.0) - Eigen::Vector2d(5, 0.25)).norm(), 0,
              1e-12);
  EXPECT_NEAR((XodrSurface(length.roads[0]).position(5.0) - Eigen::Vector2d(5, 0.25)).norm(), 0,
              1e-12);
}

TEST(OpenDriveReader, ASuperelevatedRoadTilts) {
  const std::string tilt =
      "<lateralProfile><superelevation s=\"0\" a=\"0.1\" b=\"0\" c=\"0\" "
      "d=\"0\"/></lateralProfile>";
  const XodrFile tilted = parsed(road_of(kLine, 100, tilt));
  const Eigen::Vector3d at = XodrSurface(tilted.roads[0]).point(30.0, 2.0);
  EXPECT_NEAR(at.z(), 2.0 * std::sin(0.1), 1e-12);
  EXPECT_NEAR(at.y(), 20.0 + 2.0 * std::cos(0.1), 1e-12);
  // A lane that stays level: as high as at its inner edge.
  const XodrFile kept = parsed(road_of(kLine, 100, tilt, "", "true"));
  const XodrSurface level(kept.roads[0]);
  EXPECT_NEAR(level.point(30.0, 3.0).z(), level.point(30.0, 0.5).z(), 1e-9);
  // A kerb's height, along the tilted normal.
  const XodrFile raised =
      parsed(road_of(kLine, 100, tilt, "<height sOffset=\"0\" inner=\"0.2\" outer=\"0.2\"/>"));
  const double rise = XodrSurface(raised.roads[0]).point(30.0, 2.0).z() - at.z();
  EXPECT_NEAR(rise, 0.2 * std::cos(0.1), 1e-12);
}

TEST(OpenDriveReader, TheMeshPassesTheSurfaceByLessThanItsTolerance) {
  const XodrFile file =
      parsed(road_of("<geometry s=\"0\" x=\"0\" y=\"0\" hdg=\"0\" length=\"100\"><arc "
                     "curvature=\"0.02\"/></geometry>",
                     100,
                     "<elevationProfile><elevation s=\"0\" a=\"0\" b=\"0\" c=\"0.002\" d=\"0\"/>"
                     "</elevationProfile>"));
  const XodrMesh mesh = xodr_mesh(file.roads[0], 0.01);
  ASSERT_GT(mesh.triangles.size(), 20u);
  double area = 0.0, worst = 0.0;
  for (const auto& t : mesh.triangles) {
    const Eigen::Vector3d a = mesh.points[t[0]], b = mesh.points[t[1]], c = mesh.points[t[2]];
    const Eigen::Vector3d normal = (b - a).cross(c - a);
    EXPECT_GT(normal.z(), 0.0);
    area += 0.5 * normal.z();
    // On the circle of 50 m about (0, 50) the height is 0.002 s^2.
    const Eigen::Vector3d middle = (a + b + c) / 3.0;
    const double s = 50.0 * std::atan2(middle.x(), 50.0 - middle.y());
    if (s > 0.0) worst = std::max(worst, std::abs(middle.z() - 0.002 * s * s));
  }
  EXPECT_LT(worst, 0.02);
  // 2.5 m outside and 3.5 + 0.005 s^... inside: the exact area of the two rings' parts.
  double expected = 0.0;
  for (int i = 0; i < 10000; ++i) {
    const double s = (i + 0.5) * 0.01, left = 3.5 + 0.01 * s, right = 2.5;
    expected += 0.01 * ((left + right) - 0.02 * 0.5 * (left * left - right * right));
  }
  EXPECT_NEAR(area, expected, 0.002 * expected);
}

TEST(OpenDriveReader, BadFilesAreNamedWithTheirLine) {
  const auto reason = [](const std::string& road) {
    try {
      parsed(road);
    } catch (const InputError& error) {
      return std::string(error.what());
    }
    return std::string("read");
  };
  EXPECT_THAT(reason("<road id=\"1\" length=\"10\"/>"), HasSubstr("found no <geometry>"));
  EXPECT_THAT(reason("<road id=\"1\" length=\"-4\"/>"), HasSubstr("length: found -4"));
  EXPECT_THAT(reason(road_of("<geometry s=\"0\" x=\"0\" y=\"0\" hdg=\"0\" length=\"10\"/>", 10)),
              HasSubstr("found no line, arc"));
  EXPECT_THAT(
      reason(road_of(
          "<geometry s=\"0\" x=\"nan\" y=\"0\" hdg=\"0\" length=\"10\"><line/></geometry>", 10)),
      HasSubstr("line 1"));
  EXPECT_THAT(reason(""), HasSubstr("found no <road>"));
  try {
    parsed(road_of(kLine, 100)).road("8");
    FAIL();
  } catch (const std::invalid_argument& error) {
    EXPECT_THAT(error.what(), HasSubstr("expected one of 7"));
  }
}

TEST(OpenDriveReader, FilesOfOthersHoldWhatTheyHold) {
  const fs::path list = test::data_dir() / "format-files/opendrive/expected.json";
  if (!fs::exists(list)) GTEST_SKIP() << "no ../shared/data: format-files/opendrive";
  const json expected = json::parse(test::read_text(list));
  for (const fs::path& path : files_of_others()) {
    const json& want = expected.at(path.filename().string());
    const XodrFile file = read_xodr(path);
    EXPECT_EQ(std::to_string(file.major) + "." + std::to_string(file.minor), want.at("rev"));
    EXPECT_EQ(file.roads.size(), want.at("roads").get<std::size_t>());
    const XodrRoad& road = file.roads.front();
    EXPECT_NEAR(road.length, want.at("total_length").get<double>(), 1e-9);
    EXPECT_EQ(road.elevation.size(), want.at("elevation_records").get<std::size_t>());
    EXPECT_EQ(road.superelevation.size(), want.at("superelevation_records").get<std::size_t>());
    EXPECT_EQ(road.sections.size(), want.at("lane_sections").get<std::size_t>());
    EXPECT_EQ(road.lane_offset.size(), want.at("lane_offsets").get<std::size_t>());
    EXPECT_EQ(road.plan.front().x, want.at("first_geometry").at("x").get<double>());
  }
}

TEST(OpenDriveReader, LibOpenDriveHasTheSameHeights) {
#ifndef CAMBER_ODR_POINTS
  GTEST_SKIP() << "no ../shared/peers (set CAMBER_PEERS and configure again): libOpenDRIVE";
#else
  for (const fs::path& path : files_of_others()) {
    if (!fs::exists(path)) GTEST_SKIP() << "no ../shared/data: format-files/opendrive";
    const test::TemporaryFolder folder;
    const XodrFile file = read_xodr(path);
    const XodrRoad& road = file.roads.front();
    const XodrSurface surface(road);
    // Of a paramPoly3 without coefficients, as RoadRunner's file ends with, the library has no
    // direction.
    const bool bare = path.stem() == "straight_road_default";
    const double length_judged = bare ? road.plan[1].s : road.length;
    {
      std::ofstream places(folder.path() / "in");
      places.precision(17);
      for (int i = 0; i <= 200; ++i) {
        const double s = length_judged * (i + 0.003) / 200.01;
        const double right = surface.right(s), left = surface.left(s);
        for (int k = 1; k < 12; ++k)
          places << s << " " << -right + (left + right) * k / 12.01 << "\n";
      }
    }
    const std::string command = "cd '" + folder.path().string() + "' && '" CAMBER_ODR_POINTS "' '" +
                                fs::absolute(path).string() + "' < in > out 2> warnings";
    ASSERT_EQ(std::system(command.c_str()), 0) << path;
    std::ifstream places(folder.path() / "in"), points(folder.path() / "out");
    double length = 0.0, s = 0.0, t = 0.0, x = 0.0, y = 0.0, z = 0.0, height = 0.0, plan = 0.0;
    std::size_t objects = 0, count = 0;
    ASSERT_TRUE(points >> length >> objects);
    while (places >> s >> t && points >> x >> y >> z) {
      const Eigen::Vector3d at = surface.point(s, t);
      height = std::max(height, std::abs(at.z() - z));
      plan = std::max(plan, (at.head<2>() - Eigen::Vector2d(x, y)).norm());
      ++count;
    }
    EXPECT_EQ(count, 201u * 11u) << path;
    EXPECT_LT(height, 0.001) << path;
    EXPECT_LT(plan, 0.01) << path;
    RecordProperty(path.stem().string() + "_height_m", std::to_string(height));
  }
#endif
}

}  // namespace
}  // namespace camber
