// Which part of the road the ego plane is fitted to, and what its sigma covers.

#include "camber/scale/ego_plane.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <stdexcept>

#include "camber/core/random.h"

namespace camber {
namespace {

constexpr double kHeight = 1.5, kMetresPerUnit = 0.8;

/// Height of the road, m, at metres ahead of the camera's foot and to the right of it.
using Ground = std::function<double(double ahead, double right)>;

/// Points of a road as a camera that looks along +z sees them, in its frame, up to scale.
/// @param noise  of an inverse distance, as a share of the true one
RoadPoints road_points(const Ground& ground, double from, const std::vector<double>& path,
                       double right_curvature = 0.0, double noise = 0.004,
                       std::uint64_t draws = 1) {
  RoadPoints out;
  const CounterRandom random(3, draws);
  std::uint64_t draw = 0;
  for (double inverse = 1.0 / from; inverse > 1.0 / 28.0; inverse -= 0.0015) {
    const double ahead = 1.0 / inverse;
    for (double right = -3.0; right <= 3.0; right += 0.15) {
      const double measured = 1.0 + noise * random.normal(draw++);  // of the inverse distance
      out.points.push_back(Eigen::Vector3d(right, kHeight - ground(ahead, right), ahead) /
                           (measured * kMetresPerUnit));
      out.relative_sigma.push_back(noise / measured);
    }
  }
  for (const double ahead : path) {
    const double right = 0.5 * right_curvature * ahead * ahead;
    out.camera_path.push_back(Eigen::Vector3d(right, -ground(ahead, right), ahead) /
                              kMetresPerUnit);
  }
  return out;
}

EgoPlane fit(const RoadPoints& road, const EgoPlaneOptions& options) {
  return fit_ego_plane(road, Eigen::Vector3d::UnitZ(), -Eigen::Vector3d::UnitY(), {}, options);
}

EgoPlaneOptions options_of_camera() {
  EgoPlaneOptions options;
  options.camera_height = kHeight;
  return options;
}

double scale_error(const EgoPlane& ego) {
  return std::log(ego.metres_per_baseline / kMetresPerUnit);
}

TEST(DrivenStrip, CurveThatBeginsAheadOfTheCameraIsNotCarriedBack) {
  const Ground ground = [](double s, double) {
    return s < 4.0 ? 0.0 : 0.5 * 0.02 * (s - 4.0) * (s - 4.0);
  };
  const EgoPlane ego = fit(road_points(ground, 3.0, {-1.0, 1.0}), options_of_camera());
  ASSERT_EQ(ego.status, Status::kOk) << ego.reason;
  EXPECT_LT(std::abs(scale_error(ego)), 2.0 * ego.relative_sigma);
  EgoPlaneOptions even = options_of_camera();
  even.curve_begins = 1e6;
  const EgoPlane carried_back = fit(road_points(ground, 3.0, {-1.0, 1.0}), even);
  EXPECT_LT(std::abs(scale_error(ego)), 0.6 * std::abs(scale_error(carried_back)));
}

TEST(DrivenStrip, VergesBesideTheWheelsAreLeftOut) {
  const Ground verges = [](double, double right) { return std::abs(right) > 1.5 ? 0.05 : 0.0; };
  const RoadPoints road = road_points(verges, 4.0, {-1.0, 1.0});
  const EgoPlane ego = fit(road, options_of_camera());
  ASSERT_EQ(ego.status, Status::kOk) << ego.reason;
  EXPECT_NEAR(scale_error(ego), 0.0, 0.005);
  EgoPlaneOptions wide = options_of_camera();
  wide.half_width = 2.9;
  wide.wide_half_width = 3.0;
  EXPECT_GT(std::abs(scale_error(fit(road, wide))), 2.0 * std::abs(scale_error(ego)));
  // Where the strip's width matters, the scale is less sure.
  const RoadPoints level = road_points([](double, double) { return 0.0; }, 4.0, {-1.0, 1.0});
  EXPECT_GT(ego.relative_sigma, 1.02 * fit(level, options_of_camera()).relative_sigma);
}

// A point whose error brings it nearer states a smaller sigma: taken at its word it lifts the road.
TEST(DrivenStrip, NoisyPointsDoNotLiftTheRoad) {
  constexpr int kDraws = 20;
  constexpr double kNoise = 0.08;
  double mean = 0.0;
  for (std::uint64_t draws = 0; draws < kDraws; ++draws) {
    const EgoPlane ego = fit(
        road_points([](double, double) { return 0.0; }, 5.0, {-1.0, 1.0}, 0.0, kNoise, 10 + draws),
        options_of_camera());
    mean += scale_error(ego) / kDraws;
  }
  EXPECT_NEAR(mean, 0.0, 0.01);  // by their own sigmas 0.04
}

// A kerb in the strip: of pavement and road a fit of both at once makes a cross slope.
TEST(DrivenStrip, KerbBesideTheWheelsMakesNoCrossSlope) {
  const Ground kerb = [](double, double right) {
    return 0.02 * right + (right > 0.7 ? 0.15 : 0.0);
  };
  const RoadPoints road = road_points(kerb, 3.0, {-0.4, 0.4});
  const EgoPlane ego = fit(road, options_of_camera());
  ASSERT_EQ(ego.status, Status::kOk) << ego.reason;
  EXPECT_NEAR(scale_error(ego), 0.0, 0.005);
  EgoPlaneOptions at_once = options_of_camera();
  at_once.start_half_width = at_once.half_width;
  EXPECT_GT(std::abs(scale_error(fit(road, at_once))), 0.03);
}

// A kerb too low to be told from the road draws it: the strip between the wheels, without it,
// tells.
TEST(DrivenStrip, LowKerbInTheStripWidensTheScale) {
  const Ground kerb = [](double, double right) { return right > 0.7 ? 0.07 : 0.0; };
  const std::vector<double> path = {-0.4, 0.4};
  EgoPlaneOptions options = options_of_camera();
  options.wide_half_width = options.half_width + 0.01;
  const EgoPlane ego = fit(road_points(kerb, 3.0, path), options);
  const EgoPlane level = fit(road_points([](double, double) { return 0.0; }, 3.0, path), options);
  EXPECT_GT(std::abs(scale_error(ego)), 0.005);
  EXPECT_GT(ego.relative_sigma, std::hypot(level.relative_sigma, 0.7 * scale_error(ego)));
}

TEST(DrivenStrip, StripFollowsATurn) {
  // The pavement lies straight ahead, the road bends to the right before it.
  constexpr double kCurvature = 0.08;
  const Ground corner = [](double s, double right) {
    return right < 0.5 * kCurvature * s * s - 1.6 ? 0.15 : 0.0;
  };
  const std::vector<double> path = {-2.5, -1.25, 1.25, 2.5};
  RoadPoints road = road_points(corner, 4.0, path, kCurvature);
  for (Eigen::Vector3d& p : road.camera_path) p.y() = 0.0;
  const EgoPlane ego = fit(road, options_of_camera());
  ASSERT_EQ(ego.status, Status::kOk) << ego.reason;
  EXPECT_NEAR(scale_error(ego), 0.0, 0.01);
  EXPECT_GT(ego.line[10].x(), 0.3 * kCurvature * 100.0 / kMetresPerUnit * 0.5);
  EgoPlaneOptions straight = options_of_camera();
  straight.path.curvature = 1e-6;
  EXPECT_GT(std::abs(scale_error(fit(road, straight))), 2.0 * std::abs(scale_error(ego)));
}

// Positions a step apart hardly bend; the camera's turn tells.
TEST(DrivenStrip, TurnsOfTheCameraBendTheStrip) {
  constexpr double kCurvature = 0.1;
  const Ground corner = [](double s, double right) {
    return right < 0.5 * kCurvature * s * s - 1.6 ? 0.15 : 0.0;
  };
  const std::vector<double> path = {-0.45, 0.45};
  RoadPoints road = road_points(corner, 4.0, path, kCurvature);
  for (Eigen::Vector3d& p : road.camera_path) p.y() = 0.0;
  const double without = std::abs(scale_error(fit(road, options_of_camera())));
  for (const double s : path) road.camera_turns.push_back(kCurvature * s);
  const EgoPlane ego = fit(road, options_of_camera());
  ASSERT_EQ(ego.status, Status::kOk) << ego.reason;
  EXPECT_NEAR(scale_error(ego), 0.0, 0.01);
  EXPECT_GT(without, 2.0 * std::abs(scale_error(ego)));
  EXPECT_NEAR(ego.line[10].x(), (1.0 - std::cos(10 * kCurvature)) / kCurvature / kMetresPerUnit,
              0.1 * ego.line[10].x());
  road.camera_turns.pop_back();
  EXPECT_THROW(fit(road, options_of_camera()), std::invalid_argument);
}

// On a plane, a path that turns meets slope and cross slope in turn; nothing bends.
TEST(DrivenStrip, AnEvenFallUnderATurnIsNoCurve) {
  constexpr double kCurvature = 0.1, kFall = 0.012;
  const Ground plane = [](double, double right) { return kFall * right; };
  const std::vector<double> path = {-0.9, -0.45, 0.45, 0.9};
  RoadPoints road = road_points(plane, 4.0, path, kCurvature);
  EgoPlaneOptions options = options_of_camera();
  options.roll_sigma = 0.05;
  const double straight_sigma = fit(road, options).relative_sigma;
  for (const double s : path) road.camera_turns.push_back(kCurvature * s);
  const EgoPlane ego = fit(road, options);
  ASSERT_EQ(ego.status, Status::kOk) << ego.reason;
  EXPECT_NEAR(scale_error(ego), 0.0, 0.002);
  EXPECT_GT(ego.relative_sigma, 1.2 * straight_sigma);  // real roads have a crown
}

TEST(DrivenStrip, OptionsAreChecked) {
  const auto refused = [](const std::function<void(EgoPlaneOptions*)>& change) {
    EgoPlaneOptions options;
    change(&options);
    EXPECT_THROW(options.validate(), std::invalid_argument);
  };
  refused([](EgoPlaneOptions* o) { o->camera_height = 0.0; });
  refused([](EgoPlaneOptions* o) { o->wide_half_width = o->half_width; });
  refused([](EgoPlaneOptions* o) { o->start_half_width = 0.0; });
  refused([](EgoPlaneOptions* o) { o->curve_begins_most = 0.5; });
  EXPECT_NO_THROW(EgoPlaneOptions().validate());
}

}  // namespace
}  // namespace camber
