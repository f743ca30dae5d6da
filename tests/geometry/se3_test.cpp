#include "camber/geometry/se3.h"

#include <gtest/gtest.h>

#include <cmath>

#include "camber/core/random.h"

namespace camber {
namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr double kRounding = 1e-13;  // a few operations on numbers near 1 to 10

Eigen::Vector3d random_vector(std::uint64_t index, double size) {
  const CounterRandom random(17);
  return {random.uniform(3 * index, -size, size), random.uniform(3 * index + 1, -size, size),
          random.uniform(3 * index + 2, -size, size)};
}

SE3 random_pose(std::uint64_t index) {
  return {rotation_from_vector(random_vector(2 * index, 3.0)), random_vector(2 * index + 1, 10.0)};
}

void expect_near(const SE3& a, const SE3& b) {
  EXPECT_LT((a.matrix() - b.matrix()).cwiseAbs().maxCoeff(), 10.0 * kRounding);
}

TEST(SE3, GroupLaws) {
  const SE3 identity;
  for (std::uint64_t i = 0; i < 50; ++i) {
    const SE3 a = random_pose(3 * i), b = random_pose(3 * i + 1), c = random_pose(3 * i + 2);
    const Eigen::Vector3d x = random_vector(1000 + i, 5.0);
    expect_near((a * b) * c, a * (b * c));
    expect_near(a * a.inverse(), identity);
    expect_near(a.inverse() * a, identity);
    expect_near(a * identity, a);
    expect_near((a * b).inverse(), b.inverse() * a.inverse());
    EXPECT_LT(((a * b) * x - a * (b * x)).norm(), 10.0 * kRounding);
    EXPECT_LT((a.inverse() * (a * x) - x).norm(), 10.0 * kRounding);
  }
}

TEST(SE3, AgreesWithItsMatrix) {
  for (std::uint64_t i = 0; i < 20; ++i) {
    const SE3 a = random_pose(i), b = random_pose(100 + i);
    const Eigen::Vector3d x = random_vector(500 + i, 5.0);
    EXPECT_LT(((a.matrix() * x.homogeneous()).head<3>() - a * x).norm(), 10.0 * kRounding);
    EXPECT_LT((a.matrix() * b.matrix() - (a * b).matrix()).norm(), 10.0 * kRounding);
    expect_near(SE3::from_matrix(a.matrix()), a);
    expect_near(SE3(a.rotation_matrix(), a.translation()), a);
  }
}

TEST(SE3, StoresQuaternionThenTranslation) {
  SE3 pose(Eigen::Quaterniond(Eigen::AngleAxisd(kPi / 2, Eigen::Vector3d::UnitZ())), {1, 2, 3});
  const double expected[] = {0, 0, std::sqrt(0.5), std::sqrt(0.5), 1, 2, 3};
  for (int i = 0; i < 7; ++i) EXPECT_NEAR(pose.data()[i], expected[i], 1e-15);
  EXPECT_LT((pose * Eigen::Vector3d(1, 0, 0) - Eigen::Vector3d(1, 3, 3)).norm(), 1e-15);
  pose.set_translation({4, 5, 6});
  EXPECT_EQ(pose.translation(), Eigen::Vector3d(4, 5, 6));
  // A quaternion of another length is a rotation nevertheless.
  const SE3 scaled(Eigen::Quaterniond(2, 0, 0, 0), Eigen::Vector3d::Zero());
  EXPECT_EQ(scaled.rotation_matrix(), Eigen::Matrix3d::Identity());
}

TEST(RotationVector, IsInvertedByItsLogarithm) {
  for (std::uint64_t i = 0; i < 100; ++i) {
    const Eigen::Vector3d v = random_vector(i, 1.7);  // shorter than pi
    EXPECT_LT((rotation_to_vector(rotation_from_vector(v)) - v).norm(), kRounding);
    Eigen::Quaterniond opposite = rotation_from_vector(v);
    opposite.coeffs() *= -1.0;
    EXPECT_LT((rotation_to_vector(opposite) - v).norm(), kRounding);
  }
  for (const double size : {0.0, 1e-300, 1e-13, 1e-9, 1e-4}) {
    const Eigen::Vector3d v(size, -size, 0.5 * size);
    EXPECT_LT((rotation_to_vector(rotation_from_vector(v)) - v).norm(), 1e-16 + 1e-12 * size)
        << size;
  }
  // Longer than pi: the same rotation the other way round.
  const Eigen::Vector3d back = rotation_to_vector(rotation_from_vector({0, 0, 2 * kPi - 1.0}));
  EXPECT_LT((back - Eigen::Vector3d(0, 0, -1)).norm(), 1e-14);
}

TEST(RotationVector, IsTheExponentialOfTheSkewMatrix) {
  for (std::uint64_t i = 0; i < 20; ++i) {
    const Eigen::Vector3d v = random_vector(i, 0.5);
    Eigen::Matrix3d term = Eigen::Matrix3d::Identity(), sum = term;
    for (int k = 1; k < 25; ++k) {
      term = term * skew(v) / k;
      sum += term;
    }
    EXPECT_LT((rotation_from_vector(v).toRotationMatrix() - sum).norm(), kRounding);
    const Eigen::Vector3d w = random_vector(100 + i, 2.0);
    EXPECT_LT((skew(v) * w - v.cross(w)).norm(), 1e-15);
  }
}

}  // namespace
}  // namespace camber
