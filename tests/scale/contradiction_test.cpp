// Sources that contradict the scale of a result.

#include "camber/scale/contradiction.h"

#include <gtest/gtest.h>

#include "scale/open_road.h"

namespace camber {
namespace {

using namespace test;

Constraint length(const RoadPosterior& road, double log_scale, double sigma) {
  Constraint out = known_length(road, {320, 250}, log_scale, sigma);
  out.gate = 3.0;
  return out;
}

ConstraintReport off_by(double sigmas) { return {"length", "", sigmas, sigmas <= 3.0, ""}; }

TEST(ContradictingScale, AddsAShareOfTheSquaredDifference) {
  const RoadPosterior road = open_road();
  const Constraint source = length(road, -0.3, 0.1);
  const ScaleNoise noise;
  EXPECT_FALSE(contradicting_scale(road, source, off_by(1.9), 0.01, noise));
  const auto half = contradicting_scale(road, source, off_by(2.5), 0.01, noise);
  ASSERT_TRUE(half);
  EXPECT_NEAR(half->log_scale, -0.31, 1e-3);
  EXPECT_NEAR(half->variance, 0.5 * 0.31 * 0.31, 1e-3);
  const auto all = contradicting_scale(road, source, off_by(7.0), 0.01, noise);
  ASSERT_TRUE(all);
  EXPECT_NEAR(all->variance, 0.31 * 0.31, 1e-3);
}

TEST(ContradictingScale, ASourceThatHardlyKnowsTheScaleContradictsNone) {
  const RoadPosterior road = open_road();
  const ScaleNoise noise;
  EXPECT_TRUE(contradicting_scale(road, length(road, 0.8, 0.25), off_by(3.1), 0, noise));
  EXPECT_FALSE(contradicting_scale(road, length(road, 4.5, 1.9), off_by(2.3), 0, noise));
  // What the road's own scale leaves open is not the source's.
  const RoadPosterior wider = open_road(1.0, 3.0);
  EXPECT_TRUE(contradicting_scale(wider, length(wider, 0.8, 0.25), off_by(3.1), 0, noise));
}

}  // namespace
}  // namespace camber
