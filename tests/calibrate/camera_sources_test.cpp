#include "camber/calibrate/camera_sources.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>

#include "camber/core/random.h"

namespace camber {
namespace {

using ::testing::HasSubstr;

CameraSource source(const char* name, double by_focal, double by_height, double value,
                    double sigma) {
  CameraSource out;
  out.name = name;
  out.by_focal = by_focal;
  out.by_height = by_height;
  out.value = value;
  out.sigma = sigma;
  return out;
}

TEST(CameraSources, AreJoinedByTheirInformation) {
  std::vector<CameraSource> sources = {source("a", 1, 0, 6.00, 0.03), source("b", 1, 0, 6.05, 0.04),
                                       source("h", 0, 1, 0.5, 0.2)};
  const CameraJoint joint = join_sources(&sources);
  // Weights 16 : 9; 1 / (1 / 0.0009 + 1 / 0.0016) = 0.024^2.
  EXPECT_NEAR(joint.value(0), 6.00 + 0.05 * 9.0 / 25.0, 1e-9);
  EXPECT_NEAR(joint.focal_sigma(), 0.024, 1e-9);
  EXPECT_NEAR(joint.value(1), 0.5, 1e-9);
  EXPECT_NEAR(joint.height_sigma(), 0.2, 1e-9);
  EXPECT_NEAR(sources[0].residual_sigma, -1.0, 1e-3);  // 0.05 over hypot(0.03, 0.04)
  EXPECT_NEAR(sources[1].residual_sigma, 1.0, 1e-3);
  EXPECT_TRUE(std::isnan(sources[2].residual_sigma));
  EXPECT_TRUE(sources[0].accepted && sources[1].accepted && sources[2].accepted);
  EXPECT_NEAR(share_of_source(sources, 0, 0), 1.0 - 0.0009 * 0.64 / 0.0016, 1e-3);
  EXPECT_NEAR(share_of_source(sources, 2, 0), 0.0, 1e-6);
}

/// Lengths along the view are those of a product: either one gives the other.
TEST(CameraSources, AProductGivesTheOneByTheOther) {
  const double log_f = std::log(700.0), log_h = std::log(1.4);
  std::vector<CameraSource> by_height = {source("wide", 1, 0, log_f + 0.3, 0.4),
                                         source("dashes", 1, 1, log_f + log_h, 0.02),
                                         source("given", 0, 1, log_h, 0.02)};
  const CameraJoint focal = join_sources(&by_height);
  EXPECT_NEAR(focal.value(0), log_f, 0.003);
  EXPECT_NEAR(focal.focal_sigma(), std::hypot(0.02, 0.02), 1e-3);
  EXPECT_GT(share_of_source(by_height, 1, 0), 0.9);
  std::vector<CameraSource> by_focal = {source("turns", 1, 0, log_f, 0.015),
                                        source("dashes", 1, 1, log_f + log_h, 0.02),
                                        height_of_cars()};
  const CameraJoint height = join_sources(&by_focal);
  EXPECT_NEAR(height.value(1), log_h, 0.01);  // 0.16 of the prior's 0.2, of which 0.015 counts
  EXPECT_NEAR(height.height_sigma(), std::hypot(0.015, 0.02), 1e-3);
}

TEST(CameraSources, TheOneThatTheOthersContradictIsLeftOut) {
  std::vector<CameraSource> sources = {source("a", 1, 0, 6.00, 0.02), source("b", 1, 0, 6.02, 0.02),
                                       source("wrong", 1, 0, 6.40, 0.02), height_of_cars()};
  const CameraJoint joint = join_sources(&sources);
  EXPECT_FALSE(sources[2].accepted);
  EXPECT_THAT(sources[2].reason, HasSubstr("standard deviations off"));
  EXPECT_NEAR(joint.value(0), 6.01, 1e-9);
  EXPECT_NEAR(joint.focal_sigma(), 0.02 / std::sqrt(2.0), 1e-9);
  EXPECT_EQ(share_of_source(sources, 2, 0), 0.0);
}

/// Of two that contradict each other none says which is right: the sigma covers both.
TEST(CameraSources, TwoThatContradictEachOtherLeaveItOpen) {
  std::vector<CameraSource> sources = {source("a", 1, 0, 6.00, 0.03), source("b", 1, 0, 6.40, 0.04),
                                       height_of_cars()};
  const CameraJoint joint = join_sources(&sources);
  EXPECT_TRUE(sources[0].accepted);
  EXPECT_FALSE(sources[1].accepted);
  EXPECT_EQ(joint.value(0), 6.00);
  EXPECT_NEAR(joint.focal_sigma(), 0.03 * 0.40 / 0.05, 1e-4);
}

TEST(CameraSources, StatedSigmasAreThoseOfTheErrors) {
  constexpr int kDraws = 3000;
  double focal = 0.0, height = 0.0;
  for (int draw = 0; draw < kDraws; ++draw) {
    const CounterRandom random(3, static_cast<std::uint64_t>(draw));
    std::vector<CameraSource> sources = {
        source("turns", 1, 0, 6.2, 0.1), source("speeds", 1, 1, 6.6, 0.03),
        source("given", 0, 1, 0.4, 0.02), source("sizes", -0.2, 1, 0.4 - 0.2 * 6.2, 0.05)};
    for (std::size_t i = 0; i < sources.size(); ++i) {
      sources[i].value += sources[i].sigma * random.normal(i);
    }
    const CameraJoint joint = join_sources(&sources);
    focal += std::pow((joint.value(0) - 6.2) / joint.focal_sigma(), 2) / kDraws;
    height += std::pow((joint.value(1) - 0.4) / joint.height_sigma(), 2) / kDraws;
  }
  // 1 +- 0.026; some draws lose a source beyond three sigma.
  EXPECT_NEAR(focal, 1.0, 0.15);
  EXPECT_NEAR(height, 1.0, 0.15);
}

TEST(CameraSources, WhatNothingMeasuresIsAnError) {
  std::vector<CameraSource> open = {source("a", 1, 0, 6.0, 0.1)};
  EXPECT_THROW(join_sources(&open), std::invalid_argument);
  std::vector<CameraSource> certain = {source("a", 1, 0, 6.0, 0.0), height_of_cars()};
  EXPECT_THROW(join_sources(&certain), std::invalid_argument);
}

}  // namespace
}  // namespace camber
