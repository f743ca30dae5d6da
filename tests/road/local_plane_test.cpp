// The plane under a vehicle from the field of the ground.

#include "camber/road/local_plane.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <memory>
#include <vector>

#include "support/made_road.h"

namespace camber {
namespace {

const PinholeCamera kCamera{640, 240, 400.0, 400.0, 320.0, 100.0};

/// Whose scale is known to 0.1 %.
RoadPosterior road_of(const Plane& plane) {
  GroundObservations observations;
  const Eigen::Vector3d m = -plane.normal / plane.offset;
  for (int v = 100; v < kCamera.height; v += 2) {
    for (int u = 0; u < kCamera.width; u += 4) {
      const double rho = m.dot(kCamera.ray(Eigen::Vector2d(u, v)));
      if (rho < 1.0 / 60.0) continue;
      observations.pixels.emplace_back(u, v);
      observations.inverse_depth.push_back(rho);
      observations.sigma.push_back(0.003);
    }
  }
  return test::road_posterior(
      std::make_shared<GroundField>(kCamera, observations, plane, GroundFieldOptions()), {}, 1.65,
      1.0, 0.001);
}

TEST(FitLocalPlane, FindsTheInclinedPlaneThatTheFieldIs) {
  const Plane truth{Eigen::Vector3d(0.04, -1.0, -0.08).normalized(), 1.65};
  const RoadPosterior road = road_of(truth);
  for (const Eigen::Vector2d& contact : {Eigen::Vector2d(320, 200), Eigen::Vector2d(150, 160),
                                         Eigen::Vector2d(420, 130), Eigen::Vector2d(330, 100)}) {
    const LocalPlane found = fit_local_plane(road, kCamera, contact, {});
    ASSERT_EQ(found.status, Status::kOk) << found.reason;
    // The field is that plane to 1e-6 of each inverse depth; a footprint of 4.3 m seen from 30 m
    // multiplies that by some hundred.
    EXPECT_LT(angle_between(found.plane.plane.normal, truth.normal), 1e-3);
    EXPECT_NEAR(truth.signed_distance(found.plane.centroid), 0.0, 1e-3);
    EXPECT_NEAR(found.plane.plane.signed_distance(found.plane.centroid), 0.0, 1e-9);
    EXPECT_GT(found.observed, 0.0);
    // The footprint lies behind the contact.
    const double depth = 1.0 / road.inverse_depth(contact);
    EXPECT_GT(found.plane.centroid.z(), depth);
    EXPECT_LT(found.plane.centroid.z(), depth + 4.3);
    EXPECT_GT(found.plane.axis1.z(), 0.9);
    EXPECT_GT(found.plane.covariance.determinant(), 0.0);
  }
}

TEST(FitLocalPlane, SupportIsThatOfItsPixels) {
  const RoadPosterior road = road_of({{0, -1, 0}, 1.65});
  std::size_t tangents = 0;
  for (double v = 104.0; v < 220.0; v += 2.0) {
    const LocalPlane found = fit_local_plane(road, kCamera, {320, v}, {});
    if (found.status != Status::kOk) continue;
    double sum = 0.0;
    for (const Eigen::Vector2d& pixel : found.pixels) sum += road.observed(pixel);
    EXPECT_NEAR(found.observed, sum / static_cast<double>(found.pixels.size()), 1e-12) << v;
    tangents += found.pixels.size() == 12 ? 1 : 0;
  }
  EXPECT_GT(tangents, 0u);  // of a far footprint
}

TEST(FitLocalPlane, AWallIsNoRoad) {
  // Leaning back by 40 degrees from upright, 12 m ahead.
  const Eigen::Vector3d normal = Eigen::Vector3d(0.0, -0.64, -0.77).normalized();
  const Plane wall = Plane::through({0.0, 1.0, 12.0}, normal);
  const RoadPosterior road = road_of(wall);
  const LocalPlane found = fit_local_plane(road, kCamera, {320, 140}, {});
  EXPECT_EQ(found.status, Status::kFailed);
  EXPECT_NE(found.reason.find("steep"), std::string::npos) << found.reason;
}

TEST(FitLocalPlane, FartherPlanesAreLessCertain) {
  const RoadPosterior road = road_of({{0, -1, 0}, 1.65});
  double before = 0.0;
  for (const double v : {200.0, 160.0, 130.0, 120.0}) {
    const LocalPlane found = fit_local_plane(road, kCamera, {320, v}, {});
    const double variance = found.plane.height_variance(found.plane.centroid);
    EXPECT_GT(variance, before);
    before = variance;
  }
}

TEST(JointCovariance, OwnCovariancesOnTheDiagonalAndNeighboursHangTogether) {
  const RoadPosterior road = road_of({{0, -1, 0}, 1.65});
  const LocalPlaneOptions options;
  std::vector<LocalPlane> planes;
  // Side by side and far away, then near.
  for (const Eigen::Vector2d& contact :
       {Eigen::Vector2d(300, 118), Eigen::Vector2d(330, 118), Eigen::Vector2d(320, 200)}) {
    planes.push_back(fit_local_plane(road, kCamera, contact, options));
    ASSERT_EQ(planes.back().status, Status::kOk);
  }
  const Eigen::MatrixXd joint = joint_covariance(road, planes, options);
  ASSERT_EQ(joint.rows(), 9);
  for (int i = 0; i < 3; ++i) {
    const Eigen::Matrix3d& own = planes[static_cast<std::size_t>(i)].plane.covariance;
    EXPECT_LT((joint.block<3, 3>(3 * i, 3 * i) - own).norm(), 1e-9 * own.norm()) << i;
  }
  EXPECT_LT((joint - joint.transpose()).norm(), 1e-12 * joint.norm());
  const auto correlation = [&](int i, int k) {
    return joint(3 * i + 2, 3 * k + 2) /
           std::sqrt(joint(3 * i + 2, 3 * i + 2) * joint(3 * k + 2, 3 * k + 2));
  };
  EXPECT_GT(correlation(0, 1), 0.3);
  EXPECT_LT(std::abs(correlation(0, 2)), correlation(0, 1));
}

TEST(FitLocalPlane, TheSkyIsNoGround) {
  const RoadPosterior road = road_of({Eigen::Vector3d(0, -1, 0), 1.65});
  const LocalPlane found = fit_local_plane(road, kCamera, {320, 20}, {});
  // Above its top the field goes on as its top row, 60 m away: the answer is that or none, and a
  // plane there is not certain.
  if (found.status != Status::kFailed) {
    EXPECT_GT(found.plane.height_variance(found.plane.centroid), 0.01);
  } else {
    EXPECT_NE(found.reason, "");
  }
}

TEST(PlaneFromInverseDepth, IsThePlaneAndItsCovarianceThatOfDifferences) {
  // Above the plane, and below it (a steep climb ahead).
  for (const double offset : {1.65, -0.8}) {
    SCOPED_TRACE(offset);
    const Plane truth{Eigen::Vector3d(0.05, -1.0, -0.1).normalized(), offset};
    const Eigen::Vector3d m = -truth.normal / truth.offset;
    const Eigen::Vector3d centroid = truth.foot({1.0, 1.0, 12.0});
    Eigen::Matrix3d root;
    root << 1e-4, 0, 0, 2e-5, 3e-4, 0, -1e-5, 5e-5, 1e-4;
    const Eigen::Matrix3d covariance = root * root.transpose();
    const UncertainPlane found = plane_from_inverse_depth(m, covariance, centroid);
    EXPECT_LT((found.plane.normal - truth.normal).norm(), 1e-12);
    EXPECT_NEAR(found.plane.offset, truth.offset, 1e-12);
    EXPECT_LT((found.axis1.cross(found.axis2) - found.plane.normal).norm(), 1e-12);

    // (tilt about axis1, tilt about axis2, height) of the plane of m + dm, numerically.
    const auto parameters = [&](const Eigen::Vector3d& changed) {
      const auto height = [&](const Eigen::Vector3d& x) {  // changed . (x + h n) = 1
        return (1.0 - changed.dot(x)) / changed.dot(truth.normal);
      };
      const double h = height(found.centroid);
      return Eigen::Vector3d(height(found.centroid + found.axis2) - h,
                             -(height(found.centroid + found.axis1) - h), h);
    };
    Eigen::Matrix3d jacobian;
    const double step = 1e-6;
    for (int k = 0; k < 3; ++k) {
      const Eigen::Vector3d d = step * Eigen::Vector3d::Unit(k);
      jacobian.col(k) = (parameters(m + d) - parameters(m - d)) / (2 * step);
    }
    const Eigen::Matrix3d expected = jacobian * covariance * jacobian.transpose();
    EXPECT_LT((found.covariance - expected).norm(), 1e-5 * expected.norm());

    // The parameters mean what UncertainPlane says: the plane moved by them is that of m + dm.
    const Eigen::Vector3d dm(2e-6, -3e-6, 1e-6);
    const Plane moved = found.perturbed(parameters(m + dm));
    const Plane direct = plane_from_inverse_depth(m + dm, covariance, centroid).plane;
    EXPECT_LT((moved.normal - direct.normal).norm(), 1e-8);
    EXPECT_NEAR(moved.offset, direct.offset, 1e-7);
  }
}

}  // namespace
}  // namespace camber
