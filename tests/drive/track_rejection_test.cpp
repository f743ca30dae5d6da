#include "camber/drive/detail/track_rejection.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>

namespace camber::internal {
namespace {

using testing::HasSubstr;

const VehiclePrior& prior() { return shipped_vehicle_prior(); }

TrackEvidence a_car() {
  TrackEvidence out;
  out.vehicle_class = "car";
  out.dimensions = prior().shape("car").mean_dimensions();
  out.log_factor_sigma = 0.08;
  out.speed_sigma = 15.0;
  return out;
}

/// A view every tenth of a second, known to half a metre; every n-th is far beside the path.
std::vector<TrackPlace> path(int n) {
  std::vector<TrackPlace> out;
  for (int i = 0; i < 20; ++i) {
    const double aside = n > 0 && i % n == 0 ? 60.0 : 0.0;
    out.push_back({0.1 * i, {aside, 0.0, 1.2 * i}, 0.25 * Eigen::Matrix3d::Identity()});
  }
  return out;
}

TEST(TrackRejection, AVehicleMayBeOne) {
  TrackEvidence evidence = a_car();
  EXPECT_EQ(why_no_vehicle(evidence, prior()), "");
  evidence.log_factor = 0.2;
  evidence.heights = {{0.3, 0.2}, {-0.2, 0.1}};
  evidence.places = path(0);
  EXPECT_EQ(why_no_vehicle(evidence, prior()), "");
  evidence.vehicle_class = "truck";
  evidence.dimensions = Dimensions{9.0, 2.5, 3.3};
  EXPECT_EQ(why_no_vehicle(evidence, prior()), "");
}

TEST(TrackRejection, ByTheWayBetweenItsViewsItIsTooSmallOrTooLarge) {
  TrackEvidence evidence = a_car();
  evidence.log_factor = 0.7;
  EXPECT_THAT(why_no_vehicle(evidence, prior()), HasSubstr("0.50 of the size of a car"));
  evidence.log_factor = -0.7;
  EXPECT_THAT(why_no_vehicle(evidence, prior()), HasSubstr("2.01 of the size of a car"));
}

TEST(TrackRejection, ViewsThatErrAlikeDoNotAddUp) {
  TrackEvidence evidence = a_car();
  evidence.heights.assign(100, {0.5, 0.2});  // 2.5 standard deviations each
  EXPECT_EQ(why_no_vehicle(evidence, prior()), "");
  evidence.heights.assign(3, {-1.5, 0.2});
  EXPECT_EQ(why_no_vehicle(evidence, prior()), "it is 1.5 m below the road");
  evidence.heights = {{9.0, std::numeric_limits<double>::quiet_NaN()}};
  EXPECT_EQ(why_no_vehicle(evidence, prior()), "");
}

TEST(TrackRejection, ByItsWholeWayItIsTooFast) {
  TrackEvidence evidence = a_car();
  evidence.places = path(0);
  for (TrackPlace& place : evidence.places) place.in_world *= 4.0;  // 48 m/s
  EXPECT_EQ(why_no_vehicle(evidence, prior()), "");
  for (TrackPlace& place : evidence.places) place.in_world *= 3.0;
  EXPECT_EQ(why_no_vehicle(evidence, prior()), "it moves at 144 m/s");
}

TEST(TrackRejection, OneJumpIsAMistakeManyAreNoVehicle) {
  TrackEvidence evidence = a_car();
  evidence.places = path(10);  // 3 of 19 steps
  EXPECT_EQ(why_no_vehicle(evidence, prior()), "");
  evidence.places = path(2);
  EXPECT_EQ(why_no_vehicle(evidence, prior()), "it jumps, in 19 of 19 steps");
  for (TrackPlace& place : evidence.places) place.covariance *= 1e4;  // hardly known
  EXPECT_EQ(why_no_vehicle(evidence, prior()), "");
}

}  // namespace
}  // namespace camber::internal
