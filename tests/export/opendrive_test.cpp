#include "camber/export/opendrive.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <pugixml.hpp>

#include "camber/core/errors.h"
#include "camber/export/crg_strip.h"
#include "support/test_data.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

/// A hilly road with a crown and changing banking along a winding line, 4 m wide to the left and 3
/// to the right.
Vector2d winding(double t) { return {t, 12.0 * std::sin(0.03 * t)}; }

class WindingGround : public HeightSource {
 public:
  GroundSample at(const Vector3d& place) const override {
    GroundSample sample;
    // Nearest point of the line by Newton's steps.
    double t = place.x();
    for (int i = 0; i < 20; ++i) {
      const Vector2d d = winding(t) - place.head<2>(), g(1.0, 0.36 * std::cos(0.03 * t));
      t -= d.dot(g) / (g.squaredNorm() + d.y() * -0.0108 * std::sin(0.03 * t));
    }
    const Vector2d g(1.0, 0.36 * std::cos(0.03 * t)), d = place.head<2>() - winding(t);
    const double v = (g.x() * d.y() - g.y() * d.x()) / g.norm();
    if (t < -1.0 || t > 151.0 || v > 4.0 || v < -3.0) return sample;
    sample.height =
        50.0 + 3.0 * std::sin(0.05 * t) + 0.05 * std::sin(0.04 * t) * v - 0.02 * std::abs(v);
    return sample;
  }
  double resolution() const override { return 0.0; }
};

std::vector<Vector3d> winding_line() {
  std::vector<Vector3d> line;
  for (double t = 0.0; t <= 150.0; t += 1.0) {
    line.emplace_back(winding(t).x(), winding(t).y(), 50.0 + 3.0 * std::sin(0.05 * t));
  }
  return line;
}

OpenDriveRoad winding_road(OpenDriveOptions options = {}) {
  return make_opendrive(WindingGround(), SmoothLine(winding_line(), 0.01), options);
}

TEST(OpenDrive, LineTangentAndElevationGoOn) {
  const OpenDriveRoad road = winding_road();
  EXPECT_LE(road.line_deviation, 0.005);
  ASSERT_GT(road.plan.size(), 2u);
  double s = 0.0;
  for (std::size_t i = 0; i < road.plan.size(); ++i) {
    const PlanPiece& piece = road.plan[i];
    EXPECT_NEAR(piece.s, s, 1e-9);
    s += piece.length;
    if (i + 1 == road.plan.size()) break;
    const PlanPiece& next = road.plan[i + 1];
    EXPECT_NEAR((piece.at(1.0) - Vector2d(next.x, next.y)).norm(), 0.0, 1e-9);
    const Vector2d ahead = piece.direction(1.0);
    EXPECT_NEAR(std::remainder(std::atan2(ahead.y(), ahead.x()) - next.heading, 2 * M_PI), 0.0,
                1e-9);
  }
  EXPECT_NEAR(s, road.length, 1e-9);
  for (const auto* records : {&road.elevation, &road.superelevation, &road.left_width}) {
    for (std::size_t i = 0; i + 1 < records->size(); ++i) {
      const double end = (*records)[i + 1].s;
      EXPECT_NEAR((*records)[i].value(end), (*records)[i + 1].a, 1e-9);
      if (records == &road.left_width) continue;
      EXPECT_NEAR((*records)[i].slope(end), (*records)[i + 1].b, 1e-9);
    }
  }
  EXPECT_LT(road.height_most, 0.02);
  EXPECT_LT(road.height_rms, 0.005);
}

TEST(OpenDrive, FileHasWhatTheStandardAsks) {
  OpenDriveOptions options;
  options.geo_reference = "EPSG:25832";
  options.crg_file = "road.crg";
  RoadsideVehicle car;
  car.id = 3;
  car.name = "car 3";
  car.bottom = Vector3d(winding(60.0).x(), winding(60.0).y(), 51.0);
  car.length = 4.2;
  const Eigen::Matrix3d turned =
      (Eigen::AngleAxisd(0.7, Vector3d::UnitZ()) * Eigen::AngleAxisd(-0.15, Vector3d::UnitY()) *
       Eigen::AngleAxisd(0.04, Vector3d::UnitX()))
          .toRotationMatrix();
  car.set_axes(turned.col(0), turned.col(2));
  EXPECT_NEAR(car.heading, 0.7, 1e-12);
  options.vehicles = {car};
  pugi::xml_document document;
  ASSERT_TRUE(document.load_string(encode_opendrive(winding_road(options)).c_str()));
  const pugi::xml_node root = document.child("OpenDRIVE"), road = root.child("road");
  EXPECT_STREQ(root.child("header").attribute("revMinor").value(), "7");
  EXPECT_STREQ(root.child("header").child_value("geoReference"), "EPSG:25832");
  EXPECT_STREQ(road.child("surface").child("CRG").attribute("mode").value(), "global");
  const pugi::xml_node object = road.child("objects").child("object");
  EXPECT_NEAR(object.attribute("t").as_double(), 0.0, 0.02);
  EXPECT_NEAR(object.attribute("s").as_double(), 62.0, 3.0);
  EXPECT_DOUBLE_EQ(object.attribute("length").as_double(), 4.2);
  EXPECT_NEAR(object.attribute("pitch").as_double(), -0.15, 1e-9);  // uphill
  EXPECT_NEAR(object.attribute("roll").as_double(), 0.04, 1e-9);
  std::vector<std::string> order;
  for (const pugi::xml_node child : road.children()) order.emplace_back(child.name());
  EXPECT_THAT(order, ::testing::ElementsAre("planView", "elevationProfile", "lateralProfile",
                                            "lanes", "objects", "surface"));
}

TEST(OpenDrive, NothingSeenIsNoAnswer) {
  EXPECT_THROW(make_opendrive(WindingGround(), SmoothLine({{0, 900, 0}, {50, 900, 0}}, 0.01), {}),
               NoAnswerError);
  OpenDriveOptions options;
  options.widest = 0.0;
  EXPECT_THROW(winding_road(options), std::invalid_argument);
}

TEST(OpenDrive, LibOpenDriveGivesTheGroundBack) {
#ifndef CAMBER_ODR_POINTS
  GTEST_SKIP() << "no ../shared/peers (set CAMBER_PEERS and configure again): libOpenDRIVE";
#else
  const test::TemporaryFolder folder;
  const OpenDriveRoad road = winding_road();
  std::ofstream(folder.path() / "road.xodr") << encode_opendrive(road);
  {
    std::ofstream places(folder.path() / "in");
    for (double s = 0.5; s < road.length - 0.5; s += 0.73) {
      for (double t = -2.8; t <= 3.8; t += 0.6) places << s << " " << t << "\n";
    }
  }
  const std::string command = "cd '" + folder.path().string() +
                              "' && '" CAMBER_ODR_POINTS "' road.xodr < in > out 2> warnings";
  ASSERT_EQ(std::system(command.c_str()), 0);
  EXPECT_EQ(test::read_text(folder.path() / "warnings"), "");
  std::ifstream places(folder.path() / "in"), points(folder.path() / "out");
  double length = 0.0, s = 0.0, t = 0.0, x = 0.0, y = 0.0, z = 0.0;
  std::size_t objects = 0, count = 0;
  ASSERT_TRUE(points >> length >> objects);
  EXPECT_NEAR(length, road.length, 1e-9);
  double height_most = 0.0, aside_most = 0.0;
  const SmoothLine line(winding_line(), 0.0);
  while (places >> s >> t && points >> x >> y >> z) {
    const GroundSample truth = WindingGround().at({x, y, z});
    if (std::isnan(truth.height)) continue;
    ++count;
    height_most = std::max(height_most, std::abs(truth.height - z));
    double least = 1e9;
    for (double u = std::max(0.0, s - 3.0); u < std::min(line.length(), s + 3.0); u += 0.01) {
      least = std::min(least, (line.position(u) - Vector2d(x, y)).norm());
    }
    aside_most = std::max(aside_most, std::abs(least - std::abs(t)));
  }
  EXPECT_GT(count, 2000u);
  EXPECT_LT(height_most, 0.02);
  EXPECT_LT(aside_most, 0.05);
  RecordProperty("height_most_m", std::to_string(height_most));
  RecordProperty("aside_most_m", std::to_string(aside_most));
#endif
}

}  // namespace
}  // namespace camber
