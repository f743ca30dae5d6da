// The tangent plane of the road under the camera, from points that begin metres ahead.

#include "camber/scale/ego_plane.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <stdexcept>

#include "camber/core/random.h"
#include "camber/geometry/se3.h"

namespace camber {
namespace {

using ::testing::HasSubstr;

constexpr double kHeight = 1.65;  // m

/// Points of a road whose height over the tangent under the camera is rise(z), 5 to 30 m ahead, as
/// a camera sees them: relative errors of distance that grow with it.
/// @param unit  metres of one unit of the result.
RoadPoints make_road(const std::function<double(double)>& rise, double unit, double noise,
                     std::uint64_t seed) {
  RoadPoints out;
  const CounterRandom random(seed);
  std::uint64_t index = 0;
  for (double z = 5.0; z < 30.0; z *= 1.01) {
    for (double x = -2.4; x <= 2.4; x += 0.4) {
      const double relative = 0.002 * z;
      const double share = 1.0 + noise * relative * random.normal(index++);
      out.points.push_back(share / unit * Eigen::Vector3d(x, kHeight - rise(z), z));
      out.relative_sigma.push_back(relative);
    }
  }
  return out;
}

const Eigen::Vector3d kTravel(0, 0, 1), kUp(0, -1, 0);

EgoPlaneOptions independent() {
  EgoPlaneOptions options;
  options.correlation = 1.0;  // the noise made here is
  return options;
}

double flat(double) { return 0.0; }

/// Straight for 3 m, then a bend of some radius, m.
double bend_of(double radius, double z) {
  return z < 3.0 ? 0.0 : radius - std::sqrt(radius * radius - (z - 3.0) * (z - 3.0));
}
double bend(double z) { return bend_of(60.0, z); }
/// As sharp as the prior of curvature (0.007 / m) expects of a road.
double usual_bend(double z) { return bend_of(140.0, z); }

TEST(FitEgoPlane, OnAFlatRoadHeightAndScaleAreExact) {
  for (const double unit : {1.0, 0.93, 4.0}) {
    SCOPED_TRACE(unit);
    const EgoPlane found =
        fit_ego_plane(make_road(flat, unit, 0.0, 1), kTravel, kUp, {}, independent());
    ASSERT_EQ(found.status, Status::kOk) << found.reason;
    EXPECT_NEAR(found.height, kHeight / unit, 1e-5 * kHeight / unit);
    EXPECT_NEAR(found.metres_per_baseline, unit, 1e-5 * unit);
    EXPECT_NEAR(found.near_plane_height, kHeight / unit, 1e-5 * kHeight / unit);
    EXPECT_LT(angle_between(found.plane.plane.normal, kUp), 1e-5);
    EXPECT_NEAR(found.plane.plane.offset, found.height, 1e-9);
    EXPECT_LT((found.plane.centroid - Eigen::Vector3d(0, kHeight / unit, 0)).norm(), 1e-4 / unit);
    ASSERT_GT(found.line.size(), 15u);
    for (const Eigen::Vector3d& p : found.line) EXPECT_NEAR(p.y() * unit, kHeight, 1e-3);
    EXPECT_GT(found.points, 1000);
  }
}

TEST(FitEgoPlane, TurnsWithTheCamera) {
  const SE3 camera_from_road(rotation_from_vector({0.15, -0.1, 0.2}), Eigen::Vector3d::Zero());
  RoadPoints road = make_road(bend, 1.0, 0.0, 1);
  for (const double z : {-1.6, -0.8, 0.8, 1.6}) road.camera_path.emplace_back(0.0, 0.002 * z, z);
  const EgoPlane level = fit_ego_plane(road, kTravel, kUp, {}, {});
  for (Eigen::Vector3d& p : road.points) p = camera_from_road * p;
  for (Eigen::Vector3d& p : road.camera_path) p = camera_from_road * p;
  const EgoPlane turned =
      fit_ego_plane(road, camera_from_road * kTravel, camera_from_road * kUp, {}, {});
  ASSERT_NE(turned.status, Status::kFailed) << turned.reason;
  // The same sums in other axes: rounding alone.
  EXPECT_NEAR(turned.height, level.height, 1e-6);
  EXPECT_LT(angle_between(turned.plane.plane.normal, camera_from_road * level.plane.plane.normal),
            1e-6);
  EXPECT_NEAR(turned.relative_sigma, level.relative_sigma, 1e-6);
}

TEST(FitEgoPlane, ASharpBendIsBetterThanANearPlane) {
  const EgoPlane found = fit_ego_plane(make_road(bend, 1.0, 1.0, 1), kTravel, kUp, {}, {});
  ASSERT_NE(found.status, Status::kFailed) << found.reason;
  // The near plane is 0.4 m off. A bend that begins at once with more than twice the curvature that
  // the prior expects keeps a share of that.
  EXPECT_GT(std::abs(found.near_plane_height - kHeight), 0.3);
  EXPECT_LT(std::abs(found.height - kHeight), 0.3 * std::abs(found.near_plane_height - kHeight));
}

TEST(FitEgoPlane, AUsualBendIsCarriedBackWithinItsStatedError) {
  double squares = 0.0;
  constexpr int kTrials = 20;
  for (int trial = 0; trial < kTrials; ++trial) {
    const EgoPlane found =
        fit_ego_plane(make_road(usual_bend, 1.0, 1.0, static_cast<std::uint64_t>(trial)), kTravel,
                      kUp, {}, EgoPlaneOptions());
    ASSERT_NE(found.status, Status::kFailed) << found.reason;
    const double error = found.height - kHeight;
    // A plane through the first 6 m that are seen passes far above or below the foot.
    EXPECT_LT(std::abs(error), 0.5 * std::abs(found.near_plane_height - kHeight));
    const double sigma = std::sqrt(found.plane.covariance(2, 2));
    squares += error * error / (sigma * sigma) / kTrials;
    EXPECT_GT(sigma, 1e-3);
  }
  // Within two stated standard deviations.
  EXPECT_LT(std::sqrt(squares), 2.0);
}

/// Where the camera is, kHeight above the road, 1 and 2 m
/// behind and ahead, risen and fallen by `bounce`, m.
std::vector<Eigen::Vector3d> camera_path(const std::function<double(double)>& rise, double unit,
                                         double bounce, std::uint64_t seed) {
  std::vector<Eigen::Vector3d> out;
  const CounterRandom random(seed);
  for (const double z : {-2.0, -1.0, 1.0, 2.0}) {
    const double slope = (rise(z + 0.01) - rise(z - 0.01)) / 0.02;
    const Eigen::Vector3d up = Eigen::Vector3d(0, -1, -slope).normalized();
    const Eigen::Vector3d road(0, kHeight - rise(z), z);
    out.push_back((road + (kHeight + bounce * random.normal(out.size())) * up) / unit);
  }
  return out;
}

// Straight below the camera, bent where the road is first seen: only the way that the camera itself
// takes over the road between says where the bend begins.
TEST(FitEgoPlane, TheCamerasWayTellsOfTheRoadThatIsPassedUnseen) {
  for (const double unit : {1.0, 0.8}) {
    SCOPED_TRACE(unit);
    double without = 0.0, with = 0.0, stated = 0.0, sigma_without = 0.0, sigma_with = 0.0;
    constexpr int kTrials = 20;
    for (int trial = 0; trial < kTrials; ++trial) {
      const auto seed = static_cast<std::uint64_t>(trial);
      RoadPoints road = make_road(usual_bend, unit, 1.0, seed);
      const std::vector<Eigen::Vector3d> way = camera_path(usual_bend, unit, 0.003, seed + 100);
      const Eigen::Vector3d travel = (way[2] - way[1]).normalized();
      const EgoPlane alone = fit_ego_plane(road, travel, kUp, {}, {});
      road.camera_path = way;
      const EgoPlane found = fit_ego_plane(road, travel, kUp, {}, {});
      ASSERT_NE(found.status, Status::kFailed) << found.reason;
      sigma_without += alone.relative_sigma / kTrials;
      sigma_with += found.relative_sigma / kTrials;
      without += std::pow(alone.height * unit / kHeight - 1.0, 2) / kTrials;
      const double error = found.height * unit / kHeight - 1.0;
      with += error * error / kTrials;
      stated += std::pow(error / found.relative_sigma, 2) / kTrials;
    }
    EXPECT_LT(sigma_with, 0.9 * sigma_without);
    EXPECT_LT(std::sqrt(with), 0.75 * std::sqrt(without));  // 0.63 measured
    EXPECT_LT(std::sqrt(with), 0.016);                      // 0.013 measured
    EXPECT_LT(std::sqrt(stated), 1.3);                      // 0.81 measured
  }
}

TEST(FitEgoPlane, AWayThatSaysNothingChangesNothing) {
  RoadPoints road = make_road(flat, 1.0, 0.0, 1);
  road.camera_path = camera_path(flat, 1.0, 0.0, 1);
  // Far away and beside the way: not of this road.
  road.camera_path.emplace_back(0.0, 1.0, 200.0);
  road.camera_path.emplace_back(30.0, 0.0, 3.0);
  road.camera_path.emplace_back(0.0, 0.001, 0.0001);  // standing: says nothing
  const EgoPlane found = fit_ego_plane(road, kTravel, kUp, {}, independent());
  ASSERT_EQ(found.status, Status::kOk) << found.reason;
  EXPECT_NEAR(found.height, kHeight, 1e-5);
  ASSERT_FALSE(found.line.empty());
  EXPECT_NEAR(found.line.front().z(), 0.0,
              1e-9);  // the foot, however far behind the profile begins
}

TEST(FitEgoPlane, CrestsWorkTheSameWay) {
  const auto crest = [](double z) { return z < 3.0 ? 0.0 : -(z - 3.0) * (z - 3.0) / 240.0; };
  const EgoPlane found =
      fit_ego_plane(make_road(crest, 1.0, 0.0, 1), kTravel, kUp, {}, independent());
  ASSERT_NE(found.status, Status::kFailed) << found.reason;
  EXPECT_LT(std::abs(found.height - kHeight), 0.5 * std::abs(found.near_plane_height - kHeight));
}

TEST(FitEgoPlane, ARoadThatRisesAtOnceHasAPlaneUnderTheCamera) {
  for (const double radius : {30.0, 40.0, 50.0}) {  // a plane through it passes above the camera
    const auto hill = [&](double z) {
      return std::min(radius - std::sqrt(std::max(0.0, radius * radius - z * z)), 0.3 * z);
    };
    const EgoPlane found = fit_ego_plane(make_road(hill, 1.0, 1.0, 1), kTravel, kUp, {}, {});
    ASSERT_NE(found.status, Status::kFailed) << radius << " " << found.reason;
    EXPECT_NEAR(found.height, kHeight, 2.0 * found.relative_sigma * kHeight) << radius;
    EXPECT_LT(found.relative_sigma, 0.04) << radius;
  }
}

TEST(FitEgoPlane, NearPointsOnAnotherLayerAreLeftOut) {
  RoadPoints road = make_road(flat, 1.0, 1.0, 1);
  for (Eigen::Vector3d& p : road.points) {
    if (p.z() < 6.0) p /= 1.4;
  }
  const EgoPlane found = fit_ego_plane(road, kTravel, kUp, {}, {});
  ASSERT_NE(found.status, Status::kFailed) << found.reason;
  EXPECT_NEAR(found.height, kHeight, 2.0 * found.relative_sigma * kHeight);
  EXPECT_LT(found.points, 0.95 * found.compared);
}

TEST(FitEgoPlane, ABendWhoseBeginIsNotSeenIsInTheStatedError) {
  EgoPlaneOptions without;
  without.bend_share = 0.0;
  const RoadPoints road = make_road(usual_bend, 1.0, 0.0, 1);
  const EgoPlane found = fit_ego_plane(road, kTravel, kUp, {}, {});
  const double own = fit_ego_plane(road, kTravel, kUp, {}, without).relative_sigma;
  const double bend = std::log(found.near_plane_height / found.height);
  EXPECT_NEAR(found.relative_sigma, std::hypot(own, EgoPlaneOptions().bend_share * bend), 1e-4);
  EXPECT_GT(found.relative_sigma, 1.02 * own);
}

TEST(FitEgoPlane, GrossErrorsDoNotMatter) {
  RoadPoints road = make_road(flat, 1.0, 1.0, 7);
  const CounterRandom random(8);
  for (std::size_t i = 0; i < road.points.size(); ++i) {
    if (random.uniform(2 * i) < 0.15) road.points[i] *= random.uniform(2 * i + 1, 0.5, 0.85);
  }
  const EgoPlane found = fit_ego_plane(road, kTravel, kUp, {}, independent());
  ASSERT_NE(found.status, Status::kFailed) << found.reason;
  // 1 % of 1.65 m; without the 15 % the noise leaves a few millimetres.
  EXPECT_NEAR(found.height, kHeight, 0.017);
}

TEST(FitEgoPlane, SharedErrorsWidenTheHeight) {
  RoadPoints road = make_road(flat, 1.0, 0.0, 1);
  road.shared_jacobian.setOnes(static_cast<Eigen::Index>(road.points.size()), 1);  // log scale
  const EgoPlane alone = fit_ego_plane(road, kTravel, kUp, {}, independent());
  const EgoPlane with = fit_ego_plane(road, kTravel, kUp,
                                      Eigen::MatrixXd::Constant(1, 1, 0.03 * 0.03), independent());
  EXPECT_EQ(alone.height, with.height);
  const double added = with.plane.covariance(2, 2) - alone.plane.covariance(2, 2);
  EXPECT_NEAR(std::sqrt(added), 0.03 * kHeight, 0.003 * kHeight);
  EXPECT_GT(with.relative_sigma, alone.relative_sigma);
}

TEST(FitEgoPlane, TooFewPointsSaySo) {
  RoadPoints few = make_road(flat, 1.0, 0.0, 1);
  few.points.resize(29);
  few.relative_sigma.resize(29);
  EgoPlane found = fit_ego_plane(few, kTravel, kUp, {}, {});
  EXPECT_EQ(found.status, Status::kFailed);
  EXPECT_THAT(found.reason, HasSubstr("too few road points: 29"));
  RoadPoints above = make_road(flat, 1.0, 0.0, 1);
  for (Eigen::Vector3d& p : above.points) p.y() = -p.y();
  found = fit_ego_plane(above, kTravel, kUp, {}, {});
  EXPECT_EQ(found.status, Status::kFailed);
  EXPECT_THAT(found.reason, HasSubstr("below the camera"));
  EXPECT_EQ(fit_ego_plane({}, kTravel, kUp, {}, {}).status, Status::kFailed);
}

TEST(FitEgoPlane, ARolledMountingIsSeenOnTheRoadAhead) {
  for (const double roll : {0.035, -0.07, 0.14}) {
    const Eigen::Quaterniond rolled = rotation_from_vector(Eigen::Vector3d(0.0, 0.0, roll));
    RoadPoints road = make_road(flat, 1.0, 0.5, 5);
    for (Eigen::Vector3d& p : road.points) p = rolled * p;
    const EgoPlane ego = fit_ego_plane(road, kTravel, kUp, Eigen::MatrixXd(), independent());
    ASSERT_EQ(ego.status, Status::kOk) << ego.reason;
    const double off = angle_between(ego.plane.plane.normal, rolled * kUp);
    EXPECT_LT(off, 0.2 * std::abs(roll));
    EXPECT_LT(off, 2.0 * std::sqrt(ego.plane.covariance(0, 0)));
    EXPECT_LT(std::sqrt(ego.plane.covariance(0, 0)), 0.015);
    EXPECT_NEAR(ego.height, kHeight, 0.01 * kHeight);
  }
}

// Mountings of any roll over roads that twist before they are seen: neither the road nor the habit
// of mounting cameras level is trusted more than both together deserve.
TEST(FitEgoPlane, TheStatedErrorOfTheCrossSlopeHoldsForRolledMountings) {
  constexpr int kCount = 60;
  constexpr double kRolled = 0.03;  // rad, standard deviation
  const EgoPlaneOptions options;
  int inside = 0;
  double spread = 0.0;  // rad
  for (int i = 0; i < kCount; ++i) {
    const CounterRandom random(1000 + i);
    const double roll = kRolled * random.normal(0);
    RoadPoints road = make_road(flat, 1.0, 0.5, i);
    std::vector<double> cross_slope = {0.0};  // every metre
    for (int z = 1; z <= 31; ++z) {
      cross_slope.push_back(cross_slope.back() + options.bank_walk * random.normal(z));
    }
    for (Eigen::Vector3d& p : road.points) {
      p.y() -= cross_slope[static_cast<std::size_t>(p.z())] * p.x();
      p = rotation_from_vector(Eigen::Vector3d(0.0, 0.0, roll)) * p;
    }
    const EgoPlane ego = fit_ego_plane(road, kTravel, kUp, Eigen::MatrixXd(), options);
    ASSERT_EQ(ego.status, Status::kOk) << ego.reason;
    const Eigen::Vector3d normal = ego.plane.plane.normal;
    const double error = std::atan2(normal.x(), -normal.y()) - roll;
    const double sigma = std::sqrt(ego.plane.covariance(0, 0));
    inside += std::abs(error) < 2.0 * sigma ? 1 : 0;
    spread += sigma / kCount;
  }
  EXPECT_GE(inside, 52);
  EXPECT_LT(spread, 0.012);
}

TEST(FitEgoPlane, PointsAtOneDistanceAreNoRoad) {
  RoadPoints road;
  for (int i = 0; i < 40; ++i) {
    road.points.emplace_back(-1.6 + 0.08 * i, 1.65, 10.0);
    road.relative_sigma.push_back(0.01);
  }
  const EgoPlane ego = fit_ego_plane(road, Eigen::Vector3d::UnitZ(), -Eigen::Vector3d::UnitY(),
                                     Eigen::MatrixXd(), EgoPlaneOptions());
  EXPECT_NE(ego.status, Status::kOk);
  EXPECT_NEAR(ego.height, 1.65, 2.0 * 1.65 * ego.relative_sigma);
}

TEST(EgoPlaneOptions, ValidateNamesTheField) {
  EgoPlaneOptions options;
  EXPECT_NO_THROW(options.validate());
  options.reach = 8.0;
  EXPECT_THROW(options.validate(), std::invalid_argument);
  options = {};
  options.camera_height = 0.0;
  EXPECT_THROW(fit_ego_plane(make_road(flat, 1.0, 0.0, 1), kTravel, kUp, {}, options),
               std::invalid_argument);
  options = {};
  options.correlation = std::nan("");
  EXPECT_THROW(options.validate(), std::invalid_argument);
}

}  // namespace
}  // namespace camber
