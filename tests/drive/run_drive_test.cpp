// The whole of a drive on the embedded sample, at half its size.

#include "camber/drive/run_drive.h"

#include <gtest/gtest.h>
#include <sys/inotify.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <map>
#include <nlohmann/json.hpp>

#include "camber/core/errors.h"
#include "camber/drive/position_scale.h"
#include "camber/drive/write_drive.h"
#include "camber/evaluate/metrics.h"
#include "pipeline/half_scene.h"
#include "support/test_data.h"

namespace camber {
namespace {

class RunDrive : public ::testing::Test {
 protected:
  RunDrive()
      : scene_(test::half_size(read_scene(test::source_dir() / "samples" / "steep_hill"),
                               folder_.path())) {
    options_.each_side = 1;
    options_.window.num_threads = 1;
  }

  DriveResult run(const std::string& log_name, const Progress& progress = {}) {
    WindowLog log(folder_.path() / log_name, header_, true);
    return run_drive(scene_, {0, 1, 2}, options_, &log, progress);
  }

  static std::string numbers_of(const DriveResult& result) {
    return to_json(result.document).dump() + to_json(result.tracks).dump() +
           std::to_string(result.strip.cells.size());
  }

  test::TemporaryFolder folder_;
  Scene scene_;
  DriveOptions options_;
  const nlohmann::json header_ = {{"test", 1}};
};

TEST_F(RunDrive, GivesTheDriveItsLengthRoadAndVehicles) {
  const DriveResult result = run("windows.log");
  ASSERT_EQ(result.document.frames.size(), 3U);
  EXPECT_TRUE(result.trajectory.metric);
  double truth = 0.0;
  for (std::size_t k = 1; k < 3; ++k) {
    truth += (scene_.truth->frames[k].world_from_camera->translation() -
              scene_.truth->frames[k - 1].world_from_camera->translation())
                 .norm();
  }
  const Trajectory::Stretch& whole = result.trajectory.whole;
  EXPECT_NEAR(whole.length, truth, 3.0 * whole.sigma());
  EXPECT_LT(whole.sigma() / whole.length, 0.05);
  EXPECT_NEAR(result.document.height.value, *scene_.height_above_road,
              3.0 * result.document.height.sigma);
  // What all windows see of the road is where the truth has it, under the vehicles as well.
  EXPECT_GT(result.strip.cells.size(), 300U);
  const auto vehicles =
      std::count_if(result.tracks.vehicles.frames.begin(), result.tracks.vehicles.frames.end(),
                    [](const VehicleFrame& frame) { return !frame.vehicles.empty(); });
  EXPECT_EQ(vehicles, 3);
  EXPECT_LT(result.tracks.tracks.size(), 8U);  // of 13 detections
}

/// Counts how often files of a folder are opened.
class OpenCounter {
 public:
  explicit OpenCounter(const std::filesystem::path& folder) : queue_(inotify_init1(IN_NONBLOCK)) {
    watched_ = queue_ >= 0 && inotify_add_watch(queue_, folder.c_str(), IN_OPEN) >= 0;
  }
  ~OpenCounter() {
    if (queue_ >= 0) close(queue_);
  }
  OpenCounter(const OpenCounter&) = delete;
  OpenCounter& operator=(const OpenCounter&) = delete;

  bool watched() const { return watched_; }

  /// Since the last call, by the file's name.
  std::map<std::string, int> counts() {
    std::map<std::string, int> out;
    std::array<char, 1 << 16> events{};
    for (ssize_t size = 0; (size = read(queue_, events.data(), events.size())) > 0;) {
      for (ssize_t at = 0; at < size;) {
        inotify_event event{};
        std::memcpy(&event, events.data() + at, sizeof event);
        if (event.len > 0) ++out[events.data() + at + sizeof event];
        at += static_cast<ssize_t>(sizeof event + event.len);
      }
    }
    return out;
  }

 private:
  int queue_;
  bool watched_ = false;
};

TEST_F(RunDrive, AnImageIsReadOnceForAllWindows) {
  const std::filesystem::path first = scene_.frames[0].image;
  OpenCounter opened(first.parent_path());
  if (!opened.watched()) GTEST_SKIP() << "no inotify here";
  stages::FrameLoader(scene_, {}).load(scene_.frames[0].id);
  const int once = opened.counts()[first.filename()];
  ASSERT_GT(once, 0);
  ASSERT_GT(run("windows.log").trajectory.poses.size(), 2U);
  const std::map<std::string, int> counts = opened.counts();
  for (const SceneFrame& frame : scene_.frames) {
    const auto count = counts.find(frame.image.filename());
    ASSERT_NE(count, counts.end()) << frame.image;
    EXPECT_EQ(count->second, once) << frame.image;
  }
}

TEST_F(RunDrive, WhatItsWindowsShareIsBySourcesAndLens) {
  for (SceneFrame& frame : scene_.frames) frame.vehicles.clear();  // sizes that know the scale
  scene_.markings_m.clear();
  scene_.height_sigma = 0.06 * *scene_.height_above_road;
  const double by_height = run("height.log").trajectory.common_sigma;
  EXPECT_GT(by_height, 0.04);
  // A lens that was guessed is the same in every window: it does not average out.
  scene_.camera_sigma.focal = 0.08;
  EXPECT_GT(run("lens.log").trajectory.common_sigma, std::hypot(by_height, 0.05));
  // Speeds say more than such a height, and do not hang on the lens.
  scene_.camera_sigma.focal = 0.0;
  for (std::size_t k = 0; k < 3; ++k) {
    const std::size_t other = k < 2 ? k + 1 : k - 1;
    const double step = (scene_.truth->frames[k].world_from_camera->translation() -
                         scene_.truth->frames[other].world_from_camera->translation())
                            .norm();
    scene_.frames[k].speed = step * scene_.frame_rate.value_or(10.0);
    scene_.frames[k].speed_sigma = 0.01 * *scene_.frames[k].speed;
  }
  const Trajectory fast = run("speed.log").trajectory;
  EXPECT_LT(fast.common_sigma, 0.02);
  EXPECT_GT(fast.common_sigma, 0.002);
}

TEST_F(RunDrive, PositionsThatContradictItAreNotFollowed) {
  const double alone = run("alone.log").trajectory.whole.length;
  const auto with_positions = [&](double factor, const std::string& log) {
    for (std::size_t k = 0; k < 3; ++k) {
      // On the map x is east and z north: the camera looks there, level but for the hill.
      const Eigen::Vector3d at = scene_.truth->frames[k].world_from_camera->translation();
      MapPosition position;
      position.position = {5e5 + factor * at.x(), 5e6 + factor * at.z(), 100.0 - factor * at.y()};
      position.sigma = 0.01;
      position.height_sigma = 0.01;
      scene_.frames[k].map_position = position;
    }
    return run(log);
  };
  const DriveResult agreeing = with_positions(1.0, "agreeing.log");
  ASSERT_TRUE(agreeing.document.positions.has_value());
  EXPECT_LT(agreeing.document.positions->disagreement_sigmas, kMostPositionSigmas);
  const DriveResult contradicting = with_positions(1.5, "contradicting.log");
  ASSERT_TRUE(contradicting.document.positions.has_value());
  EXPECT_GT(contradicting.document.positions->disagreement_sigmas, kMostPositionSigmas);
  EXPECT_NEAR(contradicting.trajectory.whole.length, alone, 1e-6 * alone);
  EXPECT_GT(contradicting.trajectory.common_sigma, 0.3);
}

TEST_F(RunDrive, AnInterruptedOneGoesOnToTheSameNumbers) {
  const std::string whole = numbers_of(run("whole.log"));
  // Stopped when the third frame is about to be read: the first window is measured by then.
  const Progress stop = [](const std::string& stage, double share) {
    if (stage == "windows" && share > 0.5) throw InterruptedError();
  };
  EXPECT_THROW(run("part.log", stop), InterruptedError);
  {
    const WindowLog log(folder_.path() / "part.log", header_, true);
    EXPECT_TRUE(log.has_window(0));
    EXPECT_FALSE(log.has_window(2));
  }
  EXPECT_EQ(numbers_of(run("part.log")), whole);
  options_.window.num_threads = 3;
  EXPECT_EQ(numbers_of(run("threads.log")), whole);
}

TEST_F(RunDrive, NamesFramesThatCannotBeRead) {
  scene_.frames[2].image = folder_.path() / "missing.png";
  const DriveResult result = run("windows.log");
  ASSERT_EQ(result.document.frames.size(), 3U);
  EXPECT_EQ(result.document.frames[2].status, Status::kWeak);
  EXPECT_NE(result.document.frames[2].reason.find("missing.png"), std::string::npos);
  EXPECT_EQ(result.document.frames[1].status, Status::kOk);
  // Its vehicles are placed all the same, by keypoints, boxes and sizes.
  const std::vector<VehicleFrame>& frames = result.tracks.vehicles.frames;
  ASSERT_EQ(frames.size(), 3U);
  EXPECT_FALSE(scene_.frames[2].vehicles.empty());
  for (std::size_t k = 0; k < 3; ++k) {
    EXPECT_EQ(frames[k].vehicles.size(), scene_.frames[k].vehicles.size()) << k;
  }
  const SceneMetrics against = evaluate_vehicles(scene_, result.tracks.vehicles);
  EXPECT_EQ(against.unanswered, 0);
}

TEST_F(RunDrive, FramesOfWhichNoneCanBeReadAreNamed) {
  for (SceneFrame& frame : scene_.frames) frame.image = folder_.path() / "missing.png";
  try {
    run("windows.log");
    FAIL() << "no images, no drive";
  } catch (const NoAnswerError& error) {
    EXPECT_NE(std::string(error.what()).find("missing.png"), std::string::npos) << error.what();
  }
}

TEST_F(RunDrive, ACameraThatNeverMovesIsNoDrive) {
  for (SceneFrame& frame : scene_.frames) frame.image = scene_.frames[0].image;
  EXPECT_THROW(run("windows.log"), NoAnswerError);
}

}  // namespace
}  // namespace camber
