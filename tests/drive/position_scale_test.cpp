#include "camber/drive/position_scale.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <vector>

#include "camber/core/random.h"

namespace camber {
namespace {

constexpr double kStep = 1.0;   // m a frame
constexpr double kRate = 10.0;  // frames a second

/// A trajectory on a wide curve, frames 10 on, whose lengths are exp(-log_scale) of the true ones.
Trajectory curved(std::size_t frames, double log_scale) {
  Trajectory out;
  SE3 pose;
  const double step = kStep * std::exp(-log_scale);
  for (std::size_t k = 0; k < frames; ++k) {
    TrajectoryPose p;
    p.frame = static_cast<int>(10 + k);
    p.world_from_camera = pose;
    out.poses.push_back(p);
    pose = pose * SE3(rotation_from_vector({0.0, 0.004, 0.0}), Eigen::Vector3d(0, 0, step));
  }
  out.metric = true;
  out.whole.length = step * static_cast<double>(frames - 1);
  return out;
}

/// Positions of it on a map that lies turned and elsewhere, each off by its own.
MapPositions on_map(const Trajectory& trajectory, double log_scale, double sigma, std::size_t every,
                    const CounterRandom& random) {
  MapPositions out;
  out.level_from_world << 0, 0, 1, -1, 0, 0, 0, -1, 0;  // y is down
  const Eigen::Matrix3d turn =
      Eigen::AngleAxisd(1.1, Eigen::Vector3d::UnitZ()).toRotationMatrix() * out.level_from_world;
  std::uint64_t draw = 0;
  for (std::size_t k = 0; k < trajectory.poses.size(); k += every) {
    const Eigen::Vector3d place = trajectory.poses[k].world_from_camera.translation();
    Eigen::Vector3d position =
        Eigen::Vector3d(4.5e5, 5.4e6, 120.0) + std::exp(log_scale) * (turn * place);
    for (int i = 0; i < 3; ++i) position[i] += sigma * random.normal(draw++);
    out.at.push_back({k, position, sigma, sigma});
  }
  return out;
}

TEST(PositionScale, ExactPositionsGiveTheScale) {
  for (const double log_scale : {0.0, 0.05, -0.2}) {
    const Trajectory drive = curved(200, log_scale);
    MapPositions positions = on_map(drive, log_scale, 0.0, 10, CounterRandom(1));
    for (auto& at : positions.at) at.sigma = at.height_sigma = 0.01;
    const auto found = scale_by_positions(drive, positions);
    ASSERT_TRUE(found.has_value());
    EXPECT_NEAR(found->log_scale, log_scale, 1e-6);
    EXPECT_LT(found->sigma, 0.003);
  }
}

TEST(PositionScale, ErrsNoMoreThanItStates) {
  constexpr int kDraws = 60;
  double squares = 0.0;
  for (int d = 0; d < kDraws; ++d) {
    const Trajectory drive = curved(300, 0.03);
    const auto found = scale_by_positions(
        drive, on_map(drive, 0.03, 1.0, 100, CounterRandom(7 + static_cast<std::uint64_t>(d))));
    ASSERT_TRUE(found.has_value());
    squares += std::pow((found->log_scale - 0.03) / found->sigma, 2);
  }
  EXPECT_LT(squares / kDraws, 1.5);  // cautious, and no more than so
  EXPECT_GT(squares / kDraws, 0.2);
}

TEST(PositionScale, OneJumpOfTheReceiverDoesNotMatter) {
  const Trajectory drive = curved(200, 0.0);
  MapPositions positions = on_map(drive, 0.0, 0.5, 5, CounterRandom(3));
  const double without = scale_by_positions(drive, positions)->log_scale;
  positions.at[17].position += Eigen::Vector3d(60.0, -40.0, 0.0);
  const auto found = scale_by_positions(drive, positions);
  ASSERT_TRUE(found.has_value());
  EXPECT_NEAR(found->log_scale, without, 2.0 * found->sigma);
}

TEST(PositionScale, TooShortAWayTellsNothing) {
  const Trajectory drive = curved(6, 0.0);
  EXPECT_FALSE(scale_by_positions(drive, on_map(drive, 0.0, 2.5, 1, CounterRandom(4))));
  EXPECT_FALSE(scale_by_positions(drive, {}));
}

TEST(PositionScale, JoinsWhatAgreesAndWidensWhatDoesNot) {
  Trajectory drive = curved(200, 0.0);
  drive.common_sigma = 0.02;
  const JoinedScale agreeing = joined_scale(drive, {0.02, 0.01, 1});
  EXPECT_NEAR(agreeing.log_scale, 0.016, 1e-9);
  EXPECT_LT(agreeing.common_sigma, 0.01);
  const JoinedScale contradicting = joined_scale(drive, {0.2, 0.01, 1});
  EXPECT_EQ(contradicting.log_scale, 0.0);
  EXPECT_GT(contradicting.common_sigma, 0.2);
  EXPECT_GT(contradicting.disagreement_sigmas, 3.0);
  drive.metric = false;
  const JoinedScale alone = joined_scale(drive, {0.2, 0.01, 1});
  EXPECT_EQ(alone.log_scale, 0.2);
  EXPECT_NEAR(alone.common_sigma, 0.01, 1e-9);
}

/// Windows of three frames whose motion turns by a little too much at each step: a drive that
/// bends away from the truth.
std::vector<WindowMeasurement> bending_windows(const Trajectory& truth, double bend) {
  std::vector<WindowMeasurement> out;
  for (std::size_t k = 1; k + 1 < truth.poses.size(); ++k) {
    WindowMeasurement w;
    w.reference = truth.poses[k].frame;
    const SE3 from_reference = truth.poses[k].world_from_camera;
    for (const std::size_t i : {k - 1, k, k + 1}) {
      w.frames.push_back(truth.poses[i].frame);
      const double by = bend * (static_cast<double>(k) - static_cast<double>(i));
      const SE3 exact = truth.poses[i].world_from_camera.inverse() * from_reference;
      w.frame_from_reference.push_back(
          SE3(rotation_from_vector({0.0, by, 0.0}), Eigen::Vector3d::Zero()) * exact);
    }
    w.covariance = Eigen::MatrixXd::Identity(12, 12) * 1e-6;
    w.log_scale = 0.0;
    w.scale_sigma = 0.01;
    out.push_back(std::move(w));
  }
  return out;
}

TEST(PositionScale, PositionsHoldADriveThatBendsAway) {
  const Trajectory truth = curved(400, 0.0);
  std::vector<int> ids;
  std::vector<double> times;
  for (const TrajectoryPose& pose : truth.poses) {
    ids.push_back(pose.frame);
    times.push_back(static_cast<double>(ids.size()) / kRate);
  }
  const std::vector<WindowMeasurement> windows = bending_windows(truth, 2e-4);
  const Trajectory alone = smooth_trajectory(ids, windows, {}, times);
  DriveOnMap map;
  map.positions = on_map(truth, 0.0, 0.3, 10, CounterRandom(5));
  map.common_sigma = 0.01;
  const Trajectory held = smooth_trajectory(ids, windows, {}, times, &map);
  const auto off = [&](const Trajectory& t) {
    return (t.poses.back().world_from_camera.translation() -
            truth.poses.back().world_from_camera.translation())
        .norm();
  };
  EXPECT_GT(off(alone), 8.0);
  // The world is the first camera, whose direction is known by what follows it alone.
  EXPECT_LT(off(held), 0.5 * off(alone));
  EXPECT_EQ(held.common_sigma, 0.01);
}

}  // namespace
}  // namespace camber
