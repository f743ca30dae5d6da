// The search for the near road on drawn images of a known road.

#include "camber/photometric/plane_search.h"

#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>

#include "support/drawn_road.h"

namespace camber {
namespace {

using test::DrawnRoad;

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
