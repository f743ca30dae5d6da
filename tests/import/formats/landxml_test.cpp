// LandXML alignments against their geometry, and what is refused.

#include "camber/import/formats/landxml.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <functional>

#include "camber/core/errors.h"

namespace camber {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;
using ::testing::HasSubstr;

std::string document(const std::string& geometry,
                     const std::string& units = "<Metric linearUnit=\"meter\"/>") {
  return "<?xml version=\"1.0\"?>\n<LandXML xmlns=\"http://www.landxml.org/schema/LandXML-1.2\" "
         "version=\"1.2\">\n<Units>" +
         units +
         "</Units>\n<CoordinateSystem epsgCode=\"25832\"/>\n"
         "<CgPoints><CgPoint name=\"p1\">5000100 400010 12.5</CgPoint></CgPoints>\n"
         "<Alignments>\n<Alignment name=\"axis\" length=\"1\" staStart=\"1000\">\n<CoordGeom>\n" +
         geometry + "</CoordGeom>\n</Alignment>\n</Alignments>\n</LandXML>\n";
}

std::string point(const char* name, const Vector2d& east_north) {
  return fmt::format("<{}>{:.9f} {:.9f}</{}>", name, east_north.y(), east_north.x(), name);
}

/// The end of a clothoid by very small steps.
Vector2d clothoid_end(double heading, double first, double last, double length) {
  Vector2d at = Vector2d::Zero();
  constexpr int kSteps = 200000;
  for (int i = 0; i < kSteps; ++i) {
    const double s = (i + 0.5) * length / kSteps;
    const double angle = heading + first * s + 0.5 * (last - first) * s * s / length;
    at += length / kSteps * Vector2d(std::cos(angle), std::sin(angle));
  }
  return at;
}

TEST(LandXml, LineClothoidArc) {
  // East, then a clothoid to the right into an arc of 100 m.
  const Vector2d start(400000.0, 5000000.0), in = start + Vector2d(50.0, 0.0);
  const Vector2d out = in + clothoid_end(0.0, 0.0, -0.01, 40.0);
  const double turned = -0.5 * 0.01 * 40.0;
  const Vector2d corner =
      in + Vector2d(out.x() - in.x() - (out.y() - in.y()) / std::tan(turned), 0);
  const Vector2d right(std::sin(turned), -std::cos(turned)), center = out + 100.0 * right;
  const Eigen::Rotation2Dd quarter(-0.5 * M_PI);
  const Vector2d end = center + quarter * (out - center);
  const LandXmlFile file = read_landxml_text(
      document("<Line>" + point("Start", start) + point("End", in) +
               "</Line>\n<Spiral length=\"40\" radiusStart=\"INF\" radiusEnd=\"100\" rot=\"cw\" "
               "spiType=\"clothoid\">" +
               point("Start", in) + point("PI", corner) + point("End", out) +
               "</Spiral>\n<Curve rot=\"cw\" radius=\"100\">" + point("Start", out) +
               point("Center", center) + point("End", end) + "</Curve>\n"),
      "axis.xml");
  ASSERT_EQ(file.alignments.size(), 1u);
  EXPECT_EQ(file.crs, "EPSG:25832");
  EXPECT_EQ(file.metres, 1.0);
  const LandXmlAlignment& axis = file.alignments[0];
  EXPECT_EQ(axis.name, "axis");
  EXPECT_EQ(axis.first_station, 1000.0);
  double length = 0.0;
  for (std::size_t i = 1; i < axis.points.size(); ++i) {
    const Vector2d here = axis.points[i].head<2>(), before = axis.points[i - 1].head<2>();
    length += (here - before).norm();
    EXPECT_LE((here - before).norm(), 50.0 + 1e-6);
    // On the arc every place is 100 m from its centre, and chords leave it by 0.1 mm at most.
    if (here.x() > out.x() + 0.01) {
      EXPECT_NEAR((here - center).norm(), 100.0, 1e-6);
      if (before.x() > out.x()) {
        EXPECT_GT((0.5 * (here + before) - center).norm(), 100.0 - 1.1e-4);
      }
    }
  }
  EXPECT_NEAR(length, 50.0 + 40.0 + 50.0 * M_PI, 0.01);
  EXPECT_NEAR((axis.points.back().head<2>() - end).norm(), 0.0, 1e-6);
  EXPECT_TRUE(std::isnan(axis.points[0].z()));
}

TEST(LandXml, FeetNamesAndLists) {
  const LandXmlFile file = read_landxml_text(
      document("<Line><Start pntRef=\"p1\"/><End>5000100 400020 13</End></Line>\n"
               "<IrregularLine><Start>5000100 400020 13</Start><End>5000110 400030 14</End>"
               "<PntList3D>5000100 400020 13 5000104 400026 13.5 5000110 400030 14</PntList3D>"
               "</IrregularLine>\n",
               "<Imperial linearUnit=\"USSurveyFoot\"/>"),
      "axis.xml");
  EXPECT_DOUBLE_EQ(file.metres, 1200.0 / 3937.0);
  const std::vector<Vector3d>& points = file.alignments.at(0).points;
  ASSERT_EQ(points.size(), 4u);
  EXPECT_EQ(points[0], Vector3d(400010, 5000100, 12.5));
  EXPECT_EQ(points[2], Vector3d(400026, 5000104, 13.5));
}

TEST(LandXml, WhatIsRefusedIsNamedWithItsLine) {
  const auto refusal = [](const std::string& text) -> std::string {
    try {
      read_landxml_text(text, "axis.xml");
    } catch (const InputError& error) {
      return error.what();
    }
    return "read";
  };
  const std::string line = "<Line><Start>0 0</Start><End>0 10</End></Line>\n";
  EXPECT_EQ(refusal(document(line)), "read");
  EXPECT_THAT(refusal("<LandXML>"), HasSubstr("axis.xml: line 1: found damaged XML"));
  EXPECT_THAT(refusal("<gpx/>"), HasSubstr("found XML of 'gpx', expected LandXML"));
  EXPECT_THAT(refusal(document("")), HasSubstr("found no Alignment"));
  EXPECT_THAT(refusal(document(line, "<Metric linearUnit=\"cubit\"/>")), HasSubstr("'cubit'"));
  EXPECT_THAT(refusal(document("<Line><Start>0 x</Start><End>0 1</End></Line>")),
              HasSubstr("line 9: found 'x' in Start, expected a number"));
  EXPECT_THAT(refusal(document("<Line><Start>0</Start><End>0 1</End></Line>")),
              HasSubstr("found 1 numbers in Start"));
  EXPECT_THAT(refusal(document(line + "<Line><Start>0 11</Start><End>0 20</End></Line>")),
              HasSubstr("starts 1.000 m from the end of the one before"));
  EXPECT_THAT(refusal(document("<Line><Start pntRef=\"q\"/><End>0 1</End></Line>")),
              HasSubstr("found pntRef 'q'"));
  const std::string curve =
      "<Curve rot=\"{}\"><Start>0 0</Start><Center>0 {}</Center><End>0 20</End></Curve>";
  EXPECT_EQ(refusal(document(fmt::format(fmt::runtime(curve), "cw", 10))), "read");
  EXPECT_THAT(refusal(document(fmt::format(fmt::runtime(curve), "cw", 11))),
              HasSubstr("expected one radius"));
  EXPECT_THAT(refusal(document(fmt::format(fmt::runtime(curve), "up", 10))), HasSubstr("rot 'up'"));
  const std::string spiral =
      "<Spiral length=\"{}\" radiusStart=\"INF\" radiusEnd=\"{}\" rot=\"ccw\" spiType=\"{}\">"
      "<Start>0 0</Start><PI>0 20</PI><End>3 30</End></Spiral>";
  const auto of = [&](const char* length, const char* radius, const char* type) {
    return refusal(document(fmt::format(fmt::runtime(spiral), length, radius, type)));
  };
  EXPECT_THAT(of("30", "100", "bloss"), HasSubstr("spiral of type 'bloss'"));
  EXPECT_THAT(of("30", "100", "clothoid"), HasSubstr("m from its End"));
  EXPECT_THAT(of("30", "-1", "clothoid"), HasSubstr("a radius above 0 or INF"));
  EXPECT_THAT(of("1e12", "100", "clothoid"), HasSubstr("at most"));
  EXPECT_THAT(of("30", "1e-12", "clothoid"), HasSubstr("too sharp"));
}

}  // namespace
}  // namespace camber
