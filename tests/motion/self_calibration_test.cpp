// The focal length by simulated correspondences of a camera that turns.

#include "camber/motion/self_calibration.h"

#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>
#include <vector>

#include "motion/simulated_matches.h"

namespace camber {
namespace {

/// Seven frames of a turn, 1 m apart, of a camera that looks down by `pitch`; the reference is the
/// one in the middle.
std::vector<SE3> turning_motion(double radius, double pitch) {
  std::vector<SE3> world_from_camera, out;
  for (int k = -3; k <= 3; ++k) {
    const double yaw = k / radius;
    world_from_camera.emplace_back(
        rotation_from_vector({0.0, yaw, 0.0}) * rotation_from_vector({-pitch, 0.0, 0.0}),
        Eigen::Vector3d(radius * (1.0 - std::cos(yaw)), 0.0, radius * std::sin(yaw)));
  }
  for (const SE3& camera : world_from_camera)
    out.push_back(camera.inverse() * world_from_camera[3]);
  return out;
}

/// What is found where the camera is taken to have `factor` times its focal length.
FocalLengthEstimate found_with(double factor, const std::vector<SE3>& motion, std::uint64_t seed) {
  test::SimulatedMatchesOptions options;
  options.step = 8;
  options.outliers = 0.1;
  options.seed = seed;
  const test::SimulatedMatches s = test::simulate_matches(test::small_camera(), motion, 3, options);
  PinholeCamera camera = test::small_camera();
  camera.fx *= factor;
  camera.fy *= factor;
  const MotionEstimate start = estimate_motion(camera, s.matches, s.all, {});
  EXPECT_EQ(start.status, Status::kOk) << start.reason;
  MatchNoise noise;
  noise.correlation = 1.0;  // these matches are independent
  return estimate_focal_length(camera, s.matches, s.all, start, noise);
}

TEST(EstimateFocalLength, OfATurningCameraIsFoundAndItsSigmaHolds) {
  for (const double factor : {1.0, 2.0, 0.7}) {
    double worst = 0.0;
    for (const std::uint64_t seed : {1, 2}) {
      const FocalLengthEstimate found = found_with(factor, turning_motion(25.0, 0.12), seed);
      ASSERT_EQ(found.status, Status::kOk);
      EXPECT_LT(found.sigma, 0.03) << factor;
      worst = std::max(worst, std::abs(std::log(found.factor * factor)) / found.sigma);
      const double sigmas = std::sqrt(2.0 * found.gain);
      if (factor == 1.0) {
        EXPECT_LT(sigmas, 4.0);
      } else {
        EXPECT_GT(sigmas, 6.0) << factor;
      }
    }
    EXPECT_LT(worst, 4.0) << factor;
  }
}

TEST(EstimateFocalLength, OfACameraThatGoesStraightIsNotAsked) {
  std::vector<SE3> straight;
  for (int k = -3; k <= 3; ++k)
    straight.emplace_back(Eigen::Matrix3d::Identity(), Eigen::Vector3d(0, 0, -k));
  EXPECT_EQ(found_with(1.0, straight, 1).status, Status::kNotRun);
  EXPECT_EQ(found_with(2.0, straight, 1).status, Status::kNotRun);
}

// All optical axes in one plane: no two views determine the focal length.
TEST(EstimateFocalLength, OfACameraThatLooksAlongThePlaneOfItsMotionIsStatedAsUnknown) {
  for (const double factor : {1.0, 1.5}) {
    const FocalLengthEstimate found = found_with(factor, turning_motion(25.0, 0.0), 1);
    ASSERT_EQ(found.status, Status::kOk);
    EXPECT_GT(found.sigma, 0.1);
    EXPECT_LT(std::sqrt(2.0 * found.gain), 3.0);
  }
}

TEST(EstimateFocalLength, SizesThatDisagreeThrow) {
  const std::vector<SE3> motion = turning_motion(25.0, 0.12);
  const test::SimulatedMatches s = test::simulate_matches(test::small_camera(), motion, 3, {});
  MotionEstimate start;
  start.frame_from_reference = motion;
  EXPECT_THROW(estimate_focal_length(test::small_camera(), s.matches, {1, 1}, start),
               std::invalid_argument);
}

}  // namespace
}  // namespace camber
