#include "camber/synth/road_model.h"

#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>

#include "camber/geometry/plane.h"

namespace camber {
namespace {

RoadProfile inclined(double grade, double bank) {
  ProfileTrack g, b;
  g.initial = grade;
  b.initial = bank;
  return RoadProfile(g, b, {}, -20.0, 150.0);
}

TEST(RoadModel, EvenRoadIsAPlane) {
  RoadLayout layout;
  layout.crown = 0.0;
  layout.undulation = 0.0;
  const RoadModel road(inclined(0.15, -0.05), layout);
  const RoadModel::LocalPlane found = road.local_plane({20.0, -1.0}, 20.0, 0.0, 4.0, 1.6);
  const Eigen::Vector3d normal =
      Eigen::Vector3d(-std::tan(0.15), -std::tan(-0.05), 1.0).normalized();
  EXPECT_LT(angle_between(found.plane.normal, normal), 1e-7);
  EXPECT_NEAR(found.plane.offset, 0.0, 1e-6);  // through the origin
  EXPECT_LT(found.rms, 1e-6);
}

TEST(RoadModel, KerbIsFifteenCentimetresHigh) {
  RoadLayout layout;
  layout.pavement[0] = true;
  layout.pavement[1] = false;
  const RoadModel road(inclined(0.1, 0.0), layout);
  for (double s = 0.0; s < 60.0; s += 5.0) {
    EXPECT_NEAR(road.side_height(s, layout.half_width) - road.height(s, layout.half_width), 0.15,
                1e-12);
    EXPECT_NEAR(road.side_height(s, -layout.half_width), road.height(s, -layout.half_width), 1e-12);
  }
  EXPECT_EQ(road.kind(10.0, 0.0), GroundKind::kRoad);
  EXPECT_EQ(road.kind(10.0, layout.half_width + 0.1), GroundKind::kKerb);
  EXPECT_EQ(road.kind(10.0, layout.half_width + 1.0), GroundKind::kPavement);
  EXPECT_EQ(road.kind(10.0, -layout.half_width - 1.0), GroundKind::kVerge);
}

TEST(RoadModel, PadsClimbAwayFromTheRoadAndMeetItFlush) {
  RoadLayout layout;
  layout.crown = 0.0;
  layout.undulation = 0.0;
  RoadLayout::Pad pad;
  pad.side = 1;
  pad.begin = 20.0;
  pad.end = 30.0;
  pad.depth = 6.0;
  pad.slope_out = 0.1;
  layout.pads = {pad};
  const RoadModel road(inclined(0.1, 0.0), layout);
  const double edge = -layout.half_width;
  EXPECT_EQ(road.kind(25.0, edge - 3.0), GroundKind::kPad);
  EXPECT_NEAR(road.side_height(25.0, edge), road.height(25.0, edge), 1e-12);
  EXPECT_NEAR(road.height(25.0, edge - 3.0) - road.height(25.0, edge), 0.3, 1e-9);
}

TEST(RoadModel, GroundHasNoStepsButTheKerb) {
  const RoadProfile profile = RoadProfile::sample(RoadProfileKind::kRolling, 4, -16.0, 200.0);
  RoadLayout layout;
  layout.pavement[0] = layout.pavement[1] = true;
  RoadLayout::Pad pad;
  pad.side = 0;
  pad.begin = 12.0;
  pad.end = 20.0;
  pad.slope_out = -0.08;
  pad.slope_along = 0.05;
  layout.pads = {pad};
  const RoadModel road(profile, layout);
  for (double s = 5.0; s < 40.0; s += 0.1) {
    for (double t = layout.half_width + 0.03; t < 20.0; t += 0.2) {
      for (const double offset : {t, -t}) {
        // The banks beside a parking place are the steepest, about 45 degrees: over 2 cm no more
        // than 3 cm, where a step would be 15.
        EXPECT_LT(std::abs(road.height(s, offset + 0.02) - road.height(s, offset)), 0.03);
        EXPECT_LT(std::abs(road.height(s + 0.02, offset) - road.height(s, offset)), 0.03);
      }
    }
  }
}

TEST(RoadModel, RefusesUnusableLayouts) {
  RoadLayout layout;
  layout.half_width = 0.0;
  EXPECT_THROW(RoadModel(inclined(0, 0), layout), std::invalid_argument);
  layout = {};
  layout.pads.push_back({});  // ends where it begins
  EXPECT_THROW(RoadModel(inclined(0, 0), layout), std::invalid_argument);
  layout = {};
  layout.kerb_height = std::nan("");
  EXPECT_THROW(RoadModel(inclined(0, 0), layout), std::invalid_argument);
}

}  // namespace
}  // namespace camber
