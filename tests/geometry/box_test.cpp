#include "camber/geometry/box.h"

#include <gtest/gtest.h>

#include <cmath>

namespace camber {
namespace {

constexpr double kPi = 3.14159265358979323846;

TEST(Box2, SizesAndChanges) {
  const Box2 box{10, 20, 30, 60};
  EXPECT_EQ(box.width(), 20);
  EXPECT_EQ(box.height(), 40);
  EXPECT_EQ(box.area(), 800);
  EXPECT_EQ(box.center(), Eigen::Vector2d(20, 40));
  EXPECT_TRUE(box.contains({10, 60}));
  EXPECT_FALSE(box.contains({9.9, 60}));
  const Box2 half = box.scaled(0.5);
  EXPECT_EQ(half.x1, 15);
  EXPECT_EQ(half.y2, 50);
  EXPECT_EQ(half.center(), box.center());
  const Box2 grown = box.grown(2);
  EXPECT_EQ(grown.x1, 8);
  EXPECT_EQ(grown.y2, 62);
  EXPECT_EQ((Box2{5, 5, 3, 9}).area(), 0.0);
}

TEST(Box2, ClippedStaysOnPixelCentres) {
  const Box2 clipped = Box2{-5, 10, 2000, 400}.clipped(1242, 375);
  EXPECT_EQ(clipped.x1, 0);
  EXPECT_EQ(clipped.y1, 10);
  EXPECT_EQ(clipped.x2, 1241);
  EXPECT_EQ(clipped.y2, 374);
  EXPECT_EQ((Box2{-50, 10, -5, 40}).clipped(1242, 375).area(), 0.0);
}

TEST(IntersectionOverUnion, ByHand) {
  const Box2 a{0, 0, 4, 4};
  EXPECT_DOUBLE_EQ(intersection_over_union(a, a), 1.0);
  EXPECT_DOUBLE_EQ(intersection_over_union(a, {2, 0, 6, 4}), 8.0 / 24.0);
  EXPECT_DOUBLE_EQ(intersection_over_union(a, {1, 1, 2, 2}), 1.0 / 16.0);
  EXPECT_EQ(intersection_over_union(a, {4, 0, 8, 4}), 0.0);
  EXPECT_EQ(intersection_over_union(a, {9, 9, 9, 9}), 0.0);
  EXPECT_EQ(intersection_over_union({1, 1, 1, 1}, {1, 1, 1, 1}), 0.0);
}

TEST(RotationY, AgreesWithKitti) {
  // rotation_y 0: the front points to the camera's right; -pi / 2: away from the camera.
  EXPECT_LT((rotation_from_rotation_y(0).col(0) - Eigen::Vector3d(1, 0, 0)).norm(), 1e-15);
  EXPECT_LT((rotation_from_rotation_y(-kPi / 2).col(0) - Eigen::Vector3d(0, 0, 1)).norm(), 1e-15);
  for (double ry = -3.1; ry < 3.14; ry += 0.1) {
    const Eigen::Matrix3d r = rotation_from_rotation_y(ry);
    EXPECT_NEAR(rotation_y(r), ry, 1e-14);
    EXPECT_NEAR(r.determinant(), 1.0, 1e-14);
    EXPECT_LT((r.transpose() * r - Eigen::Matrix3d::Identity()).norm(), 1e-14);
    EXPECT_EQ(r.col(1), Eigen::Vector3d(0, -1, 0));
  }
}

TEST(OrientedBox, CornersAreOrderedAndAroundTheCentre) {
  OrientedBox box;
  box.dimensions = {4.0, 1.8, 1.5};
  // Seen from behind, 10 m ahead, on a road 1.65 m below the camera.
  box.camera_from_vehicle = SE3(rotation_from_rotation_y(-kPi / 2), {1.0, 1.65, 10.0});
  const Eigen::Matrix<double, 3, 8> corners = box.corners();
  EXPECT_LT((corners.col(0) - Eigen::Vector3d(0.1, 1.65, 12.0)).norm(), 1e-14);  // front left
  EXPECT_LT((corners.col(1) - Eigen::Vector3d(1.9, 1.65, 12.0)).norm(), 1e-14);  // front right
  EXPECT_LT((corners.col(2) - Eigen::Vector3d(1.9, 1.65, 8.0)).norm(), 1e-14);   // rear right
  EXPECT_LT((corners.col(3) - Eigen::Vector3d(0.1, 1.65, 8.0)).norm(), 1e-14);   // rear left
  EXPECT_LT((corners.col(4) - Eigen::Vector3d(0.1, 0.15, 12.0)).norm(), 1e-14);  // above front left
  EXPECT_LT((corners.rowwise().mean() - box.center()).norm(), 1e-14);
  EXPECT_LT((box.center() - Eigen::Vector3d(1.0, 0.9, 10.0)).norm(), 1e-14);
  EXPECT_EQ(box.bottom_center(), Eigen::Vector3d(1.0, 1.65, 10.0));
}

}  // namespace
}  // namespace camber
