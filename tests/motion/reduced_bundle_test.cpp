// The bundle adjustment against the same problem in Ceres, whose residuals' derivatives are checked
// against numeric ones first.

#include "camber/motion/reduced_bundle.h"

#include <ceres/ceres.h>
#include <ceres/gradient_checker.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <memory>
#include <vector>

#include "camber/core/random.h"
#include "camber/geometry/se3.h"
#include "motion/baseline_length.h"
#include "motion/inverse_depth_reprojection_error.h"
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

/// 300 points seen by four views with a noise of 0.2 px, one in ten grossly wrong; some views miss
/// some points. Poses and depths start beside the truth.
struct Made {
  BundleProblem problem;
  std::vector<SE3> truth, views;
  std::vector<double> depths;
};

Made make_bundle() {
  Made out;
  out.problem.camera = test::small_camera();
  const CounterRandom random(11);
  for (int v = 0; v < 4; ++v) {
    const double s = 0.3 * (v - 1.5);
    out.truth.emplace_back(rotation_from_vector({0.01 * s, 0.03 * s, -0.004 * s}),
                           Eigen::Vector3d(0.05 * s, 0.02, -1.0 * s));
    out.views.emplace_back(
        rotation_from_vector({0.002, -0.001 * v, 0.001}) * out.truth.back().rotation(),
        out.truth.back().translation() + Eigen::Vector3d(0.01, -0.01, 0.0));
  }
  std::uint64_t at = 0;
  for (int i = 0; i < 300; ++i) {
    const Eigen::Vector2d pixel(random.uniform(at, 20, 620), random.uniform(at + 1, 20, 220));
    at += 2;
    const double rho = 1.0 / random.uniform(at++, 5.0, 40.0);
    out.problem.rays.push_back(out.problem.camera.ray(pixel));
    out.depths.push_back(rho * random.uniform(at++, 0.8, 1.2));
    const bool wrong = random.uniform(at++) < 0.1;
    for (int v = 0; v < 4; ++v) {
      if (random.uniform(at++) < 0.15) continue;
      const SE3& view = out.truth[static_cast<std::size_t>(v)];
      Eigen::Vector2d seen = *out.problem.camera.project(view.rotation() * out.problem.rays.back() +
                                                         rho * view.translation());
      seen += 0.2 * Eigen::Vector2d(random.normal(at), random.normal(at + 1));
      at += 2;
      if (wrong) seen += Eigen::Vector2d(random.uniform(at, -9, 9), random.uniform(at + 1, -9, 9));
      at += 2;
      out.problem.observations.push_back({i, v, seen});
    }
  }
  return out;
}

TEST(SolveBundle, AgreesWithCeres) {
  Made made = make_bundle();
  constexpr std::size_t kLongest = 3;
  constexpr double kSigma = 0.3;
  std::vector<SE3> views = made.views;
  std::vector<double> depths = made.depths;
  ASSERT_TRUE(solve_bundle(made.problem, kLongest, kSigma, views, depths));

  ceres::Problem twin;
  for (const BundleObservation& o : made.problem.observations) {
    twin.AddResidualBlock(
        InverseDepthReprojectionError::create(made.problem.camera,
                                              made.problem.rays[static_cast<std::size_t>(o.point)],
                                              o.pixel, kSigma),
        new ceres::CauchyLoss(made.problem.cauchy),
        made.views[static_cast<std::size_t>(o.view)].data(),
        &made.depths[static_cast<std::size_t>(o.point)]);
  }
  for (SE3& view : made.views) twin.SetManifold(view.data(), new PoseManifold);
  twin.AddResidualBlock(BaselineLength::create(made.views[kLongest].translation().norm(), 1e-6),
                        nullptr, made.views[kLongest].data());
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_SCHUR;
  options.max_num_iterations = 200;
  options.function_tolerance = 1e-12;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &twin, &summary);
  ASSERT_TRUE(summary.IsSolutionUsable());
  // Ours stops at a relative decrease of 1e-5; standard deviations are some 1e-4 rad and 1e-3.
  const ReducedBundle ours = reduce_bundle(made.problem, views, depths, kSigma);
  EXPECT_NEAR(0.5 * ours.cost, summary.final_cost, 1e-3 * summary.final_cost);
  for (std::size_t v = 0; v < views.size(); ++v) {
    EXPECT_LT(views[v].rotation().angularDistance(made.views[v].rotation()), 2e-5);
    EXPECT_LT((views[v].translation() - made.views[v].translation()).norm(), 5e-4);
  }
  // And both are near the truth, whose longest baseline is a little shorter.
  const double unit =
      made.truth[kLongest].translation().norm() / views[kLongest].translation().norm();
  for (std::size_t v = 0; v < views.size(); ++v) {
    EXPECT_LT(views[v].rotation().angularDistance(made.truth[v].rotation()), 5e-4);
    EXPECT_LT((unit * views[v].translation() - made.truth[v].translation()).norm(), 0.01);
  }
}

TEST(SolveBundle, IsTheSameForAnyNumberOfThreads) {
  const Made made = make_bundle();
  std::vector<SE3> one = made.views, four = made.views;
  std::vector<double> depths_one = made.depths, depths_four = made.depths;
  BundleProblem problem = made.problem;
  problem.num_threads = 1;
  ASSERT_TRUE(solve_bundle(problem, 3, 0.3, one, depths_one));
  problem.num_threads = 4;
  ASSERT_TRUE(solve_bundle(problem, 3, 0.3, four, depths_four));
  EXPECT_EQ(depths_one, depths_four);
  for (std::size_t v = 0; v < one.size(); ++v) EXPECT_EQ(one[v].matrix(), four[v].matrix());
}

TEST(SolveBundle, PointsBehindACameraAreNoStart) {
  Made made = make_bundle();
  made.depths[7] = 5.0;  // nearer than the views are apart
  made.views[0].set_translation({0, 0, -1.0});
  EXPECT_FALSE(solve_bundle(made.problem, 3, 0.3, made.views, made.depths));
  const Eigen::Matrix2Xd residuals = bundle_residuals(made.problem, made.views, made.depths);
  EXPECT_FALSE(residuals.allFinite());
}

TEST(ReduceBundle, GradientAndInformationAreThoseOfTheEliminatedCost) {
  // Without outliers and near the optimum the reduced cost is quadratic: compare with differences
  // of the cost after the depths are solved again.
  Made made = make_bundle();
  made.problem.cauchy = 1e3;  // least squares
  std::vector<SE3> views = made.views;
  std::vector<double> depths = made.depths;
  ASSERT_TRUE(solve_bundle(made.problem, 3, 0.3, views, depths));
  const ReducedBundle system = reduce_bundle(made.problem, views, depths, 0.3);
  const auto cost_after_depths = [&](Eigen::Index k, double step) {
    std::vector<SE3> moved = views;
    Eigen::Matrix<double, 6, 1> change = Eigen::Matrix<double, 6, 1>::Zero();
    change[k % 6] = step;
    SE3& view = moved[static_cast<std::size_t>(k / 6)];
    view = SE3(rotation_from_vector(change.head<3>()) * view.rotation(),
               view.translation() + change.tail<3>());
    std::vector<double> best = depths;
    for (int iteration = 0; iteration < 8; ++iteration) {  // Newton on each depth by differences
      for (std::size_t i = 0; i < best.size(); ++i) {
        double gradient = 0.0, information = 1e-12;
        for (const BundleObservation& o : made.problem.observations) {
          if (o.point != static_cast<int>(i)) continue;
          const SE3& v = moved[static_cast<std::size_t>(o.view)];
          const auto seen = [&](double rho) {
            return *made.problem.camera.project(v.rotation() * made.problem.rays[i] +
                                                rho * v.translation());
          };
          const Eigen::Vector2d slope = (seen(best[i] + 1e-7) - seen(best[i] - 1e-7)) / 2e-7;
          gradient += slope.dot(seen(best[i]) - o.pixel);
          information += slope.squaredNorm();
        }
        best[i] -= gradient / information;
      }
    }
    return 0.5 * reduce_bundle(made.problem, moved, best, 0.3).cost;
  };
  for (const Eigen::Index k : {0, 4, 10, 17}) {
    const double step = 1e-4;
    const double plus = cost_after_depths(k, step), minus = cost_after_depths(k, -step);
    const double middle = cost_after_depths(k, 0.0);
    const double curvature = (plus - 2 * middle + minus) / (step * step);
    EXPECT_NEAR(curvature, system.information(k, k), 0.1 * system.information(k, k));
    EXPECT_NEAR((plus - minus) / (2 * step), system.gradient[k],
                0.1 * std::abs(system.gradient[k]) + 1e-4 * system.information(k, k));
  }
}

}  // namespace
}  // namespace camber
