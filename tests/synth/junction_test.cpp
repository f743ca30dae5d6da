#include "camber/synth/junction.h"

#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>

#include "camber/synth/road_model.h"
#include "camber/synth/synth_world.h"

namespace camber {
namespace {

constexpr double kPi = 3.14159265358979323846;

Junction junction_of(CornerKind kind) {
  Junction out;
  out.kind = kind;
  out.station = 20.0;
  out.half_width = 3.0;
  out.kerb_radius = 5.0;
  out.outer_radius = 9.0;
  return out;
}

constexpr double kRoadHalf = 3.5;

TEST(Junction, EdgesOfStraightArmsAreTheirHalfWidths) {
  for (const CornerKind kind : all_corner_kinds()) {
    const Junction j = junction_of(kind);
    for (const double t : {-5.0, -3.5, -1.0, 0.0, 3.0, 6.0}) {
      EXPECT_NEAR(j.edge_distance(0.0, t, kRoadHalf), std::abs(t) - kRoadHalf, 1e-12)
          << to_string(kind);
    }
    // The left arm, far from the road: across it is along the road.
    for (const double s : {15.0, 17.0, 20.0, 22.0, 24.0}) {
      EXPECT_NEAR(j.edge_distance(s, 30.0, kRoadHalf), std::abs(s - 20.0) - 3.0, 1e-12);
    }
    EXPECT_EQ(j.edge_distance(20.0, -30.0, kRoadHalf) < 0.0, j.has_arm(1)) << to_string(kind);
    EXPECT_EQ(j.edge_distance(60.0, 0.0, kRoadHalf) < 0.0, j.road_goes_on()) << to_string(kind);
  }
}

TEST(Junction, CornersAreRoundedWithTheirRadius) {
  for (const CornerKind kind : all_corner_kinds()) {
    const Junction j = junction_of(kind);
    // The near left corner: its kerb is a quarter of a circle about this place.
    const Eigen::Vector2d middle(20.0 - 3.0 - 5.0, kRoadHalf + 5.0);
    for (double angle = 0.02; angle < 0.5 * kPi; angle += 0.1) {
      for (const double radius : {4.0, 5.0, 5.5}) {
        const Eigen::Vector2d p =
            middle + radius * Eigen::Vector2d(std::cos(angle), -std::sin(angle));
        EXPECT_NEAR(j.edge_distance(p.x(), p.y(), kRoadHalf), 5.0 - radius, 1e-12)
            << to_string(kind) << " " << angle;
      }
    }
  }
}

TEST(Junction, StemEndsAtAStraightKerbAndABendAtARoundOne) {
  const Junction stem = junction_of(CornerKind::kStem);
  for (const double t : {-8.0, -2.0, 0.0, 1.0, 9.0}) {
    EXPECT_NEAR(stem.edge_distance(23.0, t, kRoadHalf), 0.0, 1e-12);
    EXPECT_NEAR(stem.edge_distance(23.7, t, kRoadHalf), 0.7, 1e-12);
  }
  const Junction bend = junction_of(CornerKind::kBend);  // to the left
  const Eigen::Vector2d middle(23.0 - 9.0, -kRoadHalf + 9.0);
  for (double angle = 0.02; angle < 0.5 * kPi; angle += 0.1) {
    const Eigen::Vector2d p = middle + 9.4 * Eigen::Vector2d(std::cos(angle), -std::sin(angle));
    EXPECT_NEAR(bend.edge_distance(p.x(), p.y(), kRoadHalf), 0.4, 1e-12);
  }
}

TEST(Junction, CoordinateAlongEdgesNeverStandsStill) {
  for (const CornerKind kind : all_corner_kinds()) {
    for (const double angle : {1.05, 0.5 * kPi, 2.09}) {
      for (const int side : {0, 1}) {
        Junction j = junction_of(kind);
        j.angle = angle;
        j.side = side;
        j.outer_radius = 18.0;  // begins well before the street's axis
        // From place to place on the edges, found along lines across them.
        const auto on_edge = [&](Eigen::Vector2d inside, Eigen::Vector2d outside) {
          for (int i = 0; i < 40; ++i) {
            const Eigen::Vector2d middle = 0.5 * (inside + outside);
            (j.edge_distance(middle.x(), middle.y(), kRoadHalf) > 0.0 ? outside : inside) = middle;
          }
          return inside;
        };
        int steps = 0;
        for (double a = -5.0; a < 45.0; a += 0.31) {
          for (double b = -25.0; b < 25.0; b += 0.31) {
            const Eigen::Vector2d p(a, b);
            const Eigen::Vector2d gradient(
                j.edge_distance(a + 1e-4, b, kRoadHalf) - j.edge_distance(a - 1e-4, b, kRoadHalf),
                j.edge_distance(a, b + 1e-4, kRoadHalf) - j.edge_distance(a, b - 1e-4, kRoadHalf));
            if (std::abs(j.edge_distance(a, b, kRoadHalf)) > 0.3) continue;
            const Eigen::Vector2d across = gradient.normalized();
            const Eigen::Vector2d along = 0.05 * Eigen::Vector2d(-across.y(), across.x());
            const Eigen::Vector2d here = on_edge(p - 0.5 * across, p + 0.5 * across);
            const Eigen::Vector2d next =
                on_edge(p + along - 0.5 * across, p + along + 0.5 * across);
            // Where the sides change over, a step goes up and down again.
            if (here.y() * next.y() < 0.0) continue;
            const double moved = (next - here).norm();
            const double counted = std::abs(j.along_edge(next.x(), next.y(), kRoadHalf) -
                                            j.along_edge(here.x(), here.y(), kRoadHalf));
            EXPECT_GT(counted, 0.99 * moved) << to_string(kind) << " " << here.transpose();
            EXPECT_LT(counted, 2.05 * moved) << to_string(kind) << " " << here.transpose();
            ++steps;
          }
        }
        EXPECT_GT(steps, 300);
      }
    }
  }
}

TEST(Junction, StreetCoordinatesInvertAndFollowTheAngle) {
  Junction j = junction_of(CornerKind::kCrossing);
  j.angle = 1.2;
  const Eigen::Vector2d st = j.from_street(7.0, -2.0);
  EXPECT_LT((j.street_coordinates(st.x(), st.y()) - Eigen::Vector2d(7.0, -2.0)).norm(), 1e-12);
  // 40 m along the street, 2 m to its right: inside, 1 m from its edge.
  const Eigen::Vector2d inside = j.from_street(40.0, -2.0);
  EXPECT_NEAR(j.edge_distance(inside.x(), inside.y(), kRoadHalf), -1.0, 1e-12);
}

TEST(Junction, ArmsTakeOnTheirGradeSmoothly) {
  Junction j = junction_of(CornerKind::kCrossing);
  j.arm_grade[0] = 0.08;
  j.arm_grade[1] = -0.05;
  EXPECT_EQ(j.arm_rise(j.level_reach), 0.0);
  EXPECT_EQ(j.arm_rise(-j.level_reach), 0.0);
  const auto slope = [&](double t) { return (j.arm_rise(t + 1e-4) - j.arm_rise(t - 1e-4)) / 2e-4; };
  EXPECT_NEAR(slope(40.0), 0.08, 1e-9);
  EXPECT_NEAR(slope(-40.0), 0.05, 1e-9);  // falls away to the right
  double last = 0.0;
  for (double t = 0.0; t < 30.0; t += 0.05) {
    // No bend tighter than the change of 0.08 over 12 m allows: its steepest is pi / 2 of the mean.
    EXPECT_NEAR(slope(t), last, 0.05 * 0.08 / 12.0 * 1.6);
    last = slope(t);
  }
}

TEST(Junction, NamesAreKnown) {
  for (const CornerKind kind : all_corner_kinds()) {
    EXPECT_EQ(corner_kind_from_string(to_string(kind)), kind);
  }
  EXPECT_EQ(all_corner_kinds().size(), 4u);
  EXPECT_THROW(corner_kind_from_string("roundabout"), std::invalid_argument);
}

RoadModel road_with(const Junction& junction, bool pavement) {
  ProfileTrack grade, bank;
  grade.initial = 0.05;
  bank.initial = 0.02;
  RoadLayout layout;
  layout.half_width = kRoadHalf;
  layout.pavement[0] = layout.pavement[1] = pavement;
  layout.kerb_height = 0.17;
  layout.verge_rise[0] = layout.verge_rise[1] = pavement ? 0.0 : 0.12;
  layout.verge_slope[1] = layout.verge_slope[0];
  layout.junction = junction;
  return RoadModel(RoadProfile(grade, bank, {}, -16.0, 200.0), layout);
}

TEST(RoadModelWithJunction, KerbIsAsHighAsAskedAllAlong) {
  for (const CornerKind kind : all_corner_kinds()) {
    const RoadModel road = road_with(junction_of(kind), true);
    const auto distance = [&](const Eigen::Vector2d& p) {
      return road.edge_distance(p.x(), p.y());
    };
    // Where lines across the place meet the carriageway's edge.
    int found = 0;
    for (double a = -10.0; a < 50.0; a += 0.37) {
      for (double b = -40.0; b < 40.0; b += 0.37) {
        for (const bool along : {true, false}) {
          Eigen::Vector2d inside(a, b), outside = inside;
          outside[along ? 0 : 1] += 0.37;
          if (distance(inside) > 0.0) std::swap(inside, outside);
          if (distance(inside) > 0.0 || distance(outside) <= 0.0) continue;
          for (int i = 0; i < 40; ++i) {
            const Eigen::Vector2d middle = 0.5 * (inside + outside);
            (distance(middle) > 0.0 ? outside : inside) = middle;
          }
          EXPECT_NEAR(
              road.side_height(inside.x(), inside.y()) - road.road_height(inside.x(), inside.y()),
              0.17, 1e-9);
          ++found;
        }
      }
    }
    EXPECT_GT(found, 300);
    EXPECT_EQ(road.kind(0.0, 0.0), GroundKind::kRoad);
    EXPECT_EQ(road.kind(0.0, kRoadHalf + 0.1), GroundKind::kKerb);
    EXPECT_EQ(road.kind(0.0, kRoadHalf + 1.0), GroundKind::kPavement);
    EXPECT_EQ(road.kind(0.0, kRoadHalf + 4.0), GroundKind::kVerge);
  }
}

TEST(RoadModelWithJunction, SurfaceHasNoStepsButTheKerb) {
  Junction j = junction_of(CornerKind::kStem);
  j.arm_grade[0] = 0.1;
  j.arm_grade[1] = -0.1;
  const RoadModel road = road_with(j, false);
  for (double s = 0.0; s < 40.0; s += 0.21) {
    for (double t = -30.0; t < 30.0; t += 0.21) {
      // The steepest are the verges, which rise 12 cm within 30: a slope of 0.6 at most.
      EXPECT_LT(std::abs(road.height(s + 0.02, t) - road.height(s, t)), 0.02);
      EXPECT_LT(std::abs(road.height(s, t + 0.02) - road.height(s, t)), 0.02);
    }
  }
  // A verge's rise is there.
  EXPECT_NEAR(road.height(0.0, kRoadHalf + 0.3) - road.height(0.0, kRoadHalf - 0.001), 0.12, 0.03);
}

TEST(RoadModelWithJunction, RefusesWhatItCannotMake) {
  ProfileTrack curvature;
  curvature.initial = 0.01;
  RoadLayout layout;
  layout.pavement[0] = layout.pavement[1] = true;
  layout.junction = junction_of(CornerKind::kStem);
  EXPECT_THROW(RoadModel(RoadProfile({}, {}, curvature, -16.0, 200.0), layout),
               std::invalid_argument);
  const RoadProfile straight({}, {}, {}, -16.0, 200.0);
  layout.pavement[0] = false;
  EXPECT_THROW(RoadModel(straight, layout), std::invalid_argument);
  layout.pavement[0] = true;
  layout.junction->angle = 0.3;
  EXPECT_THROW(RoadModel(straight, layout), std::invalid_argument);
  layout.junction = junction_of(CornerKind::kStem);
  layout.junction->kerb_radius = std::nan("");
  EXPECT_THROW(RoadModel(straight, layout), std::invalid_argument);
}

}  // namespace
}  // namespace camber
