// The belief about a run's scale: against integrals by brute force, and what it must do.

#include "camber/scale/scale_belief.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <stdexcept>

namespace camber {
namespace {

ScaleEvidence source(EvidenceCause cause, double log_scale, double sigma, double wrong_share = 0.05,
                     double freedom = 4.0) {
  ScaleEvidence out;
  out.name = to_string(cause);
  out.cause = cause;
  out.log_scale = log_scale;
  out.sigma = sigma;
  out.freedom = freedom;
  out.wrong_share = wrong_share;
  return out;
}

ScaleEvidence with_shares(ScaleEvidence evidence, std::vector<std::string> shares) {
  evidence.shares = std::move(shares);
  return evidence;
}

/// Without a wrong focal length, so that what is left can be integrated by hand.
ScaleBeliefNoise given_lens() {
  ScaleBeliefNoise out;
  out.wrong_focal_length = 0.0;
  return out;
}

double mixture(const ScaleEvidence& e, double at, double reach) {
  const double z = (at - e.log_scale) / e.sigma;
  const double student = std::tgamma(0.5 * (e.freedom + 1.0)) /
                         (std::tgamma(0.5 * e.freedom) * std::sqrt(e.freedom * M_PI) * e.sigma) *
                         std::pow(1.0 + z * z / e.freedom, -0.5 * (e.freedom + 1.0));
  return (1.0 - e.wrong_share) * student + e.wrong_share / (2.0 * reach);
}

double normal(double x, double sigma) {
  return std::exp(-0.5 * x * x / (sigma * sigma)) / (sigma * std::sqrt(2.0 * M_PI));
}

/// The density at l of what is proportional to `joint(l, c)`, c normally distributed.
double by_brute_force(double l, double sigma_c, double reach,
                      const std::function<double(double, double)>& joint) {
  const double dc = 0.05 * sigma_c, dl = 0.002;
  const auto over_c = [&](double at) {
    double sum = 0.0;
    for (double c = -6.0 * sigma_c; c <= 6.0 * sigma_c; c += dc) {
      sum += normal(c, sigma_c) * dc * joint(at, c);
    }
    return sum;
  };
  double all = 0.0;
  for (double at = -reach; at <= reach; at += dl) all += over_c(at) * dl;
  return over_c(l) / all;
}

TEST(ScaleBelief, OfOneSourceIsItsMixture) {
  const ScaleEvidence height = source(EvidenceCause::kHeight, 0.1, 0.03);
  const ScaleBelief belief = scale_belief({height}, {}, given_lens());
  for (const double l : {-0.5, 0.0, 0.1, 0.17}) {
    EXPECT_NEAR(std::exp(belief.log_density(l)), mixture(height, l, given_lens().reach),
                0.01 * mixture(height, 0.1, given_lens().reach))
        << l;
  }
  EXPECT_NEAR(belief.mode, 0.1, given_lens().step);
}

TEST(ScaleBelief, OfSourcesWithACommonErrorIsTheIntegralOverIt) {
  ScaleBeliefNoise noise = given_lens();
  noise.size_population = 0.05;
  noise.step = 0.001;
  const std::vector<ScaleEvidence> evidence = {
      with_shares(source(EvidenceCause::kVehicles, 0.06, 0.05, 0.05, 3.0), {"size_population"}),
      with_shares(source(EvidenceCause::kVehicles, 0.02, 0.06, 0.05, 3.0), {"size_population"}),
      source(EvidenceCause::kSpeed, -0.05, 0.06)};
  const ScaleBelief belief = scale_belief(evidence, {}, noise);
  const auto joint = [&](double l, double c) {
    return mixture(evidence[0], l - c, noise.reach) * mixture(evidence[1], l - c, noise.reach) *
           mixture(evidence[2], l, noise.reach);
  };
  for (const double l : {-0.15, -0.05, 0.0, 0.04, 0.1}) {
    const double expected = by_brute_force(l, 0.05, noise.reach, joint);
    EXPECT_NEAR(std::exp(belief.log_density(l)), expected, 0.03 * expected + 0.05) << l;
  }
}

TEST(ScaleBelief, TheDensityIntegratesToOne) {
  const ScaleBelief belief = scale_belief(
      {source(EvidenceCause::kHeight, 0.0, 0.01), source(EvidenceCause::kSpeed, 0.7, 0.02)},
      {{0.8, 0.0, true}, {0.2, 0.0, false}}, {});
  double sum = 0.0;
  for (const double p : belief.density) sum += p * belief.step;
  EXPECT_NEAR(sum, 1.0, 1e-9);
}

TEST(ScaleBelief, AWrongSourceIsOutvoted) {
  const std::vector<ScaleEvidence> right = {source(EvidenceCause::kHeight, 0.01, 0.02),
                                            source(EvidenceCause::kMarkings, -0.01, 0.02)};
  std::vector<ScaleEvidence> all = right;
  all.push_back(source(EvidenceCause::kSpeed, std::log(1.5), 0.02));
  const ScaleBelief belief = scale_belief(all, {}, given_lens());
  EXPECT_NEAR(belief.mode, scale_belief(right, {}, given_lens()).mode, 0.005);
  EXPECT_LT(belief.second_mass, 0.01);
  EXPECT_LT(belief.sigma, 0.03);
}

TEST(ScaleBelief, TwoThatContradictEachOtherLeaveBothPossible) {
  const ScaleBelief belief = scale_belief({source(EvidenceCause::kHeight, 0.0, 0.02, 0.05),
                                           source(EvidenceCause::kSpeed, 0.4, 0.02, 0.05)},
                                          {}, given_lens());
  EXPECT_GT(belief.second_mass, 0.3);
  EXPECT_GT(belief.sigma, 0.15);
  ASSERT_TRUE(belief.cause);
  EXPECT_TRUE(*belief.cause == EvidenceCause::kHeight || *belief.cause == EvidenceCause::kSpeed);
  // The one that is seldom wrong is right.
  const ScaleBelief trusted = scale_belief({source(EvidenceCause::kHeight, 0.0, 0.02, 0.2),
                                            source(EvidenceCause::kSpeed, 0.4, 0.02, 0.002)},
                                           {}, given_lens());
  EXPECT_NEAR(trusted.mode, 0.4, 0.01);
  EXPECT_LT(trusted.second_mass, 0.05);
  ASSERT_TRUE(trusted.cause);
  EXPECT_EQ(*trusted.cause, EvidenceCause::kSpeed);  // wrong if the second mode is right
}

TEST(ScaleBelief, ACommonErrorIsNotAveragedAway) {
  ScaleBeliefNoise noise = given_lens();
  noise.size_population = 0.04;
  const auto of = [&](int vehicles, bool shared) {
    std::vector<ScaleEvidence> evidence;
    for (int i = 0; i < vehicles; ++i) {
      evidence.push_back(source(EvidenceCause::kVehicles, 0.0, 0.05, 0.01, 30.0));
      if (shared) evidence.back().shares = {"size_population"};
    }
    return scale_belief(evidence, {}, noise).sigma;
  };
  EXPECT_LT(of(40, false), 0.012);
  EXPECT_GT(of(40, true), 0.03);
  EXPECT_LT(of(40, true), 0.06);
}

TEST(ScaleBelief, AnotherLayerLeavesTheScaleToWhatDoesNotHangOnIt) {
  const std::vector<ScaleEvidence> evidence = {source(EvidenceCause::kHeight, 0.0, 0.01),
                                               source(EvidenceCause::kSpeed, -0.9, 0.02)};
  const ScaleBelief likely = scale_belief(evidence, {{0.05, 0.0, true}, {0.95, 0.0, false}}, {});
  EXPECT_NEAR(likely.mode, -0.9, 0.01);
  // A road that was proposed at half the distance: the height's metres are then half of them.
  const ScaleBelief proposed =
      scale_belief({source(EvidenceCause::kHeight, 0.0, 0.01)},
                   {{0.6, 0.0, true}, {0.4, std::log(0.5), true}}, given_lens());
  EXPECT_NEAR(proposed.mode, 0.0, 0.005);
  EXPECT_NEAR(proposed.second_mode, std::log(0.5), 0.005);
  EXPECT_NEAR(proposed.second_mass, 0.4, 0.03);
}

TEST(ScaleBelief, AWrongFocalLengthMovesWhatTheHeightMeasures) {
  ScaleEvidence lens = source(EvidenceCause::kFocalLength, std::log(0.5), 0.05, 0.005);
  const std::vector<ScaleEvidence> evidence = {source(EvidenceCause::kHeight, 0.0, 0.01), lens};
  const ScaleBelief belief = scale_belief(evidence, {}, {});
  EXPECT_NEAR(belief.mode, std::log(0.5), 0.08);
  // A speed does not hang on it.
  const ScaleBelief moving = scale_belief({source(EvidenceCause::kSpeed, 0.0, 0.02), lens}, {}, {});
  EXPECT_NEAR(moving.mode, 0.0, 0.005);
}

TEST(ScaleBelief, WhatMeasuresNoScaleChangesNothing) {
  const ScaleEvidence height = source(EvidenceCause::kHeight, 0.02, 0.02);
  ScaleEvidence layer = source(EvidenceCause::kLayer, 0.0, 0.02, 0.5);
  layer.sigma = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(scale_belief({height, layer}, {}, {}).density, scale_belief({height}, {}, {}).density);
}

TEST(ScaleAlternatives, SumToOneAndLieToBothSides) {
  for (const double spread : {0.0, 0.2}) {
    double sum = 0.0, mean = 0.0;
    for (const ScaleAlternative& road : scale_alternatives(0.1, spread)) {
      sum += road.weight;
      mean += road.weight * road.log_scale;
      EXPECT_DOUBLE_EQ(road.is_road ? 0.1 : road.weight, 0.1);
    }
    EXPECT_NEAR(sum, 1.0, 1e-12);
    EXPECT_NEAR(mean, 0.0, 1e-12);
  }
  EXPECT_THROW(scale_alternatives(1.1, 0.0), std::invalid_argument);
}

TEST(ScaleBelief, RejectsValuesThatCannotBe) {
  EXPECT_THROW(scale_belief({source(EvidenceCause::kHeight, 0.0, -0.1)}, {}, {}),
               std::invalid_argument);
  EXPECT_THROW(scale_belief({source(EvidenceCause::kHeight, 0.0, 0.1, 1.5)}, {}, {}),
               std::invalid_argument);
  EXPECT_THROW(scale_belief({}, {{0.0, 0.0, true}}, {}), std::invalid_argument);
}

TEST(ScaleEvidenceOf, AKnownNameHasItsCauseAndAnUnknownOneIsNone) {
  const ScaleEvidence height = evidence_of("camera_height", "1.65 m", 0.1, 0.02);
  EXPECT_EQ(height.cause, EvidenceCause::kHeight);
  EXPECT_EQ(height.log_scale, 0.1);
  EXPECT_FALSE(height.shares.empty());
  EXPECT_THROW(evidence_of("moon", "", 0.0, 0.1), std::invalid_argument);
  for (const EvidenceCause cause :
       {EvidenceCause::kLayer, EvidenceCause::kHeight, EvidenceCause::kFocalLength,
        EvidenceCause::kPrincipalPoint, EvidenceCause::kPoses, EvidenceCause::kMarkings,
        EvidenceCause::kVehicles, EvidenceCause::kSpeed}) {
    EXPECT_EQ(evidence_cause_from_string(to_string(cause)), cause);
  }
  EXPECT_THROW(evidence_cause_from_string("moon"), std::invalid_argument);
}

}  // namespace
}  // namespace camber
