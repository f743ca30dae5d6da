// Derivatives of the bundle adjustment's residuals against numeric ones, on the poses' manifold.

#include <ceres/ceres.h>
#include <ceres/gradient_checker.h>
#include <gtest/gtest.h>

#include <memory>
#include <vector>

#include "camber/core/random.h"
#include "camber/geometry/se3.h"
#include "camber/motion/cost_functions/baseline_length.h"
#include "camber/motion/cost_functions/inverse_depth_reprojection_error.h"
#include "motion/simulated_matches.h"

namespace camber {
namespace {

using PoseManifold =
    ceres::ProductManifold<ceres::EigenQuaternionManifold, ceres::EuclideanManifold<3>>;

// Extrapolated differences are good to about 1e-9 of the derivative; 1e-6 leaves room for their
// worst cases. Steps begin at 1e-4: Ceres's 1e-2 is a large share of an inverse depth.
constexpr double kRelative = 1e-6;

ceres::NumericDiffOptions small_steps() {
  ceres::NumericDiffOptions options;
  options.ridders_relative_initial_step_size = 1e-4;
  return options;
}

SE3 random_pose(const CounterRandom& random, std::uint64_t i) {
  const Eigen::Vector3d rotation(random.normal(10 * i), random.normal(10 * i + 1),
                                 random.normal(10 * i + 2));
  const Eigen::Vector3d translation(random.normal(10 * i + 3), random.normal(10 * i + 4),
                                    random.normal(10 * i + 5));
  return SE3(rotation_from_vector(0.1 * rotation), translation);
}

TEST(InverseDepthReprojectionError, DerivativesAgreeWithNumericOnes) {
  const PoseManifold pose_manifold;
  const std::vector<const ceres::Manifold*> manifolds = {&pose_manifold, nullptr};
  const PinholeCamera camera = test::small_camera();
  const CounterRandom random(1);
  for (std::uint64_t i = 0; i < 20; ++i) {
    const SE3 pose = random_pose(random, i);
    const Eigen::Vector2d from(random.uniform(3 * i, 0, 639), random.uniform(3 * i + 1, 0, 239));
    const double rho = random.uniform(3 * i + 2, 0.01, 0.2);
    const std::unique_ptr<ceres::CostFunction> cost(
        InverseDepthReprojectionError::create(camera, camera.ray(from), {300.0, 100.0}, 0.3));
    ceres::GradientChecker checker(cost.get(), &manifolds, small_steps());
    const double* parameters[] = {pose.data(), &rho};
    ceres::GradientChecker::ProbeResults results;
    EXPECT_TRUE(checker.Probe(parameters, kRelative, &results)) << results.error_log;
  }
}

TEST(InverseDepthReprojectionError, IsTheDistanceInTheImageInStandardDeviations) {
  const PinholeCamera camera = test::small_camera();
  const SE3 pose = test::driving_motion()[2];
  const Eigen::Vector3d ray = camera.ray({100.0, 200.0});
  const Eigen::Vector2d pixel = *camera.project(pose * Eigen::Vector3d(8.0 * ray));
  const std::unique_ptr<ceres::CostFunction> cost(
      InverseDepthReprojectionError::create(camera, ray, pixel - Eigen::Vector2d(1.0, -2.0), 0.5));
  const double rho = 1.0 / 8.0;
  const double* parameters[] = {pose.data(), &rho};
  double residual[2];
  ASSERT_TRUE(cost->Evaluate(parameters, residual, nullptr));
  EXPECT_NEAR(residual[0], 2.0, 1e-9);  // 1 px over 0.5 px
  EXPECT_NEAR(residual[1], -4.0, 1e-9);
}

TEST(InverseDepthReprojectionError, RefusesPointsBehindTheCamera) {
  const PinholeCamera camera = test::small_camera();
  const std::unique_ptr<ceres::CostFunction> cost(
      InverseDepthReprojectionError::create(camera, {0, 0, 1}, {0, 0}, 1.0));
  const SE3 pose(Eigen::Quaterniond::Identity(), Eigen::Vector3d(0, 0, -10));
  const double rho = 0.2;  // 5 m away, seen from a camera 10 m ahead
  const double* parameters[] = {pose.data(), &rho};
  double residual[2];
  EXPECT_FALSE(cost->Evaluate(parameters, residual, nullptr));
}

TEST(BaselineLength, DerivativesAgreeWithNumericOnes) {
  const PoseManifold pose_manifold;
  const std::vector<const ceres::Manifold*> manifolds = {&pose_manifold};
  const CounterRandom random(2);
  for (std::uint64_t i = 0; i < 20; ++i) {
    const SE3 pose = random_pose(random, i);
    const std::unique_ptr<ceres::CostFunction> cost(BaselineLength::create(1.3, 0.02));
    ceres::GradientChecker checker(cost.get(), &manifolds, small_steps());
    const double* parameters[] = {pose.data()};
    ceres::GradientChecker::ProbeResults results;
    EXPECT_TRUE(checker.Probe(parameters, kRelative, &results)) << results.error_log;
  }
}

TEST(BaselineLength, IsTheLengthsErrorInStandardDeviations) {
  const SE3 pose(Eigen::Quaterniond::Identity(), Eigen::Vector3d(0, 3, -4));
  const std::unique_ptr<ceres::CostFunction> cost(BaselineLength::create(4.5, 0.25));
  const double* parameters[] = {pose.data()};
  double residual = 0.0;
  ASSERT_TRUE(cost->Evaluate(parameters, &residual, nullptr));
  EXPECT_NEAR(residual, 2.0, 1e-12);
  const SE3 nowhere;  // no direction to stretch
  const double* zero[] = {nowhere.data()};
  EXPECT_FALSE(cost->Evaluate(zero, &residual, nullptr));
}

}  // namespace
}  // namespace camber
