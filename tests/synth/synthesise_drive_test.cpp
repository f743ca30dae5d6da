// Whole made drives: poses, truth, traffic.

#include "camber/synth/synthesise_drive.h"

#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>

#include "camber/image/image_io.h"
#include "camber/scene/scene.h"
#include "camber/synth/detail/drive_motion.h"
#include "camber/synth/detail/drive_road.h"
#include "camber/synth/detail/side_limits.h"
#include "support/test_data.h"

namespace camber {
namespace {

constexpr double kPi = 3.14159265358979323846;

/// A drive in small, that takes little time.
SynthDriveOptions small_drive(std::uint64_t seed, int frames) {
  SynthDriveOptions out;
  out.scene.seed = seed;
  out.scene.num_frames = frames;
  out.scene.camera = {160, 64, 95.0, 95.0, 79.5, 27.5};
  out.scene.sensor.supersampling = 1;
  out.cloud_density = 20.0;
  return out;
}

std::string read_file(const std::filesystem::path& path) { return test::read_text(path); }

TEST(DriveRoad, StaysWithinItsFirstDirectionAndSuitsTheSpeed) {
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    const double speed = 5.0 + static_cast<double>(seed);
    const RoadProfile road = draw_drive_road(seed, 2000.0, speed);
    double sharpest = 0.0, turned = 0.0;
    for (double s = 0.0; s < 2000.0; s += 2.0) {
      EXPECT_LT(std::abs(road.heading(s)), 80.0 / 180.0 * kPi) << seed << " at " << s;
      sharpest = std::max(sharpest, std::abs(road.curvature(s)));
      turned += 2.0 * std::abs(road.curvature(s));
    }
    EXPECT_LT(sharpest, 1.0 / 12.0);
    EXPECT_GT(turned, 0.5) << seed;
    EXPECT_GT(road.min_vertical_radius(), 60.0);
  }
}

TEST(DriveRoad, GroundOfBendsEndsBeforeItMeetsItself) {
  const RoadProfile road = draw_drive_road(4, 1500.0, 6.0);
  const SideLimits limits(road);
  const auto at = [&](double s, int side, double share) {
    const double heading = road.heading(s);
    const double offset = (side == 0 ? 1.0 : -1.0) * share * std::min(limits.at(s, side), 52.0);
    return Eigen::Vector2d(road.center(s).head<2>() +
                           offset * Eigen::Vector2d(-std::sin(heading), std::cos(heading)));
  };
  double least = 1e9;
  for (int side = 0; side < 2; ++side) {
    for (double s = 0.0; s < 1500.0; s += 2.0) {
      // The edge goes on ahead, and does not come near other stretches' middle.
      const double heading = road.heading(s);
      const Eigen::Vector2d ahead(std::cos(heading), std::sin(heading));
      EXPECT_GT(ahead.dot(at(s + 0.5, side, 1.0) - at(s, side, 1.0)), 0.0) << s;
      for (double other = 0.0; other < 1500.0; other += 4.0) {
        if (std::abs(other - s) < 10.0) continue;
        least = std::min(least, (at(s, side, 1.0) - at(other, side, 0.0)).norm());
      }
    }
  }
  EXPECT_GT(least, 3.0);
}

TEST(DriveMotion, StandsBrakesAndPitches) {
  const RoadProfile road = draw_drive_road(2, 600.0, 9.0);
  const std::vector<DriveState> states = drive_along(road, {2, 500, 10.0, 9.0, 2});
  int standing = 0, stops = 0;
  double fastest = 0.0, nose_down = 0.0, braking = 0.0;
  for (std::size_t i = 1; i < states.size(); ++i) {
    const double step = states[i].station - states[i - 1].station;
    EXPECT_GE(step, 0.0);
    standing += states[i].speed == 0.0 ? 1 : 0;
    stops += states[i].speed == 0.0 && states[i - 1].speed > 0.0 ? 1 : 0;
    fastest = std::max(fastest, states[i].speed);
    nose_down = std::min(nose_down, states[i].pitch);
    braking = std::min(braking, (states[i].speed - states[i - 1].speed) * 10.0);
  }
  EXPECT_EQ(stops, 2);
  EXPECT_GE(standing, 25);  // at least 1.5 s each
  EXPECT_GT(fastest, 5.0);
  EXPECT_LT(fastest, 11.0);
  EXPECT_LT(braking, -1.0);
  EXPECT_LT(nose_down, -0.1 * kPi / 180.0);
  EXPECT_GT(nose_down, -2.0 * kPi / 180.0);
}

TEST(DriveRoad, FollowsAPath) {
  // Three quarters of a circle of 40 m, climbing, with a standstill; camera axes.
  std::vector<SE3> poses;
  double driven = 0.0;
  for (int i = 0; i < 250; ++i) {
    if (i < 100 || i > 120) driven += 0.8;
    const double a = driven / 40.0;
    const Eigen::Vector3d place(40.0 * (1.0 - std::cos(a)), -0.03 * driven, 40.0 * std::sin(a));
    poses.emplace_back(Eigen::Quaterniond(Eigen::AngleAxisd(a, Eigen::Vector3d::UnitY())), place);
  }
  const FollowedRoad road = follow_path(poses, 0.0);
  ASSERT_EQ(road.stations.size(), poses.size());
  EXPECT_EQ(road.stations[105], road.stations[115]);
  double worst = 0.0;
  for (std::size_t i = 0; i < poses.size(); ++i) {
    const Eigen::Vector3d p = poses[0].inverse() * poses[i].translation();
    const Eigen::Vector3d q = road.profile.center(road.stations[i]);
    // Both begin along x: the first half metre's direction is that of the smoothed path.
    worst = std::max(worst, (Eigen::Vector3d(p.z(), -p.x(), -p.y()) - q).norm());
  }
  EXPECT_LT(worst, 6.0);  // of 184 m; a road of its own with that shape
  EXPECT_NEAR(road.stations.back(), driven - 0.8, 1.5);
  EXPECT_NEAR(road.profile.grade(60.0), std::atan(0.03), 2e-3);
  EXPECT_NEAR(road.profile.curvature(80.0), -1.0 / 40.0, 2e-3);
  // Driven in the right lane of a bend to the right, the road is the larger circle.
  const FollowedRoad beside = follow_path(poses, -2.0);
  EXPECT_NEAR(beside.profile.curvature(80.0), -1.0 / 42.0, 2e-3);
  EXPECT_NEAR(beside.stations.back(), 42.0 / 40.0 * road.stations.back(), 0.5);
}

class MadeDrive : public ::testing::Test {
 protected:
  std::filesystem::path make(const SynthDriveOptions& options, const std::string& name) {
    summary_ = synthesise_drive(options, folder_.path() / name);
    return folder_.path() / name;
  }
  test::TemporaryFolder folder_;
  SynthDriveSummary summary_;
};

TEST_F(MadeDrive, HasTruthThatAgreesWithItself) {
  SynthDriveOptions options = small_drive(5, 130);
  options.standstills = 1;
  const Scene scene = read_scene(make(options, "drive"));
  ASSERT_EQ(scene.frames.size(), 130u);
  EXPECT_EQ(scene.height_above_road, 1.65);
  EXPECT_EQ(scene.height_sigma, 0.02);
  EXPECT_NE(summary_.true_height, 1.65);
  EXPECT_LT(std::abs(summary_.true_height - 1.65), 3.01 * 0.02);
  const std::vector<TruthFrame>& frames = scene.truth->frames;
  double length = 0.0, height = 0.0;
  int standing = 0;
  std::map<int, Eigen::Vector3d> parked;
  std::map<int, int> seen;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    const SE3& pose = *frames[i].world_from_camera;
    height += frames[i].ego_plane->offset / static_cast<double>(frames.size());
    if (i > 0) {
      const SE3 step = frames[i - 1].world_from_camera->inverse() * pose;
      length += step.translation().norm();
      if (step.translation().norm() < 1e-9) {
        ++standing;
      } else {
        EXPECT_GT(step.translation().z(), 0.5 * step.translation().norm());
      }
      EXPECT_LT(step.translation().norm(), 1.3);
    }
    for (const TruthVehicle& vehicle : frames[i].vehicles) {
      ++seen[vehicle.id];
      if (vehicle.moving) continue;
      const Eigen::Vector3d place = pose * vehicle.pose.bottom_center();
      const auto [known, fresh] = parked.emplace(vehicle.id, place);
      if (!fresh) {
        EXPECT_LT((known->second - place).norm(), 1e-6) << vehicle.id;
      }
    }
  }
  EXPECT_NEAR(length, summary_.length, 1e-6);
  EXPECT_GE(standing, 12);
  EXPECT_GT(length, 30.0);
  EXPECT_NEAR(height, summary_.true_height, 0.01);
  EXPECT_GT(seen.size(), 3u);
  EXPECT_GT(parked.size(), 2u);
}

TEST_F(MadeDrive, IsTheSameForAnyNumberOfThreadsAndAnotherForAnotherSeed) {
  SynthDriveOptions options = small_drive(6, 60);
  options.scene.num_threads = 1;
  const auto one = make(options, "one");
  options.scene.num_threads = 3;
  const auto three = make(options, "three");
  for (const char* file : {"scene.json", "truth/road.ply", "image/000000.png", "image/000059.png",
                           "segmentation/000059.png", "truth/label/000031.png"}) {
    EXPECT_FALSE(read_file(one / file).empty()) << file;
    EXPECT_EQ(read_file(one / file), read_file(three / file)) << file;
  }
  options.scene.seed = 7;
  options.scene.num_frames = 2;
  EXPECT_NE(read_file(make(options, "other") / "image/000000.png"),
            read_file(one / "image/000000.png"));
}

TEST_F(MadeDrive, StandsStillOnlyWhereItIsAskedTo) {
  SynthDriveOptions options = small_drive(8, 100);
  options.standstills = 0;
  options.traffic = 0.0;
  const Scene scene = read_scene(make(options, "drive"));
  const std::vector<TruthFrame>& frames = scene.truth->frames;
  for (std::size_t i = 1; i < frames.size(); ++i) {
    const SE3 step = frames[i - 1].world_from_camera->inverse() * *frames[i].world_from_camera;
    EXPECT_GT(step.translation().norm(), 0.1) << i;
    EXPECT_TRUE(frames[i].vehicles.empty());
  }
}

// A place that is near in the last frame of a stretch of the world and in the first one of the next
// looks alike in both: its ground is one.
TEST_F(MadeDrive, StretchesOfTheWorldFitTogether) {
  SynthDriveOptions options = small_drive(9, 90);
  options.standstills = 0;
  options.traffic = 0.0;
  options.scene.sensor.noise = 0.0;
  options.scene.sensor.exposure_change = 0.0;
  const auto folder = make(options, "drive");
  // Labels change from frame to frame by as little everywhere, also from stretch to stretch.
  std::vector<double> changes;
  std::vector<std::uint8_t> before;
  for (int i = 0; i < 90; ++i) {
    char name[40];
    std::snprintf(name, sizeof name, "truth/label/%06d.png", i);
    const Image labels = read_gray_image(folder / name);
    if (!before.empty()) {
      int differ = 0;
      for (std::size_t k = 0; k < before.size(); ++k) differ += labels.data[k] != before[k];
      changes.push_back(differ / static_cast<double>(before.size()));
    }
    before = labels.data;
  }
  for (std::size_t i = 1; i + 1 < changes.size(); ++i) {
    EXPECT_LT(changes[i], 0.05 + 2.0 * std::max(changes[i - 1], changes[i + 1])) << i;
  }
}

TEST_F(MadeDrive, OptionsAreChecked) {
  const auto refused = [&](auto change) {
    SynthDriveOptions options = small_drive(1, 10);
    change(options);
    EXPECT_THROW(options.validate(), std::invalid_argument);
  };
  refused([](SynthDriveOptions& o) { o.scene.num_frames = 1; });
  refused([](SynthDriveOptions& o) { o.scene.speed = 0.0; });
  refused([](SynthDriveOptions& o) { o.height_sigma = -0.1; });
  refused([](SynthDriveOptions& o) { o.path.emplace(3); });
  refused([](SynthDriveOptions& o) { o.scene.features.corner.enabled = true; });
  refused([](SynthDriveOptions& o) { o.scene.layout.layout = SceneLayout::kSynthiaSf; });
  EXPECT_NO_THROW(small_drive(1, 5000).validate());
}

}  // namespace
}  // namespace camber
