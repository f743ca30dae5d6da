// Motion from simulated correspondences with known poses.

#include "camber/motion/motion.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <cmath>
#include <stdexcept>

#include "camber/geometry/plane.h"
#include "motion/simulated_matches.h"

namespace camber {
namespace {

using test::driving_motion;
using test::simulate_matches;
using test::SimulatedMatches;
using test::SimulatedMatchesOptions;
using test::small_camera;
using ::testing::HasSubstr;

double rotation_error(const SE3& a, const SE3& b) {
  return rotation_to_vector(a.rotation() * b.rotation().conjugate()).norm();
}

/// Some 1200 points of 0.1 px, seen in three images, hold each angle to 1.4e-5 rad and each
/// coordinate of a translation to 2.7e-4 of the longest baseline (the stated covariance, which the
/// tests below hold against the truth). The bounds are four of these.
constexpr double kRotation = 6e-5;     // rad
constexpr double kDirection = 1.1e-3;  // rad

void expect_motion(const MotionEstimate& found, const std::vector<SE3>& truth) {
  ASSERT_EQ(found.status, Status::kOk) << found.reason;
  ASSERT_EQ(found.frame_from_reference.size(), truth.size());
  const double unit = truth[2].translation().norm();  // the longest baseline
  for (const std::size_t f : {std::size_t{0}, std::size_t{2}}) {
    const SE3& pose = found.frame_from_reference[f];
    EXPECT_LT(rotation_error(pose, truth[f]), kRotation);
    EXPECT_LT(angle_between(pose.translation(), truth[f].translation()), kDirection);
    EXPECT_NEAR(pose.translation().norm(), truth[f].translation().norm() / unit, 1e-3);
  }
  EXPECT_NEAR(found.frame_from_reference[2].translation().norm(), 1.0, 1e-9);
  EXPECT_EQ(found.frame_from_reference[1].translation().norm(), 0.0);
}

/// Squared Mahalanobis distance of the poses' errors by the stated covariance of independent
/// matches, without the direction that is held exactly (the longest baseline's length).
double mahalanobis(const MotionEstimate& found, const std::vector<SE3>& truth) {
  const double unit = truth[2].translation().norm();
  Eigen::VectorXd error(12);
  int row = 0;
  for (const std::size_t f : {std::size_t{0}, std::size_t{2}}) {
    const SE3& pose = found.frame_from_reference[f];
    error.segment<3>(row) = rotation_to_vector(pose.rotation() * truth[f].rotation().conjugate());
    error.segment<3>(row + 3) = pose.translation() - truth[f].translation() / unit;
    row += 6;
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(found.covariance);
  double sum = 0.0;
  for (int i = 1; i < 12; ++i) {  // ascending: the first is the one held
    const double along = eigen.eigenvectors().col(i).dot(error);
    sum += along * along / eigen.eigenvalues()[i];
  }
  return sum;
}

class Driving : public ::testing::TestWithParam<std::uint64_t> {
 protected:
  SimulatedMatches simulate() const {
    SimulatedMatchesOptions options;
    options.seed = GetParam();
    return simulate_matches(small_camera(), driving_motion(), 1, options);
  }
};

TEST_P(Driving, EstimateFindsTheMotionAmongOutliers) {
  const SimulatedMatches s = simulate();
  MotionOptions options;
  options.noise.correlation = 1.0;  // simulated matches are independent
  const MotionEstimate found = estimate_motion(small_camera(), s.matches, s.all, options);
  expect_motion(found, driving_motion());
  EXPECT_NEAR(found.inlier_ratio, 0.8, 0.06);
  EXPECT_GT(found.points, 500);
  EXPECT_GT(found.pixel_sigma, 0.08);  // 0.1, and what outliers add to a median
  EXPECT_LT(found.pixel_sigma, 0.15);
  // Chi-square with 11 degrees of freedom lies in [1.6, 31.3] with 99.9 % on each side.
  const double distance = mahalanobis(found, driving_motion());
  EXPECT_GT(distance, 1.0);
  EXPECT_LT(distance, 31.3);
}

TEST_P(Driving, RefinementPullsInAMotionThatIsNearlyRight) {
  const SimulatedMatches s = simulate();
  MotionEstimate start;
  start.frame_from_reference = driving_motion();
  const double unit = start.frame_from_reference[2].translation().norm();
  for (const std::size_t f : {std::size_t{0}, std::size_t{2}}) {
    SE3& pose = start.frame_from_reference[f];
    const Eigen::Vector3d off(0.001, -0.001, 0.001);  // 0.4 px
    pose = SE3(rotation_from_vector(off) * pose.rotation(),
               pose.translation() / unit + Eigen::Vector3d(0.004, -0.004, 0.0));
  }
  MotionOptions options;
  options.noise.correlation = 1.0;
  const MotionEstimate found = refine_motion(small_camera(), s.matches, s.all, start, options);
  expect_motion(found, driving_motion());
  const double distance = mahalanobis(found, driving_motion());
  EXPECT_GT(distance, 1.0);  // bounds as above
  EXPECT_LT(distance, 31.3);
}

INSTANTIATE_TEST_SUITE_P(Seeds, Driving, ::testing::Values(1u, 2u, 3u));

TEST_P(Driving, APartThatMovesWithTheCameraDoesNotDragItAside) {
  SimulatedMatchesOptions options;
  options.seed = GetParam();
  options.outliers = 0.1;
  options.nearest = 12.0;
  options.noise_px = 0.2;
  SimulatedMatches s = simulate_matches(small_camera(), driving_motion(), 1, options);
  // As a shadow of the car ahead does: a quarter of the images' motion.
  for (MatchedImage& match : s.matches.matches) {
    for (std::size_t i = 0; i < match.pixels.size(); ++i) {
      const Eigen::Vector2f at = s.matches.pixels[i].cast<float>();
      if (at.y() < 112.0F || at.x() < 220.0F || at.x() > 560.0F) continue;
      match.pixels[i] = at + 0.25F * (match.pixels[i] - at);
    }
  }
  const MotionEstimate found = estimate_motion(small_camera(), s.matches, s.all, {});
  ASSERT_EQ(found.status, Status::kOk) << found.reason;
  for (const std::size_t f : {std::size_t{0}, std::size_t{2}}) {
    const SE3& pose = found.frame_from_reference[f];
    EXPECT_LT(rotation_error(pose, driving_motion()[f]), 2e-4);
    EXPECT_LT(angle_between(pose.translation(), driving_motion()[f].translation()), 0.004);
  }
}

TEST(EstimateMotion, IsTheSameEveryTime) {
  const SimulatedMatches s = simulate_matches(small_camera(), driving_motion(), 1, {});
  const MotionEstimate a = estimate_motion(small_camera(), s.matches, s.all, {});
  const MotionEstimate b = estimate_motion(small_camera(), s.matches, s.all, {});
  for (std::size_t f = 0; f < 3; ++f) {
    EXPECT_EQ(a.frame_from_reference[f].matrix(), b.frame_from_reference[f].matrix());
  }
  EXPECT_EQ(a.covariance, b.covariance);
}

TEST(EstimateMotion, TwoFramesAreEnough) {
  std::vector<SE3> motion = driving_motion();
  motion.erase(motion.begin());
  const SimulatedMatches s = simulate_matches(small_camera(), motion, 0, {});
  const MotionEstimate found = estimate_motion(small_camera(), s.matches, s.all, {});
  ASSERT_EQ(found.status, Status::kOk) << found.reason;
  EXPECT_LT(rotation_error(found.frame_from_reference[1], motion[1]), 2 * kRotation);
  EXPECT_LT(angle_between(found.frame_from_reference[1].translation(), motion[1].translation()),
            2 * kDirection);
  EXPECT_EQ(found.covariance.rows(), 6);
}

TEST(EstimateMotion, SaysThatTheCameraStands) {
  const SimulatedMatches s = simulate_matches(small_camera(), {SE3(), SE3(), SE3()}, 1, {});
  const MotionEstimate found = estimate_motion(small_camera(), s.matches, s.all, {});
  EXPECT_EQ(found.status, Status::kFailed);
  EXPECT_THAT(found.reason, HasSubstr("the camera stands still"));
}

TEST(EstimateMotion, SaysThatTheCameraOnlyTurns) {
  const std::vector<SE3> turning = {
      SE3(rotation_from_vector({0.0, 0.02, 0.0}), Eigen::Vector3d::Zero()), SE3(),
      SE3(rotation_from_vector({0.005, -0.03, 0.0}), Eigen::Vector3d::Zero())};
  const SimulatedMatches s =
      simulate_matches(small_camera(), turning, 1, {4, 0.1, 0.05, 6.0, 40.0, 1});
  const MotionEstimate found = estimate_motion(small_camera(), s.matches, s.all, {});
  EXPECT_EQ(found.status, Status::kFailed);
  EXPECT_THAT(found.reason, HasSubstr("no parallax: the camera only turns"));
}

TEST(EstimateMotion, SaysThatThereIsTooLittleToGoBy) {
  const PinholeCamera camera = small_camera();
  SimulatedMatches s = simulate_matches(camera, driving_motion(), 1, {});
  std::vector<std::uint8_t> few(s.all.size(), 0);
  for (std::size_t i = 0; i < 20; ++i) few[(i + 1) * few.size() / 22] = 1;
  MotionEstimate found = estimate_motion(camera, s.matches, few, {});
  EXPECT_EQ(found.status, Status::kFailed);
  EXPECT_THAT(found.reason, HasSubstr("too little texture: "));
  for (Eigen::Vector3f& t : s.matches.texture) t.setZero();
  found = estimate_motion(camera, s.matches, s.all, {});
  EXPECT_EQ(found.status, Status::kFailed);
  EXPECT_THAT(found.reason, HasSubstr("too little texture: 0 matched points"));
  const SimulatedMatches alone = simulate_matches(camera, {SE3()}, 0, {});
  found = estimate_motion(camera, alone.matches, alone.all, {});
  EXPECT_EQ(found.status, Status::kFailed);
  EXPECT_THAT(found.reason, HasSubstr("one image alone"));
}

TEST(EstimateMotion, SaysThatTheMatchesAreNonsense) {
  SimulatedMatchesOptions options;
  options.outliers = 1.0;
  const SimulatedMatches s = simulate_matches(small_camera(), driving_motion(), 1, options);
  const MotionEstimate found = estimate_motion(small_camera(), s.matches, s.all, {});
  EXPECT_EQ(found.status, Status::kFailed);
  EXPECT_FALSE(found.reason.empty());
}

TEST(EstimateMotion, SizesThatDisagreeThrow) {
  const SimulatedMatches s = simulate_matches(small_camera(), driving_motion(), 1, {});
  const std::vector<std::uint8_t> short_list(s.all.begin(), s.all.end() - 1);
  EXPECT_THROW(estimate_motion(small_camera(), s.matches, short_list, {}), std::invalid_argument);
  MotionEstimate start;
  start.frame_from_reference = driving_motion();
  EXPECT_THROW(refine_motion(small_camera(), s.matches, short_list, start, {}),
               std::invalid_argument);
  start.frame_from_reference.pop_back();
  EXPECT_THROW(refine_motion(small_camera(), s.matches, s.all, start, {}), std::invalid_argument);
}

TEST(MotionOptions, ValidateNamesTheField) {
  const auto refused = [](auto change, const char* name) {
    MotionOptions options;
    change(options);
    try {
      options.validate();
      ADD_FAILURE() << name << " was taken";
    } catch (const std::invalid_argument& e) {
      EXPECT_THAT(e.what(), HasSubstr(name));
    }
  };
  EXPECT_NO_THROW(MotionOptions().validate());
  refused([](MotionOptions& o) { o.max_essential_points = 49; }, "max_essential_points");
  refused([](MotionOptions& o) { o.max_bundle_points = 0; }, "max_bundle_points");
  refused([](MotionOptions& o) { o.inlier_px = 0.0; }, "inlier_px");
  refused([](MotionOptions& o) { o.inlier_px = std::nan(""); }, "inlier_px");
  refused([](MotionOptions& o) { o.stationary_px = -1.0; }, "stationary_px");
  refused([](MotionOptions& o) { o.parallax_px = 0.0; }, "parallax_px");
  refused([](MotionOptions& o) { o.noise.correlation = 0.5; }, "noise.correlation");
}

/// A camera without rotation at these positions from the reference.
MotionEstimate motion_over(const std::vector<Eigen::Vector3d>& positions) {
  MotionEstimate out;
  for (const Eigen::Vector3d& p : positions) {
    out.frame_from_reference.emplace_back(Eigen::Quaterniond::Identity(), -p);
  }
  return out;
}

TEST(KnownPoses, TheLongestBaselineIsTheUnitWithoutAnErrorOfItsOwn) {
  const std::vector<SE3> poses = {SE3(Eigen::Quaterniond::Identity(), {0.1, -0.05, 1.2}), SE3(),
                                  SE3(Eigen::Quaterniond::Identity(), {-0.1, 0.1, -0.9})};
  KnownPoseOptions options;
  options.translation_sigma = 0.01;
  const MotionEstimate found = motion_from_known_poses(poses, 1, options);
  ASSERT_EQ(found.status, Status::kOk) << found.reason;
  const double length = poses[0].translation().norm();
  EXPECT_NEAR(*found.metres_per_baseline, length, 1e-12);
  EXPECT_NEAR(found.baseline_sigma, 0.01 / length, 1e-12);
  const auto block = [&](Eigen::Index row, Eigen::Index column) -> Eigen::Matrix3d {
    return found.covariance.block<3, 3>(row, column);
  };
  const Eigen::Vector3d unit = poses[0].translation() / length;
  const double sigma = 0.01 / length;
  EXPECT_LT((block(3, 3) * unit).norm(), 1e-15);
  const Eigen::Vector3d across = unit.unitOrthogonal();
  EXPECT_NEAR(across.dot(block(3, 3) * across), sigma * sigma, 1e-15);
  // The other one has an error of its own and its share of the unit's.
  const Eigen::Vector3d other = poses[2].translation() / length;
  EXPECT_LT(
      (block(9, 9) - sigma * sigma * (Eigen::Matrix3d::Identity() + other * other.transpose()))
          .norm(),
      1e-15);
  EXPECT_EQ(block(0, 0),
            Eigen::Matrix3d(std::pow(options.rotation_sigma, 2) * Eigen::Matrix3d::Identity()));
}

TEST(TravelDirection, IsThatOfTheParabolaThroughTheNeighbours) {
  // x = z^2 / 20 at unequal steps: straight ahead at the reference.
  const Eigen::Vector3d travel =
      travel_direction(motion_over({{0.2, 0.0, -2.0}, {0.0, 0.0, 0.0}, {0.05, 0.0, 1.0}}), 1);
  EXPECT_NEAR(travel.x(), 0.0, 1e-2);
  EXPECT_GT(travel.z(), 0.999);
}

// What a camera that stands moves by is the noise of its poses.
TEST(TravelDirection, PassesOverPositionsOfACameraThatStands) {
  const Eigen::Vector3d noise(0.003, 0.004, -0.001);
  const Eigen::Vector3d started =
      travel_direction(motion_over({noise, noise, {0.0, 0.0, 0.0}, {0.0, 0.0, 1.0}}), 2);
  EXPECT_GT(started.z(), 0.9999);
  const Eigen::Vector3d standing_between =
      travel_direction(motion_over({{0.0, 0.0, -1.0}, noise, {0.0, 0.0, 0.0}, {0.0, 0.0, 1.0}}), 2);
  EXPECT_GT(standing_between.z(), 0.9999);
}

}  // namespace
}  // namespace camber
