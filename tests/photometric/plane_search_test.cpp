// The search for the near road on drawn images of a known road.

#include "camber/photometric/plane_search.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>

#include "camber/core/random.h"
#include "support/drawn_road.h"

namespace camber {
namespace {

using test::DrawnRoad;
using ::testing::Contains;
using ::testing::DoubleNear;

/// Wide and low: sees the road from 2 m on.
const PinholeCamera kCamera{480, 300, 260.0, 260.0, 240.0, 90.0};
constexpr double kHeight = 1.5;  // m

SE3 pose(double at) { return {Eigen::Matrix3d::Identity(), Eigen::Vector3d(0.0, 0.0, at)}; }

/// Three frames `step` metres apart, the middle one the reference; the motion's unit is the step.
struct Drive {
  std::vector<GrayImage> images;
  MotionEstimate motion;

  Drive(const DrawnRoad& road, double step) {
    for (int k = -1; k <= 1; ++k) {
      images.push_back(
          {kCamera.width, kCamera.height, test::draw_road(road, kCamera, pose(k * step), k)});
      motion.frame_from_reference.emplace_back(Eigen::Matrix3d::Identity(),
                                               Eigen::Vector3d(0.0, 0.0, -k));
    }
    motion.status = Status::kOk;
  }

  PlaneSearch searcher(const PlaneSearchOptions& options = {}) const {
    std::vector<PlaneSearchImage> all;
    for (const GrayImage& image : images) all.push_back({&image, nullptr});
    return {kCamera, all, 1, options};
  }
};

DrawnRoad road_of(std::function<double(double, double)> ground) {
  DrawnRoad road;
  road.ground = std::move(ground);
  return road;
}

TEST(PlaneSearch, FindsTheBaselineFromNoStart) {
  for (const double step : {0.3, 0.9, 1.8}) {
    SCOPED_TRACE(step);
    const Drive drive(road_of([](double, double) { return kHeight; }), step);
    const PlaneSearchResult found = drive.searcher().search(drive.motion);
    EXPECT_TRUE(found.informative);
    EXPECT_NEAR(found.best.log_baseline, std::log(step / kHeight), 0.03);
    EXPECT_NEAR(found.best.curvature, 0.0, 0.01);
    EXPECT_GT(found.correlation, 0.6);
    EXPECT_GT(found.lead, 0.2);
  }
}

TEST(PlaneSearch, FindsAVerticalCurveWithIt) {
  constexpr double kCurvature = 0.012;  // 1/m, a sag: the road rises ahead
  const Drive drive(
      road_of([](double, double z) { return kHeight - 0.5 * kCurvature * z * std::abs(z); }), 0.9);
  const PlaneSearchResult found = drive.searcher().search(drive.motion);
  EXPECT_TRUE(found.informative);
  EXPECT_NEAR(found.best.log_baseline, std::log(0.9 / kHeight), 0.06);
  EXPECT_NEAR(found.best.curvature, kCurvature * kHeight, 0.008);
}

TEST(PlaneSearch, CorrelationIsBestAtTheTruth) {
  const Drive drive(road_of([](double, double) { return kHeight; }), 0.9);
  const PlaneSearch search = drive.searcher();
  const double truth = std::log(0.9 / kHeight);
  int samples = 0;
  const double right = search.correlation(drive.motion, {truth, 0.0, 0.0}, &samples);
  EXPECT_GT(samples, 1000);
  for (const double off : {-0.4, -0.15, 0.15, 0.4}) {
    EXPECT_LT(search.correlation(drive.motion, {truth + off, 0.0, 0.0}), right - 0.1) << off;
  }
  EXPECT_LT(search.correlation(drive.motion, {truth, 0.02, 0.0}), right);
  EXPECT_LT(search.correlation(drive.motion, {truth, 0.0, 0.06}), right);
}

TEST(PlaneSearch, AnotherBaselineIsPlainlyWorseAtAnyCurvatureAndRoll) {
  constexpr double kCurvature = 0.012;  // 1/m, a sag: the road rises ahead
  const Drive drive(
      road_of([](double, double z) { return kHeight - 0.5 * kCurvature * z * std::abs(z); }), 0.9);
  const PlaneSearch search = drive.searcher();
  const double truth = std::log(0.9 / kHeight);
  const double right = search.correlation_with_baseline(drive.motion, truth);
  EXPECT_GT(right, search.correlation(drive.motion, {truth, 0.0, 0.0}) + 0.1);
  EXPECT_NEAR(right, search.search(drive.motion).correlation, 0.1);
  for (const double off : {-0.4, -0.2, 0.2, 0.4}) {
    EXPECT_LT(search.correlation_with_baseline(drive.motion, truth + off), right - 0.1) << off;
  }
}

TEST(PlaneSearch, WhatStandsThereTakesNoPart) {
  const Drive drive(road_of([](double, double) { return kHeight; }), 0.9);
  const auto total = static_cast<std::size_t>(kCamera.width) * kCamera.height;
  std::vector<std::uint8_t> hidden(total, 0);
  std::fill(hidden.begin() + static_cast<std::ptrdiff_t>(total * 2 / 3), hidden.end(), 1);
  const RoadHypothesis truth{std::log(0.9 / kHeight), 0.0, 0.0};
  int all = 0, rest = 0;
  const double open = drive.searcher().correlation(drive.motion, truth, &all);
  for (std::size_t which = 0; which < 3; ++which) {
    Drive changed = drive;
    std::vector<PlaneSearchImage> images;
    for (GrayImage& image : changed.images) images.push_back({&image, nullptr});
    images[which].ignored = &hidden;
    // What is hidden may look like anything.
    for (std::size_t i = total * 2 / 3; i < total; ++i) {
      changed.images[which].pixels[i] = static_cast<std::uint8_t>(CounterRandom(1).below(i, 256));
    }
    const double part = PlaneSearch(kCamera, images, 1, {}).correlation(drive.motion, truth, &rest);
    EXPECT_LT(rest, 9 * all / 10) << which;
    EXPECT_NEAR(part, open, 0.2) << which;
    images[which].ignored = nullptr;
    EXPECT_LT(PlaneSearch(kCamera, images, 1, {}).correlation(drive.motion, truth), part - 0.1)
        << which;
  }
}

TEST(PlaneSearch, NamesTheOtherRoadsThatARepeatingTextureShows) {
  constexpr double kPeriod = 0.6, kStep = 1.2;  // m
  DrawnRoad road = road_of([](double, double) { return kHeight; });
  road.light = [](double x, double z, int) {
    const double turns = 2.0 * M_PI / kPeriod;
    return 1.0 + 0.5 * std::sin(turns * z) * std::sin(turns * x) +
           0.45 * std::sin(2.0 * turns * z + 1.0);
  };
  const Drive drive(road, kStep);
  const PlaneSearchResult found = drive.searcher().search(drive.motion);
  EXPECT_TRUE(found.ambiguous);
  EXPECT_FALSE(found.informative);
  ASSERT_FALSE(found.others.empty());
  std::vector<double> steps = {kHeight * std::exp(found.best.log_baseline)};
  for (const RoadHypothesis& other : found.others) {
    steps.push_back(kHeight * std::exp(other.log_baseline));
    EXPECT_GT(std::abs(other.log_baseline - found.best.log_baseline), 0.1);
  }
  EXPECT_THAT(steps, Contains(DoubleNear(kStep, 0.05)));

  const Drive plain(road_of(road.ground), kStep);
  EXPECT_FALSE(plain.searcher().search(plain.motion).ambiguous);
}

TEST(PlaneSearch, WithoutTextureIsNotInformative) {
  Drive drive(road_of([](double, double) { return kHeight; }), 0.9);
  for (GrayImage& image : drive.images) image.pixels.assign(image.pixels.size(), 120);
  EXPECT_FALSE(drive.searcher().search(drive.motion).informative);
}

TEST(PlaneSearch, OfFramesOfOtherRoadsIsNotInformative) {
  Drive drive(road_of([](double, double) { return kHeight; }), 0.9);
  const Drive elsewhere(road_of([](double, double) { return kHeight; }), 37.7);
  drive.images[0] = elsewhere.images[0];
  drive.images[2] = elsewhere.images[2];
  EXPECT_FALSE(drive.searcher().search(drive.motion).informative);
}

TEST(PlaneSearch, IsTheSameForAnyNumberOfThreads) {
  const Drive drive(road_of([](double, double) { return kHeight; }), 0.9);
  PlaneSearchOptions one, three;
  one.num_threads = 1;
  three.num_threads = 3;
  const PlaneSearchResult a = drive.searcher(one).search(drive.motion);
  const PlaneSearchResult b = drive.searcher(three).search(drive.motion);
  EXPECT_EQ(a.best.log_baseline, b.best.log_baseline);
  EXPECT_EQ(a.best.curvature, b.best.curvature);
  EXPECT_EQ(a.correlation, b.correlation);
}

TEST(PlaneSearch, SizesThatDisagreeAreRejected) {
  Drive drive(road_of([](double, double) { return kHeight; }), 0.9);
  drive.images[0].width = 100;
  EXPECT_THROW(drive.searcher(), std::invalid_argument);
}

TEST(RoadInverseDepth, IsThatOfThePlaneAndTheCurve) {
  const Eigen::Vector3d travel(0, 0, 1);
  // 45 degrees down: as far ahead as the camera is high.
  const Eigen::Vector2d pixel(kCamera.cx, kCamera.cy + kCamera.fy);
  EXPECT_NEAR(road_inverse_depth(kCamera, travel, {0.0, 0.0, 0.0}, pixel), 1.0, 1e-9);
  // A sag is met earlier.
  EXPECT_GT(road_inverse_depth(kCamera, travel, {0.0, 0.02, 0.0}, pixel), 1.0);
  EXPECT_EQ(road_inverse_depth(kCamera, travel, {0.0, 0.0, 0.0}, {kCamera.cx, 0.0}), 0.0);
  EXPECT_NEAR(road_normal(travel, 0.1).dot(Eigen::Vector3d(0, -1, 0)), std::cos(0.1), 1e-12);
}

}  // namespace
}  // namespace camber
