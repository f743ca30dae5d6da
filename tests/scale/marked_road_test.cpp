// The road by the markings of one drawn image: its plane, its metres and their sigmas.

#include "camber/scale/marked_road.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <stdexcept>

#include "camber/scale/detail/road_shape.h"
#include "support/drawn_markings.h"

namespace camber {
namespace {

using ::testing::HasSubstr;

const PinholeCamera kCamera{1000, 400, 720.0, 720.0, 500.0, 150.0};
constexpr double kDegree = 3.14159265358979323846 / 180.0;

LaneMarkingSizes dashes() {
  LaneMarkingSizes out;
  out.dash_length = 3.0;
  out.dash_gap = 6.0;
  out.line_width = 0.12;
  return out;
}

LaneMarkingSizes with_stripes() {
  LaneMarkingSizes out = dashes();
  out.stripe_width = out.stripe_gap = 0.5;
  return out;
}

/// A road that rises by `pitch` against the camera's level and falls to its right by `roll`, rad.
Plane road_of(double height, double pitch, double roll) {
  return {Eigen::Vector3d(roll, -1.0, -pitch).normalized(), height};
}

MarkedRoad find(const Plane& road, const test::Paint& paint, const LaneMarkingSizes& sizes,
                int threads = 1, std::uint64_t seed = 1) {
  const GrayImage image = test::draw_markings(kCamera, road, paint, 3.0, seed);
  const std::vector<std::uint8_t> visible(image.pixels.size(), 1);
  MarkedRoadOptions options;
  options.num_threads = threads;
  return find_marked_road(kCamera, detect_painted_strokes(image, visible, 60, threads), sizes,
                          options);
}

bool crossing(double x, double z, double from) {
  return z > from && z < from + 4.0 && std::abs(x) < 3.25 && x + 3.25 - std::floor(x + 3.25) < 0.5;
}

/// Relative error of a marking's distance, and that over its sigma.
std::pair<double, double> distance_error(const MarkedRoad& found, const SeenMarking& marking,
                                         const Plane& road) {
  const double rho = found.inverse_depth(kCamera, marking.pixel);
  const Eigen::Matrix<double, 1, MarkedRoad::kShape> j = found.by_shape(kCamera, marking.pixel);
  const double sigma = std::sqrt((j * found.covariance * j.transpose())(0, 0)) / rho;
  const double depth = -road.offset / road.normal.dot(kCamera.ray(marking.pixel));
  const double relative = 1.0 / rho / depth - 1.0;
  return {relative, relative / std::hypot(sigma, ScaleNoise().painted_size)};
}

TEST(MarkedRoad, DashesGiveTheDistanceWhateverTheHeightAndThePitch) {
  for (const auto& [height, pitch] :
       {std::pair{1.2, 0.0}, std::pair{1.65, 4 * kDegree}, std::pair{2.4, -5 * kDegree}}) {
    const Plane road = road_of(height, pitch, 0.0);
    const MarkedRoad found = find(
        road, [](double x, double z) { return test::dashed(x, z, -1.5, 7.0); }, dashes());
    ASSERT_EQ(found.status, Status::kOk) << height << ": " << found.reason;
    EXPECT_GE(found.dashes, 2);
    for (const SeenMarking& m : found.markings) {
      const auto [relative, sigmas] = distance_error(found, m, road);
      EXPECT_LT(std::abs(relative), 0.05) << height;  // the bar of a single image
      EXPECT_LT(std::abs(sigmas), 3.0) << height;
    }
  }
}

TEST(MarkedRoad, TwoLinesSideBySideGiveThePlane) {
  const Plane road = road_of(1.5, 3 * kDegree, 2 * kDegree);
  const MarkedRoad found = find(
      road,
      [](double x, double z) {
        return test::dashed(x, z, -1.7, 7.0) || test::dashed(x, z, 1.8, 8.0);
      },
      dashes());
  ASSERT_EQ(found.status, Status::kOk) << found.reason;
  ASSERT_FALSE(found.markings.empty());
  EXPECT_TRUE(found.markings[0].beside);
  // Tangent plane where the nearest marking lies, by three rays.
  const Eigen::Vector2d at = found.markings[0].pixel;
  const auto point = [&](double du, double dv) -> Eigen::Vector3d {
    const Eigen::Vector2d pixel = at + Eigen::Vector2d(du, dv);
    return kCamera.ray(pixel) / found.inverse_depth(kCamera, pixel);
  };
  const Eigen::Vector3d normal =
      (point(20, 0) - point(-20, 0)).cross(point(0, 5) - point(0, -5)).normalized();
  const double angle = std::acos(std::min(1.0, std::abs(normal.dot(road.normal))));
  EXPECT_LT(angle / kDegree, 1.5);
}

TEST(MarkedRoad, ACrossingGivesThePlaneAndTheDistance) {
  const Plane road = road_of(1.4, -2 * kDegree, -1.5 * kDegree);
  const MarkedRoad found = find(
      road, [](double x, double z) { return crossing(x, z, 9.0); }, with_stripes());
  ASSERT_EQ(found.status, Status::kOk) << found.reason;
  ASSERT_EQ(found.crossings, 1);
  const auto [relative, sigmas] = distance_error(found, found.markings[0], road);
  EXPECT_LT(std::abs(relative), 0.03);
  EXPECT_LT(std::abs(sigmas), 3.0);
  const UncertainPlane ego = found.ego();
  EXPECT_NEAR(ego.plane.offset, 1.4, 3.0 * std::sqrt(ego.covariance(2, 2)));
}

TEST(MarkedRoad, OneLineAloneSaysThatItsCrossSlopeIsUnknown) {
  const Plane road = road_of(1.5, 0.0, 0.0);
  const test::Paint one = [](double x, double z) { return test::dashed(x, z, -0.3, 7.0); };
  const test::Paint two = [&](double x, double z) {
    return one(x, z) || test::dashed(x, z, 2.7, 7.0);
  };
  const auto across = [&](const test::Paint& paint) {
    return std::sqrt(
        find(road, paint, dashes()).covariance(detail::kTiltAcross, detail::kTiltAcross));
  };
  EXPECT_GT(across(one), 0.03);  // little less than the prior's 0.05
  EXPECT_LT(across(two), 0.5 * across(one));
}

TEST(MarkedRoad, AKnownLaneWidthNarrowsTheHeight) {
  const Plane road = road_of(1.5, 0.0, 0.0);
  const test::Paint paint = [](double x, double z) {
    return test::dashed(x, z, -1.5, 7.0) || std::abs(x - 1.75) < 0.06;
  };
  LaneMarkingSizes known = dashes();
  known.lane_width = 3.25;
  const MarkedRoad without = find(road, paint, dashes()), with = find(road, paint, known);
  ASSERT_EQ(without.status, Status::kOk) << without.reason;
  ASSERT_EQ(with.status, Status::kOk) << with.reason;
  EXPECT_LT(with.ego().covariance(2, 2), without.ego().covariance(2, 2));
  EXPECT_NEAR(with.ego().plane.offset, 1.5, 3.0 * std::sqrt(with.ego().covariance(2, 2)));
}

TEST(MarkedRoad, WithoutMarkingsOrWithOthersItSaysWhatIsMissing) {
  const Plane road = road_of(1.65, 0.0, 0.0);
  const MarkedRoad bare = find(
      road, [](double, double) { return false; }, dashes());
  EXPECT_EQ(bare.status, Status::kFailed);
  EXPECT_FALSE(bare.reason.empty());
  const MarkedRoad unknown = find(
      road, [](double x, double z) { return test::dashed(x, z, -1.5, 7.0); }, LaneMarkingSizes());
  EXPECT_EQ(unknown.status, Status::kFailed);
  EXPECT_THAT(unknown.reason, HasSubstr("markings_m"));
  const MarkedRoad line = find(
      road, [](double x, double) { return std::abs(x + 1.5) < 0.06; }, dashes());
  EXPECT_EQ(line.status, Status::kFailed) << "a line without ends has no length";
}

TEST(MarkedRoad, TheSameForAnyNumberOfThreads) {
  const Plane road = road_of(1.5, 0.02, 0.0);
  const test::Paint paint = [](double x, double z) { return test::dashed(x, z, -1.0, 7.0); };
  const MarkedRoad one = find(road, paint, dashes(), 1), four = find(road, paint, dashes(), 4);
  EXPECT_EQ(one.shape, four.shape);
  EXPECT_EQ(one.covariance, four.covariance);
}

TEST(MarkedRoad, ACalculatedRayMeetsTheBentRoad) {
  detail::RoadShapeVector x;
  x << 0.02, -0.03, std::log(1.6), 0.004, 1e-4, 5e-4, 3e-3;
  const detail::RoadShape road({0.0, -1.0, 0.0}, x);
  for (const Eigen::Vector2d& pixel : {Eigen::Vector2d(480, 390), Eigen::Vector2d(620, 260)}) {
    const Eigen::Vector3d p = road.point(kCamera.ray(pixel));
    ASSERT_TRUE(p.allFinite());
    const double s = p.dot(road.ahead()), r = p.dot(road.right());
    const double rise =
        0.5 * x[3] * s * s + x[4] * s * s * s / 6.0 + x[5] * s * r + 0.5 * x[6] * r * r;
    EXPECT_NEAR(road.normal().dot(p) + road.height(), rise, 1e-6);
  }
  detail::RoadShapeVector level = detail::RoadShapeVector::Zero();
  level[detail::kLogHeight] = std::log(1.6);
  const detail::RoadShape flat({0.0, -1.0, 0.0}, level);
  EXPECT_FALSE(std::isfinite(flat.depth(kCamera.ray({500, 5}))));  // the sky
}

TEST(MarkedRoad, OptionsAreChecked) {
  MarkedRoadOptions options;
  options.curvature = 0.0;
  EXPECT_THROW(find_marked_road(kCamera, {}, dashes(), options), std::invalid_argument);
}

}  // namespace
}  // namespace camber
