// Direct refinement of ground and motion on drawn images of a known road.

#include "camber/photometric/direct_ground.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <memory>
#include <stdexcept>

#include "support/drawn_road.h"

namespace camber {
namespace {

using test::DrawnRoad;
using ::testing::HasSubstr;

const PinholeCamera kCamera{480, 180, 320.0, 320.0, 240.0, 70.0};
constexpr double kStep = 0.8;  // m from one frame to the next

/// Three frames of a drive, the middle one the reference; unit of the motion: metres over kStep.
struct Drive {
  DrawnRoad road;
  std::vector<GrayImage> images;
  std::vector<SE3> truth;  // frame from reference, units
  std::vector<std::uint8_t> ground;
  MotionEstimate start;

  explicit Drive(DrawnRoad world) : road(std::move(world)) {
    for (int k = -1; k <= 1; ++k) {
      const SE3 world_from_camera = pose(k);
      images.push_back(
          {kCamera.width, kCamera.height, test::draw_road(road, kCamera, world_from_camera, k)});
      const SE3 metric = world_from_camera.inverse() * pose(0);
      truth.emplace_back(metric.rotation(), metric.translation() / kStep);
    }
    ground.assign(images[0].pixels.size(), 0);
    for (int v = 0; v < kCamera.height; ++v) {
      for (int u = 0; u < kCamera.width; ++u) {
        const double z = test::meet_road(road, kCamera, pose(0), Eigen::Vector2d(u, v)).z();
        ground[static_cast<std::size_t>(v * kCamera.width + u)] = z < 45.0;
      }
    }
    // A start that is off by a little more than a pixel of the far road's parallax.
    start.status = Status::kOk;
    start.frame_from_reference = truth;
    for (const std::size_t k : {0u, 2u}) {
      const double sign = k == 0 ? 1.0 : -1.0;
      SE3& p = start.frame_from_reference[k];
      p = SE3(rotation_from_vector(sign * Eigen::Vector3d(4e-4, -3e-4, 2e-4)) * p.rotation(),
              p.translation() + sign * Eigen::Vector3d(0.004, -0.003, 0.0));
    }
    start.covariance = Eigen::MatrixXd::Zero(12, 12);
    for (int i = 0; i < 12; ++i) {
      const double sigma = i % 6 < 3 ? 5e-4 : i % 6 < 5 ? 0.005 : 1e-6;
      start.covariance(i, i) = sigma * sigma;
    }
  }

  static SE3 pose(int k) {
    return {rotation_from_vector(Eigen::Vector3d(0.0, 0.004 * k, 0.0)),
            Eigen::Vector3d(0.01 * k * k, 0.0, kStep * k)};
  }

  double true_inverse_depth(const Eigen::Vector2d& pixel) const {
    return kStep / test::meet_road(road, kCamera, pose(0), pixel).z();
  }

  /// A field that is off: heights by 3 % of the camera's, growing to the side.
  GroundField wrong_field() const {
    GroundObservations observations;
    for (int v = 90; v < kCamera.height; v += 3) {
      for (int u = 0; u < kCamera.width; u += 4) {
        const Eigen::Vector2d pixel(u, v);
        const double rho = true_inverse_depth(pixel);
        if (!std::isfinite(rho)) continue;
        observations.pixels.push_back(pixel);
        observations.inverse_depth.push_back(rho * (1.03 + 0.02 * (u - 240.0) / 240.0));
        observations.sigma.push_back(0.01 * rho);
      }
    }
    GroundFieldOptions options;
    options.metres_per_baseline = kStep;
    return {kCamera, observations, Plane{{0, -1, 0}, 1.65 / kStep}, options};
  }

  std::vector<DirectImage> direct_images(const std::vector<std::uint8_t>* ignored = nullptr) const {
    std::vector<DirectImage> out;
    for (const GrayImage& image : images) out.push_back({&image, ignored});
    return out;
  }

  /// Median relative error of the inverse depth over the ground up to 25 m.
  double error(const GroundField& field) const {
    std::vector<double> errors;
    for (int v = 92; v < kCamera.height - 4; v += 4) {
      for (int u = 40; u < kCamera.width - 40; u += 16) {
        const double rho = true_inverse_depth(Eigen::Vector2d(u, v));
        if (!(rho > kStep / 25.0)) continue;
        errors.push_back(std::abs(field.inverse_depth(Eigen::Vector2d(u, v)) / rho - 1.0));
      }
    }
    std::nth_element(errors.begin(), errors.begin() + static_cast<long>(errors.size() / 2),
                     errors.end());
    return errors[errors.size() / 2];
  }
};

double direction_error(const std::vector<SE3>& found, const std::vector<SE3>& truth) {
  const Eigen::Vector3d a = found[2].inverse().translation().normalized();
  const Eigen::Vector3d b = truth[2].inverse().translation().normalized();
  return std::acos(std::clamp(a.dot(b), -1.0, 1.0));
}

DrawnRoad bending_road() {
  DrawnRoad road;
  road.ground = [](double x, double z) { return 1.65 - 0.0015 * z * z + 0.02 * x; };
  return road;
}

DirectGround make(const Drive& drive, const DirectOptions& options = {}) {
  return {kCamera, drive.direct_images(), 1, drive.ground, 84, options};
}

TEST(DirectGround, RefinesGroundAndMotionTogether) {
  const Drive drive(bending_road());
  GroundField field = drive.wrong_field();
  const double before = drive.error(field);
  ASSERT_GT(before, 0.025);
  const DirectGround direct = make(drive);
  const HeldOutPixels first = direct.judge(drive.start.frame_from_reference, field);
  const DirectResult result = direct.refine(drive.start, field);
  ASSERT_EQ(result.status, Status::kOk) << result.reason;
  EXPECT_LT(drive.error(field), 0.2 * before);
  EXPECT_LT(direction_error(result.frame_from_reference, drive.truth),
            0.7 * direction_error(drive.start.frame_from_reference, drive.truth));
  EXPECT_LT(result.motion_change, 3.0);
  EXPECT_LT(result.covariance.trace(), drive.start.covariance.trace());
  // Pixels that took no part agree better.
  const DirectEvidence evidence(kCamera.width, kCamera.height, first,
                                direct.judge(result.frame_from_reference, field));
  const DirectEvidence::Costs costs = evidence.within({0, 0}, {480, 180});
  EXPECT_GT(costs.pixels, 500);
  EXPECT_LT(costs.after, 0.7 * costs.before);
}

TEST(DirectGround, ExposureAndShadeOfOneImageDoNotMatter) {
  Drive drive(bending_road());
  GroundField plain = drive.wrong_field();
  make(drive).refine(drive.start, plain);
  for (std::size_t i = 0; i < drive.images[2].pixels.size(); ++i) {
    const double u = static_cast<double>(i % 480) / 480.0;
    drive.images[2].pixels[i] = static_cast<std::uint8_t>(
        std::clamp((0.55 + 0.3 * u) * drive.images[2].pixels[i] + 25.0, 0.0, 255.0));
  }
  GroundField exposed = drive.wrong_field();
  const DirectResult result = make(drive).refine(drive.start, exposed);
  ASSERT_EQ(result.status, Status::kOk);
  EXPECT_LT(drive.error(exposed), drive.error(plain) + 0.003);
}

TEST(DirectGround, MovingShadowIsLeftOutAndStandingOneIsUsed) {
  const auto shaded = [](double speed) {
    DrawnRoad road = bending_road();
    road.light = [speed](double x, double z, int frame) {
      const double front = 8.0 + speed * frame;
      return std::abs(x) < 1.2 && z > front && z < front + 5.0 ? 0.55 : 1.0;
    };
    return road;
  };
  const Drive moving(shaded(0.8)), standing(shaded(0.0));
  GroundField under_moving = moving.wrong_field(), under_standing = standing.wrong_field();
  const DirectResult with_moving = make(moving).refine(moving.start, under_moving);
  const DirectResult with_standing = make(standing).refine(standing.start, under_standing);
  const auto contradicted = [](const DirectResult& result) {
    return std::count(result.contradicted.begin(), result.contradicted.end(), 1);
  };
  EXPECT_GT(contradicted(with_moving), contradicted(with_standing) + 200);
  EXPECT_LT(moving.error(under_moving), 0.008);
  EXPECT_LT(standing.error(under_standing), 0.006);
}

TEST(DirectGround, SameForAnyNumberOfThreads) {
  const Drive drive(bending_road());
  DirectOptions one, four;
  one.num_threads = 1;
  four.num_threads = 4;
  GroundField a = drive.wrong_field(), b = drive.wrong_field();
  const DirectResult ra = make(drive, one).refine(drive.start, a);
  const DirectResult rb = make(drive, four).refine(drive.start, b);
  EXPECT_EQ(ra.observations.inverse_depth, rb.observations.inverse_depth);
  EXPECT_EQ(a.inverse_depth({200, 120}), b.inverse_depth({200, 120}));
  for (std::size_t k = 0; k < 3; ++k) {
    EXPECT_EQ(ra.frame_from_reference[k].matrix(), rb.frame_from_reference[k].matrix());
  }
}

TEST(DirectGround, TooLittleGroundSaysSoAndChangesNothing) {
  Drive drive(bending_road());
  std::fill(drive.ground.begin(), drive.ground.end() - 600, 0);
  GroundField field = drive.wrong_field();
  const double before = field.inverse_depth({240, 150});
  const DirectResult result = make(drive).refine(drive.start, field);
  EXPECT_EQ(result.status, Status::kFailed);
  EXPECT_THAT(result.reason, HasSubstr("pixels of the ground can be compared"));
  EXPECT_EQ(field.inverse_depth({240, 150}), before);
  EXPECT_EQ(result.frame_from_reference[2].matrix(), drive.start.frame_from_reference[2].matrix());
}

TEST(DirectEvidence, TellsBetterFromWorseByRegion) {
  HeldOutPixels before, after;
  before.noise = after.noise = {0.2};
  before.images.resize(1);
  after.images.resize(1);
  for (int v = 0; v < 40; ++v) {
    for (int u = 0; u < 100; ++u) {
      before.images[0].push_back({static_cast<float>(u), static_cast<float>(v), 1.0f});
      // Better on the left, worse on the right; every third pixel is not judged again.
      if (u % 3 == 0) continue;
      after.images[0].push_back(
          {static_cast<float>(u), static_cast<float>(v), u < 48 ? 0.5f : 2.0f});
    }
  }
  const DirectEvidence evidence(100, 40, before, after);
  const auto left = evidence.within({0, 0}, {47, 39});
  const auto right = evidence.within({48, 0}, {99, 39});
  EXPECT_EQ(left.pixels, 40 * 32);
  EXPECT_DOUBLE_EQ(left.before, 1.0);
  EXPECT_DOUBLE_EQ(left.after, 0.5);
  EXPECT_DOUBLE_EQ(right.after, 2.0);
  EXPECT_EQ(DirectEvidence().within({0, 0}, {10, 10}).pixels, 0.0);
}

TEST(DirectGround, RefusesWhatDoesNotFit) {
  const Drive drive(bending_road());
  const std::vector<std::uint8_t> small(10, 1);
  EXPECT_THROW(DirectGround(kCamera, drive.direct_images(), 1, small, 84, {}),
               std::invalid_argument);
  EXPECT_THROW(DirectGround(kCamera, drive.direct_images(), 3, drive.ground, 84, {}),
               std::invalid_argument);
  EXPECT_THROW(DirectGround(kCamera, drive.direct_images(&small), 1, drive.ground, 84, {}),
               std::invalid_argument);
  DirectOptions options;
  options.steps = 0;
  EXPECT_THROW(make(drive, options), std::invalid_argument);
  options = {};
  options.held_out = 0.9;
  EXPECT_THROW(make(drive, options), std::invalid_argument);
  MotionEstimate short_motion = drive.start;
  short_motion.frame_from_reference.pop_back();
  GroundField field = drive.wrong_field();
  EXPECT_THROW(make(drive).refine(short_motion, field), std::invalid_argument);
}

}  // namespace
}  // namespace camber
