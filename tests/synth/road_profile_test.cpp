#include "camber/synth/road_profile.h"

#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>

namespace camber {
namespace {

constexpr double kDegree = 3.14159265358979323846 / 180.0;

TEST(RoadProfile, VerticalCurvesAreNeverTighterThanSixtyMetres) {
  for (const RoadProfileKind kind : all_road_profile_kinds()) {
    for (std::uint64_t seed = 0; seed < 40; ++seed) {
      const RoadProfile road = RoadProfile::sample(kind, seed, -16.0, 420.0);
      EXPECT_GE(road.min_vertical_radius(), 60.0) << to_string(kind) << " seed " << seed;
    }
  }
}

TEST(RoadProfile, RadiusIsThatOfTheCentreline) {
  // The radius of the circle through three points 0.5 m apart, at its smallest, against the stated.
  const RoadProfile road = RoadProfile::sample(RoadProfileKind::kCrest, 3, -16.0, 200.0);
  double smallest = 1e9;
  for (double s = 0.0; s < 150.0; s += 0.25) {
    const auto in_profile = [&](double station) {
      return Eigen::Vector2d(station, road.center(station).z());
    };
    const Eigen::Vector2d a = in_profile(s - 0.5), b = in_profile(s), c = in_profile(s + 0.5);
    const double area = 0.5 * std::abs((b - a).x() * (c - a).y() - (b - a).y() * (c - a).x());
    if (area > 1e-12) {
      smallest = std::min(smallest, (b - a).norm() * (c - b).norm() * (c - a).norm() / (4 * area));
    }
  }
  // 1 %: the change of curvature within a metre.
  EXPECT_NEAR(road.min_vertical_radius() / smallest, 1.0, 0.01);
}

TEST(RoadProfile, StationsAreLengthsInPlanAndArcLengthsInSpace) {
  const RoadProfile road = RoadProfile::sample(RoadProfileKind::kBank, 5, -16.0, 200.0);
  EXPECT_EQ(road.center(0.0).norm(), 0.0);
  EXPECT_EQ(road.heading(0.0), 0.0);
  double plan = 0.0, space = 0.0;
  const double step = 0.01;
  for (double s = 0.0; s < 100.0 - 0.5 * step; s += step) {
    const Eigen::Vector3d d = road.center(s + step) - road.center(s);
    plan += d.head<2>().norm();
    space += d.norm();
  }
  EXPECT_NEAR(plan, 100.0, 1e-3);  // chords of 1 cm on curves of 90 m radius: well below 1 mm
  EXPECT_NEAR(space, road.arc_length(100.0), 1e-3);
  EXPECT_LT(road.arc_length(-10.0), -10.0 * 0.999);
}

TEST(RoadProfile, LocateInvertsThePlan) {
  const RoadProfile road = RoadProfile::sample(RoadProfileKind::kBank, 8, -16.0, 200.0);
  for (double s = 0.0; s < 120.0; s += 7.3) {
    for (const double t : {-12.0, -3.0, 0.0, 5.0}) {
      const double heading = road.heading(s);
      const Eigen::Vector2d place =
          road.center(s).head<2>() + t * Eigen::Vector2d(-std::sin(heading), std::cos(heading));
      const Eigen::Vector2d found = road.locate(place, s + 4.0);
      EXPECT_NEAR(found.x(), s, 1e-5);  // heading is interpolated between nodes 5 cm apart
      EXPECT_NEAR(found.y(), t, 1e-5);
    }
  }
}

TEST(RoadProfile, KindsAreWhatTheirNamesSay) {
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    const auto make = [&](RoadProfileKind kind) {
      return RoadProfile::sample(kind, seed, -16.0, 420.0);
    };
    const RoadProfile hill = make(RoadProfileKind::kSteepHill);
    EXPECT_GT(hill.grade(45.0) - hill.grade(0.0), 7.0 * kDegree);
    EXPECT_GT(make(RoadProfileKind::kUphill).grade(120.0), 7.9 * kDegree);
    EXPECT_LT(make(RoadProfileKind::kDownhill).grade(120.0), -5.9 * kDegree);
    const RoadProfile crest = make(RoadProfileKind::kCrest);
    EXPECT_LT(crest.grade(120.0), crest.grade(0.0) - 4.0 * kDegree);
    const RoadProfile sag = make(RoadProfileKind::kSag);
    EXPECT_GT(sag.grade(120.0), sag.grade(0.0) + 8.0 * kDegree);
    const RoadProfile bank = make(RoadProfileKind::kBank);
    EXPECT_GE(std::abs(bank.bank(80.0)), 5.9 * kDegree);
    EXPECT_LT(bank.bank(80.0) * bank.curvature(80.0), 0.0);  // the outside of the bend is higher
    const RoadProfile control = make(RoadProfileKind::kControl);
    EXPECT_EQ(control.grade(0.0), control.grade(150.0));
    EXPECT_EQ(control.curvature(100.0), 0.0);
    EXPECT_TRUE(std::isinf(control.min_vertical_radius()));
    const RoadProfile level = make(RoadProfileKind::kLevel);
    for (double at = 0.0; at < 150.0; at += 5.0) {
      EXPECT_LT(std::abs(level.grade(at)), 2.0 * kDegree);
      EXPECT_LT(std::abs(level.bank(at)), 2.0 * kDegree);
    }
  }
}

TEST(RoadProfile, NamesRoundTrip) {
  for (const RoadProfileKind kind : all_road_profile_kinds()) {
    EXPECT_EQ(road_profile_kind_from_string(to_string(kind)), kind);
  }
  EXPECT_EQ(all_road_profile_kinds().size(), 9u);
  EXPECT_THROW(road_profile_kind_from_string("hill"), std::invalid_argument);
}

TEST(RoadProfile, RefusesUnusableTracks) {
  const ProfileTrack level;
  ProfileTrack vertical;
  vertical.initial = 1.0;
  EXPECT_THROW(RoadProfile(vertical, level, level, -1.0, 10.0), std::invalid_argument);
  ProfileTrack overlapping;
  overlapping.changes = {{0.0, 10.0, 0.1}, {5.0, 10.0, 0.0}};
  EXPECT_THROW(RoadProfile(overlapping, level, level, -1.0, 10.0), std::invalid_argument);
  EXPECT_THROW(RoadProfile(level, level, level, 1.0, 10.0), std::invalid_argument);
}

}  // namespace
}  // namespace camber
