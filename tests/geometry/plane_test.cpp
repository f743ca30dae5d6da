#include "camber/geometry/plane.h"

#include <gtest/gtest.h>

#include <cmath>

#include "camber/core/random.h"

namespace camber {
namespace {

constexpr double kPi = 3.14159265358979323846;

Eigen::Vector3d random_vector(std::uint64_t index, double size) {
  const CounterRandom random(23);
  return {random.uniform(3 * index, -size, size), random.uniform(3 * index + 1, -size, size),
          random.uniform(3 * index + 2, -size, size)};
}

TEST(Plane, FlatRoadUnderALevelCamera) {
  const Plane road{{0, -1, 0}, 1.65};  // the camera is 1.65 m above it
  EXPECT_DOUBLE_EQ(road.signed_distance({0, 0, 0}), 1.65);
  EXPECT_DOUBLE_EQ(road.signed_distance({3, 1.65, 20}), 0.0);
  EXPECT_DOUBLE_EQ(road.signed_distance({3, 2.0, 20}), -0.35);
  EXPECT_EQ(road.foot({3, 0, 20}), Eigen::Vector3d(3, 1.65, 20));
  const auto hit = road.intersect_ray({0.1, 0.165, 1.0});
  ASSERT_TRUE(hit.has_value());
  EXPECT_LT((*hit - Eigen::Vector3d(1.0, 1.65, 10.0)).norm(), 1e-14);
  EXPECT_FALSE(road.intersect_ray({0, 0, 1}).has_value());     // along the road
  EXPECT_FALSE(road.intersect_ray({0, -0.1, 1}).has_value());  // into the sky
}

TEST(Plane, OrientedFlipsBothOrNothing) {
  const Plane plane{{0, 0, 1}, -2.0};
  const Plane same = plane.oriented({0.1, 0, 5}), flipped = plane.oriented({0, 0, -1});
  EXPECT_EQ(same.normal, plane.normal);
  EXPECT_EQ(same.offset, -2.0);
  EXPECT_EQ(flipped.normal, Eigen::Vector3d(0, 0, -1));
  EXPECT_EQ(flipped.offset, 2.0);
}

TEST(Plane, MovesWithItsPoints) {
  for (std::uint64_t i = 0; i < 30; ++i) {
    const Plane plane =
        Plane::through(random_vector(4 * i, 10), random_vector(4 * i + 1, 1).normalized());
    const SE3 b_from_a(rotation_from_vector(random_vector(4 * i + 2, 3)),
                       random_vector(4 * i + 3, 20));
    const Plane moved = plane.transformed(b_from_a);
    const Eigen::Vector3d x = random_vector(1000 + i, 10);
    EXPECT_NEAR(moved.signed_distance(b_from_a * x), plane.signed_distance(x), 1e-12);
    EXPECT_NEAR(moved.normal.norm(), 1.0, 1e-14);
  }
}

UncertainPlane random_plane(std::uint64_t i) {
  UncertainPlane out;
  const Eigen::Vector3d normal = random_vector(10 * i, 1).normalized();
  out.centroid = random_vector(10 * i + 1, 10);
  out.plane = Plane::through(out.centroid, normal);
  UncertainPlane::make_axes(normal, random_vector(10 * i + 2, 1), &out.axis1, &out.axis2);
  const Eigen::Matrix3d a =
      0.01 * Eigen::Matrix3d::Identity() +
      0.005 * random_vector(10 * i + 3, 1) * random_vector(10 * i + 4, 1).transpose();
  out.covariance = a * a.transpose();
  return out;
}

TEST(UncertainPlane, AxesAreARightHandedFrame) {
  for (std::uint64_t i = 0; i < 30; ++i) {
    const UncertainPlane p = random_plane(i);
    EXPECT_LT((p.axis1.cross(p.axis2) - p.plane.normal).norm(), 1e-13);
    EXPECT_NEAR(p.axis1.norm(), 1.0, 1e-14);
    EXPECT_NEAR(p.axis1.dot(p.plane.normal), 0.0, 1e-14);
  }
  // A road ahead of a camera: axis1 along the road.
  Eigen::Vector3d axis1, axis2;
  UncertainPlane::make_axes({0, -1, 0}, {0, 0.3, 1}, &axis1, &axis2);
  EXPECT_LT((axis1 - Eigen::Vector3d(0, 0, 1)).norm(), 1e-15);
  EXPECT_LT((axis2 - Eigen::Vector3d(-1, 0, 0)).norm(), 1e-15);
  // No direction in the plane to follow.
  for (const Eigen::Vector3d& along : {Eigen::Vector3d(0, -1, 0), Eigen::Vector3d(0, 0, 0)}) {
    UncertainPlane::make_axes({0, -1, 0}, along, &axis1, &axis2);
    EXPECT_NEAR(axis1.norm(), 1.0, 1e-14);
    EXPECT_NEAR(axis1.y(), 0.0, 1e-14);
    EXPECT_LT((axis1.cross(axis2) - Eigen::Vector3d(0, -1, 0)).norm(), 1e-14);
  }
}

TEST(UncertainPlane, HeightJacobianAgreesWithPerturbedByFiniteDifferences) {
  constexpr double kStep = 1e-5;
  for (std::uint64_t i = 0; i < 30; ++i) {
    const UncertainPlane p = random_plane(i);
    // A place on the plane, up to 20 m from the centroid.
    const Eigen::Vector3d x = p.plane.foot(p.centroid + random_vector(500 + i, 20));
    const Eigen::RowVector3d jacobian = p.height_jacobian(x);
    for (int k = 0; k < 3; ++k) {
      Eigen::Vector3d change = Eigen::Vector3d::Zero();
      const auto height = [&](double step) {
        change[k] = step;
        // The perturbed plane's height above x, measured along the old normal.
        const Plane moved = p.perturbed(change);
        return -moved.signed_distance(x) / moved.normal.dot(p.plane.normal);
      };
      const double numeric = (height(kStep) - height(-kStep)) / (2.0 * kStep);
      // Central differences: kStep^2 times the third derivative, at most 20 m, and rounding.
      EXPECT_NEAR(jacobian[k], numeric, 1e-8) << k;
    }
  }
}

TEST(UncertainPlane, PerturbedTurnsTheNormalAsItsCommentSays) {
  const UncertainPlane p = random_plane(3);
  EXPECT_LT((p.perturbed({0, 0, 0}).normal - p.plane.normal).norm(), 1e-15);
  EXPECT_NEAR(p.perturbed({0, 0, 0}).offset, p.plane.offset, 1e-13);
  const Eigen::Vector3d small(1e-4, -2e-4, 0.0);
  const Eigen::Vector3d tilt = small.x() * p.axis1 + small.y() * p.axis2;
  const Eigen::Vector3d expected = p.plane.normal + tilt.cross(p.plane.normal);
  EXPECT_LT((p.perturbed(small).normal - expected).norm(), 1e-7);  // second order: 2.5e-8
  EXPECT_NEAR(p.perturbed(small).signed_distance(p.centroid), 0.0, 1e-12);
  EXPECT_NEAR(p.perturbed({0, 0, 0.25}).signed_distance(p.centroid), -0.25, 1e-12);
  EXPECT_NEAR(angle_between(p.perturbed({0.1, 0, 0}).normal, p.plane.normal), 0.1, 1e-12);
}

TEST(UncertainPlane, HeightVarianceIsThatOfDrawnPlanes) {
  const UncertainPlane p = random_plane(5);
  const Eigen::Matrix3d root = p.covariance.llt().matrixL();
  const Eigen::Vector3d x = p.plane.foot(p.centroid + Eigen::Vector3d(3, -4, 5));
  const CounterRandom random(31);
  double squares = 0.0;
  constexpr std::uint64_t kDraws = 20000;
  for (std::uint64_t i = 0; i < kDraws; ++i) {
    const Eigen::Vector3d drawn(random.normal(3 * i), random.normal(3 * i + 1),
                                random.normal(3 * i + 2));
    const double height = p.perturbed(root * drawn).signed_distance(x);
    squares += height * height;
  }
  // Four standard deviations of a variance over 20,000 draws are 4 %; the rest is second order.
  EXPECT_NEAR(squares / kDraws / p.height_variance(x), 1.0, 0.05);
}

TEST(UncertainPlane, MovesWithItsUncertainty) {
  const UncertainPlane p = random_plane(7);
  const SE3 b_from_a(rotation_from_vector({0.3, -1.2, 0.5}), {5, -7, 2});
  const UncertainPlane moved = p.transformed(b_from_a);
  const Eigen::Vector3d x = p.plane.foot(random_vector(900, 10));
  EXPECT_NEAR(moved.height_variance(b_from_a * x), p.height_variance(x), 1e-12);
  const Eigen::Vector3d change(0.01, 0.02, 0.03);
  const Plane a = moved.perturbed(change), b = p.perturbed(change).transformed(b_from_a);
  EXPECT_LT((a.normal - b.normal).norm(), 1e-13);
  EXPECT_NEAR(a.offset, b.offset, 1e-12);
}

TEST(AngleBetween, IsExactForSmallAndLargeAngles) {
  EXPECT_NEAR(angle_between({1, 0, 0}, {std::cos(1e-9), std::sin(1e-9), 0}), 1e-9, 1e-20);
  EXPECT_NEAR(angle_between({2, 0, 0}, {-3, 0, 0}), kPi, 1e-15);
  EXPECT_NEAR(angle_between({0, 2, 0}, {0, 0, 5}), kPi / 2, 1e-15);
}

}  // namespace
}  // namespace camber
