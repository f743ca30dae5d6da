// Triangulation with known motion: depths, stated errors, and the reasons for dropping points.

#include "camber/motion/triangulation.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <stdexcept>

#include "motion/simulated_matches.h"

namespace camber {
namespace {

using test::driving_motion;
using test::simulate_matches;
using test::SimulatedMatches;
using test::SimulatedMatchesOptions;
using test::small_camera;
using ::testing::HasSubstr;

MotionEstimate known_motion(const std::vector<SE3>& poses, double pixel_sigma) {
  MotionEstimate motion;
  motion.status = Status::kOk;
  motion.frame_from_reference = poses;
  motion.pixel_sigma = pixel_sigma;
  const auto n = static_cast<Eigen::Index>(6 * (poses.size() - 1));
  motion.covariance = Eigen::MatrixXd::Zero(n, n);
  return motion;
}

long count(const TriangulatedPoints& points, DropReason reason) {
  return points.dropped[static_cast<std::size_t>(reason)];
}

/// Share of the right matches whose true inverse depth lies in the stated 95 % interval.
double coverage(const TriangulatedPoints& points, const SimulatedMatches& s,
                double metres_per_baseline, const Eigen::MatrixXd& pose_covariance) {
  long inside = 0, all = 0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const auto at = static_cast<std::size_t>(points.grid[i]);
    if (s.outlier[at]) continue;
    const double error = points.inverse_depth[i] - metres_per_baseline / s.depths[at];
    ++all;
    if (std::abs(error) < 1.96 * points.sigma_total(i, pose_covariance)) ++inside;
  }
  EXPECT_GT(all, 2000);
  return static_cast<double>(inside) / static_cast<double>(all);
}

TEST(Triangulate, WithoutNoiseDepthsAreExact) {
  SimulatedMatchesOptions options;
  options.noise_px = 0.0;
  options.outliers = 0.0;
  const SimulatedMatches s = simulate_matches(small_camera(), driving_motion(), 1, options);
  const TriangulatedPoints points =
      triangulate(small_camera(), s.matches, known_motion(driving_motion(), 0.02), s.all, {});
  ASSERT_GT(points.size(), 7000u);
  for (std::size_t i = 0; i < points.size(); ++i) {
    const double truth = 1.0 / s.depths[static_cast<std::size_t>(points.grid[i])];
    // Pixels are floats: 3e-5 px at column 640, far below the stated sigma for 0.02 px.
    EXPECT_NEAR(points.inverse_depth[i], truth, 0.02 * points.sigma_own[i] + 1e-9);
    EXPECT_NEAR(points.point(i).z(), 1.0 / points.inverse_depth[i], 1e-9);
  }
}

TEST(Triangulate, IntervalsHoldWithKnownMotion) {
  const SimulatedMatches s = simulate_matches(small_camera(), driving_motion(), 1, {});
  const MotionEstimate motion = known_motion(driving_motion(), 0.1);
  const TriangulatedPoints points = triangulate(small_camera(), s.matches, motion, s.all, {});
  const double share = coverage(points, s, 1.0, motion.covariance);
  EXPECT_GT(share, 0.90);
  EXPECT_LT(share, 0.99);
  // Two thousand points are wrong by tens of pixels in both images: only those that happen to fall
  // near both epipolar lines can slip through.
  long wrong = 0;
  for (const int at : points.grid) wrong += s.outlier[static_cast<std::size_t>(at)];
  EXPECT_LT(wrong, static_cast<long>(points.size()) / 50);
  EXPECT_GT(count(points, DropReason::kInconsistent), 500);
}

TEST(Triangulate, IntervalsHoldWithTheEstimatedMotion) {
  const SimulatedMatches s = simulate_matches(small_camera(), driving_motion(), 1, {});
  MotionOptions options;
  options.noise.correlation = 1.0;  // simulated matches are independent
  const MotionEstimate motion = estimate_motion(small_camera(), s.matches, s.all, options);
  ASSERT_EQ(motion.status, Status::kOk) << motion.reason;
  const TriangulatedPoints points = triangulate(small_camera(), s.matches, motion, s.all, {});
  const double unit = driving_motion()[2].translation().norm();
  const double share = coverage(points, s, unit, motion.covariance);
  EXPECT_GT(share, 0.90);
  EXPECT_LT(share, 0.99);
}

TEST(Triangulate, PoseJacobianAgreesWithDifferences) {
  SimulatedMatchesOptions options;
  options.outliers = 0.0;
  options.step = 16;
  const PinholeCamera camera = small_camera();
  const SimulatedMatches s = simulate_matches(camera, driving_motion(), 1, options);
  const MotionEstimate motion = known_motion(driving_motion(), 0.1);
  TriangulationOptions loose;
  loose.max_residual = 100.0;  // the same points with every motion
  loose.max_relative_sigma = 100.0;
  const TriangulatedPoints points = triangulate(camera, s.matches, motion, s.all, loose);
  for (int column = 0; column < 12; ++column) {
    MotionEstimate moved[2] = {motion, motion};
    const double step = 1e-5;
    for (int side = 0; side < 2; ++side) {
      Eigen::Matrix<double, 6, 1> change = Eigen::Matrix<double, 6, 1>::Zero();
      change[column % 6] = side == 0 ? -step : step;
      SE3& pose = moved[side].frame_from_reference[column < 6 ? 0 : 2];
      pose = SE3(rotation_from_vector(change.head<3>()) * pose.rotation(),
                 pose.translation() + change.tail<3>());
    }
    const TriangulatedPoints low = triangulate(camera, s.matches, moved[0], s.all, loose);
    const TriangulatedPoints high = triangulate(camera, s.matches, moved[1], s.all, loose);
    ASSERT_EQ(low.grid, points.grid);
    ASSERT_EQ(high.grid, points.grid);
    for (std::size_t i = 0; i < points.size(); ++i) {
      const double relative = points.sigma_own[i] / points.inverse_depth[i];
      if (relative > 0.05) continue;  // near the focus of expansion depths are not linear in poses
      const double numeric = (high.inverse_depth[i] - low.inverse_depth[i]) / (2 * step);
      const double stated = points.pose_jacobian(static_cast<Eigen::Index>(i), column);
      // Gauss-Newton leaves out what the residual (0.1 px of some 10 px) bends the answer by.
      EXPECT_NEAR(stated, numeric,
                  0.05 * points.pose_jacobian.row(static_cast<Eigen::Index>(i)).norm())
          << "point " << i << ", column " << column;
    }
  }
}

/// A camera that drives straight ahead 1 m; four groups of points, each to be dropped in its way.
TEST(Triangulate, PointsAreDroppedForTheRightReason) {
  const PinholeCamera camera = small_camera();
  const std::vector<SE3> ahead = {SE3(),
                                  SE3(Eigen::Quaterniond::Identity(), Eigen::Vector3d(0, 0, -1))};
  SimulatedMatchesOptions options;
  options.step = 2;
  options.noise_px = 0.0;
  options.outliers = 0.0;
  options.nearest = 39.0;
  SimulatedMatches s = simulate_matches(camera, ahead, 0, options);
  const MotionEstimate motion = known_motion(ahead, 0.1);
  MatchedImage& match = s.matches.matches[0];
  const Eigen::Vector2d focus(camera.cx, camera.cy);
  std::vector<std::uint8_t> near(s.all.size(), 0), far(s.all.size(), 0);
  long near_points = 0, far_points = 0;
  for (std::size_t i = 0; i < s.all.size(); ++i) {
    const double distance = (s.matches.pixels[i].cast<double>() - focus).norm();
    // Parallax is distance / 40: at 6 px it is 0.15 px, known to 0.1 px.
    if (distance < 6.0) near[i] = 1, ++near_points;
    if (distance > 60.0 && distance < 100.0) far[i] = 1, ++far_points;
  }
  TriangulatedPoints points = triangulate(camera, s.matches, motion, near, {});
  EXPECT_EQ(points.size(), 0u);
  EXPECT_EQ(count(points, DropReason::kNearFocusOfExpansion), near_points);

  points = triangulate(camera, s.matches, motion, far, {});
  EXPECT_EQ(static_cast<long>(points.size()), far_points);

  const MatchedImage right = match;
  for (std::size_t i = 0; i < s.all.size(); ++i) {  // towards the focus instead of away
    match.pixels[i] = 2.0f * s.matches.pixels[i] - right.pixels[i];
  }
  points = triangulate(camera, s.matches, motion, far, {});
  EXPECT_EQ(points.size(), 0u);
  EXPECT_EQ(count(points, DropReason::kBehindCamera), far_points);

  for (std::size_t i = 0; i < s.all.size(); ++i) {  // 3 px off the epipolar line: 30 sigma
    const Eigen::Vector2f along = (s.matches.pixels[i] - focus.cast<float>()).normalized();
    match.pixels[i] = right.pixels[i] + 3.0f * Eigen::Vector2f(-along.y(), along.x());
  }
  points = triangulate(camera, s.matches, motion, far, {});
  EXPECT_EQ(points.size(), 0u);
  EXPECT_EQ(count(points, DropReason::kInconsistent), far_points);

  match.round_trip_px.assign(s.all.size(), std::numeric_limits<float>::infinity());
  points = triangulate(camera, s.matches, motion, far, {});
  EXPECT_EQ(points.size(), 0u);
  EXPECT_EQ(count(points, DropReason::kNoMatch), far_points);
}

TEST(Triangulate, IsTheSameForAnyNumberOfThreads) {
  const SimulatedMatches s = simulate_matches(small_camera(), driving_motion(), 1, {});
  const MotionEstimate motion = known_motion(driving_motion(), 0.1);
  TriangulationOptions one, two;
  one.num_threads = 1;
  two.num_threads = 2;
  const TriangulatedPoints a = triangulate(small_camera(), s.matches, motion, s.all, one);
  const TriangulatedPoints b = triangulate(small_camera(), s.matches, motion, s.all, two);
  EXPECT_EQ(a.grid, b.grid);
  EXPECT_EQ(a.inverse_depth, b.inverse_depth);
  EXPECT_EQ(a.sigma_own, b.sigma_own);
  EXPECT_EQ(a.pose_jacobian, b.pose_jacobian);
  EXPECT_EQ(a.dropped, b.dropped);
}

TEST(Triangulate, SizesThatDisagreeAndBadOptionsThrow) {
  const SimulatedMatches s = simulate_matches(small_camera(), driving_motion(), 1, {});
  const MotionEstimate motion = known_motion(driving_motion(), 0.1);
  const std::vector<std::uint8_t> short_list(s.all.begin(), s.all.end() - 1);
  EXPECT_THROW(triangulate(small_camera(), s.matches, motion, short_list, {}),
               std::invalid_argument);
  TriangulationOptions options;
  options.max_relative_sigma = 0.0;
  EXPECT_THROW(triangulate(small_camera(), s.matches, motion, s.all, options),
               std::invalid_argument);
  options = {};
  options.max_residual = -1.0;
  EXPECT_THROW(options.validate(), std::invalid_argument);
}

TEST(DropReason, HasAWordForEach) {
  EXPECT_EQ(to_string(DropReason::kNoMatch), "no_match");
  EXPECT_EQ(to_string(DropReason::kNearFocusOfExpansion), "near_focus_of_expansion");
  EXPECT_EQ(to_string(DropReason::kBehindCamera), "behind_camera");
  EXPECT_EQ(to_string(DropReason::kInconsistent), "inconsistent");
}

}  // namespace
}  // namespace camber
