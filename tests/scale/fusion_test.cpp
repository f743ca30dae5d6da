// Sources compared before they are joined.

#include "camber/scale/fusion.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <memory>

#include "camber/scale/camera_height_constraint.h"
#include "camber/scale/known_poses_constraint.h"
#include "scale/open_road.h"

namespace camber {
namespace {

using namespace test;
using ::testing::HasSubstr;

Constraint scale_source(const RoadPosterior& road, const char* name, double scale, double sigma) {
  Constraint out = known_poses_constraint(road, scale, sigma);
  out.name = name;
  return out;
}

TEST(Fuse, SourcesThatAgreeAreWeighedByTheirVariances) {
  const RoadPosterior road = open_road();
  const FusedRoad fused = fuse(road, {scale_source(road, "a", std::exp(0.02), 0.01),
                                      scale_source(road, "b", std::exp(-0.02), 0.02)});
  EXPECT_NEAR(std::log(fused.road.metres_per_baseline()), 0.012, 1e-5);
  EXPECT_NEAR(fused.road.scale_sigma(), 0.01 * std::sqrt(0.8), 1e-5);
  ASSERT_EQ(fused.reports.size(), 2u);
  for (const ConstraintReport& report : fused.reports) {
    EXPECT_TRUE(report.accepted);
    EXPECT_EQ(report.reason, "");
    // 0.04 apart at the root of the summed variances.
    EXPECT_NEAR(report.residual_sigma, 0.04 / std::hypot(0.01, 0.02), 0.01);
  }
}

TEST(Fuse, AnErrorThatAllSourcesShareStaysHoweverManyTheyAre) {
  const RoadPosterior road = open_road();
  std::vector<Constraint> sources;
  for (int k = 0; k < 25; ++k) sources.push_back(scale_source(road, "car", 1.0, 0.05));
  constexpr double kCommon = 0.02;
  const FusedRoad fused = fuse(road, sources, kCommon);
  EXPECT_NEAR(fused.road.scale_sigma(), std::hypot(0.05 / 5.0, kCommon), 1e-4);
  EXPECT_NEAR(fuse(road, sources).road.scale_sigma(), 0.05 / 5.0, 1e-4);
  // What they share does not make them disagree.
  sources.push_back(scale_source(road, "other", std::exp(0.15), 0.01));
  EXPECT_FALSE(fuse(road, sources, kCommon).reports.back().accepted);
}

TEST(Fuse, OfThreeTheOneThatContradictsTheOthersIsRejected) {
  const RoadPosterior road = open_road();
  const FusedRoad fused =
      fuse(road, {scale_source(road, "a", 1.0, 0.01), scale_source(road, "wrong", 1.3, 0.01),
                  scale_source(road, "b", 1.01, 0.01)});
  EXPECT_TRUE(fused.reports[0].accepted);
  EXPECT_FALSE(fused.reports[1].accepted);
  EXPECT_TRUE(fused.reports[2].accepted);
  EXPECT_THAT(fused.reports[1].reason, HasSubstr("standard deviations off"));
  EXPECT_GT(fused.reports[1].residual_sigma, 10.0);
  EXPECT_LT(fused.reports[0].residual_sigma, 2.0);
  EXPECT_NEAR(fused.road.metres_per_baseline(), 1.005, 1e-3);
}

TEST(Fuse, ASourceThatIsNoNumberSpoilsNoOther) {
  const RoadPosterior road = open_road();
  Constraint broken = scale_source(road, "broken", 1.3, 0.01);
  broken.covariance(0, 0) = std::numeric_limits<double>::quiet_NaN();
  const FusedRoad fused = fuse(road, {scale_source(road, "a", 1.02, 0.01), broken});
  EXPECT_TRUE(fused.reports[0].accepted);
  EXPECT_FALSE(fused.reports[1].accepted);
  EXPECT_THAT(fused.reports[1].reason, HasSubstr("not finite"));
  EXPECT_NEAR(fused.road.metres_per_baseline(), 1.02, 1e-3);
}

TEST(Fuse, TheOrderOfTheSourcesDoesNotMatter) {
  const RoadPosterior road = open_road();
  const std::vector<Constraint> sources = {scale_source(road, "a", 1.0, 0.01),
                                           scale_source(road, "b", 1.02, 0.02),
                                           camera_height_constraint(road, kRoadHeight, 0.01)};
  const FusedRoad one = fuse(road, sources);
  const FusedRoad other = fuse(road, {sources[2], sources[1], sources[0]});
  EXPECT_NEAR(one.road.metres_per_baseline(), other.road.metres_per_baseline(), 1e-12);
  EXPECT_NEAR(one.road.scale_sigma(), other.road.scale_sigma(), 1e-9);
  EXPECT_NEAR(one.reports[0].residual_sigma, other.reports[2].residual_sigma, 1e-9);
}

TEST(Fuse, ASourceThatMeasuredNothingIsReportedOnly) {
  const RoadPosterior road = open_road();
  Constraint nothing;
  nothing.name = "lane_markings";
  const FusedRoad fused = fuse(road, {nothing, scale_source(road, "a", 1.0, 0.01)});
  EXPECT_EQ(fused.reports[0].name, "lane_markings");
  EXPECT_FALSE(fused.reports[0].accepted);
  EXPECT_TRUE(std::isnan(fused.reports[0].residual_sigma));
  EXPECT_TRUE(fused.reports[1].accepted);
  EXPECT_EQ(fuse(road, {}).road.metres_per_baseline(), road.metres_per_baseline());
}

TEST(ContradictionShare, GrowsFromTheStartToTheGate) {
  EXPECT_EQ(contradiction_share(1.4, 1.5, 3.0), 0.0);
  EXPECT_NEAR(contradiction_share(2.25, 1.5, 3.0), 0.5, 1e-12);
  EXPECT_EQ(contradiction_share(3.0, 1.5, 3.0), 1.0);
  EXPECT_EQ(contradiction_share(30.0, 1.5, 3.0), 1.0);
}

TEST(CameraHeightConstraint, FixesTheScaleToItsOwnSigmaAndThePlanes) {
  const RoadPosterior road = open_road();
  const Constraint height = camera_height_constraint(road, 1.02 * kRoadHeight, 0.01);
  const RoadPosterior after = road.conditioned(height);
  EXPECT_NEAR(after.metres_per_baseline(), 1.02, 1e-3);
  // 1 cm of 1.65 m, and 0.2 % of the plane's own.
  EXPECT_NEAR(after.scale_sigma(), std::hypot(0.01 / kRoadHeight, 0.002), 2e-4);
  EXPECT_THROW(camera_height_constraint(road, 0.0, 0.01), std::invalid_argument);
  EXPECT_THROW(camera_height_constraint(road, 1.0, 0.0), std::invalid_argument);
}

TEST(KnownPosesConstraint, IsTheScale) {
  const RoadPosterior road = open_road(0.9);
  const RoadPosterior after = road.conditioned(known_poses_constraint(road, 1.0, 0.003));
  EXPECT_NEAR(after.metres_per_baseline(), 1.0, 1e-4);
  EXPECT_NEAR(after.scale_sigma(), 0.003, 1e-5);
  EXPECT_THROW(known_poses_constraint(road, 1.0, 0.0), std::invalid_argument);
}

}  // namespace
}  // namespace camber
