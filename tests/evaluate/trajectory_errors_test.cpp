// Errors of trajectories: by hand, against numpy, and what is no trajectory of the camera.

#include "camber/evaluate/trajectory_errors.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>

#include "camber/core/errors.h"
#include "camber/core/random.h"
#include "camber/evaluate/trajectory_files.h"
#include "camber/scene/drive_document.h"
#include "support/test_data.h"

namespace camber {
namespace {

using Eigen::Vector3d;
using nlohmann::json;
using ::testing::HasSubstr;
namespace fs = std::filesystem;

/// A drive over a hill and through bends, one metre a frame.
std::vector<SE3> made_path(int frames) {
  std::vector<SE3> out(1);
  for (int i = 1; i < frames; ++i) {
    const Vector3d turn(0.004 * std::sin(0.03 * i), 0.02 * std::sin(0.05 * i), 0.001);
    out.push_back(out.back() * SE3(rotation_from_vector(turn), Vector3d(0.01, -0.02, 1.0)));
  }
  return out;
}

/// The same drive with steps of another length and a drift in direction.
std::vector<SE3> estimated_path(const std::vector<SE3>& truth, double scale, double drift) {
  std::vector<SE3> out(1);
  for (std::size_t i = 1; i < truth.size(); ++i) {
    SE3 step = truth[i - 1].inverse() * truth[i];
    const double own = 1.0 + 0.02 * std::sin(0.11 * static_cast<double>(i));
    step.set_translation(scale * own * step.translation());
    out.push_back(out.back() *
                  SE3(rotation_from_vector(Vector3d(0.0, drift, 0.3 * drift)) * step.rotation(),
                      step.translation()));
  }
  return out;
}

std::vector<ComparedPose> compared(const std::vector<SE3>& truth,
                                   const std::vector<SE3>& estimate) {
  std::vector<ComparedPose> out;
  for (std::size_t i = 0; i < truth.size(); ++i) {
    out.push_back({static_cast<int>(i), truth[i], estimate[i]});
  }
  return out;
}

TEST(TrajectoryErrors, OfTheTruthItselfAreNone) {
  const std::vector<SE3> path = made_path(300);
  const SE3 elsewhere(rotation_from_vector(Vector3d(0.3, -1.0, 0.2)), Vector3d(10, 20, 30));
  std::vector<SE3> moved;
  for (const SE3& pose : path) moved.push_back(elsewhere * pose);
  const TrajectoryErrors e = trajectory_errors(compared(path, moved));
  EXPECT_EQ(e.posed, 300);
  EXPECT_NEAR(e.true_length, 299.0, 0.1);
  EXPECT_NEAR(e.length_error, 0.0, 1e-12);
  EXPECT_NEAR(e.every_nth.all.translation, 0.0, 1e-12);
  EXPECT_NEAR(e.every_frame.all.rotation, 0.0, 1e-12);
  EXPECT_EQ(e.every_nth.by_length.size(), 2u);  // 100 and 200 m
  EXPECT_FALSE(e.every_nth.half);
  EXPECT_EQ(e.windows.windows.size(), 25u);  // 50 steps from 0, 10, ... 240 (299 is the last)
  EXPECT_NEAR(e.unaligned.ate_max, 0.0, 1e-9);
  EXPECT_NEAR(e.with_scale.scale, 1.0, 1e-12);
}

TEST(TrajectoryErrors, OfAStraightDriveThatIsAPercentTooLong) {
  std::vector<SE3> truth, estimate;
  for (int i = 0; i <= 120; ++i) {
    truth.emplace_back(Eigen::Quaterniond::Identity(), Vector3d(0, 0, i));
    estimate.emplace_back(Eigen::Quaterniond::Identity(), Vector3d(0, 0, 1.01 * i));
  }
  const TrajectoryErrors e = trajectory_errors(compared(truth, estimate));
  EXPECT_NEAR(e.length_error, std::log(1.01), 1e-12);
  // From 0 and 10 to the first frame beyond 100 m: 101 m, whose error is over the nominal 100.
  EXPECT_EQ(e.every_nth.all.count, 2);
  EXPECT_NEAR(e.every_nth.all.translation, 0.0101, 1e-12);
  ASSERT_TRUE(e.every_nth.half);
  EXPECT_NEAR(e.every_nth.half->length, 60.0, 1e-12);
  EXPECT_NEAR(e.every_nth.half->translation, 0.61 / 60.0, 1e-12);
  EXPECT_NEAR(e.unaligned.ate_max, 1.2, 1e-9);
  EXPECT_NEAR(e.rigid.ate_max, 0.6, 1e-9);  // the middles laid upon each other
  EXPECT_NEAR(e.with_scale.ate_max, 0.0, 1e-9);
  EXPECT_NEAR(e.with_scale.scale, 1.0 / 1.01, 1e-12);
  EXPECT_NEAR(e.rigid.rpe_translation, 0.01, 1e-12);
  EXPECT_NEAR(e.with_scale.rpe_translation, 0.0, 1e-12);
}

TEST(TrajectoryErrors, FramesWithoutAPoseAreBridgedAndCounted) {
  const std::vector<SE3> path = made_path(130);
  std::vector<ComparedPose> poses = compared(path, path);
  for (const int i : {0, 1, 2, 60}) poses[static_cast<std::size_t>(i)].estimate.reset();
  const TrajectoryErrors e = trajectory_errors(poses);
  EXPECT_EQ(e.frames, 130);
  EXPECT_EQ(e.posed, 126);
  EXPECT_NEAR(e.length_error, 0.0, 1e-12);
  EXPECT_EQ(e.every_nth.all.unanswered, 1);  // the one from frame 0
  EXPECT_EQ(e.windows.windows.front().first, 3);
  EXPECT_EQ(e.windows.unanswered, 0);
  for (std::size_t i = 1; i < poses.size(); ++i) poses[i].estimate.reset();
  EXPECT_THROW(trajectory_errors(poses), NoAnswerError);
}

TEST(TrajectoryErrors, ACameraThatStandsHasNoScale) {
  std::vector<SE3> truth(120), estimate(120);
  const TrajectoryErrors e = trajectory_errors(compared(truth, estimate));
  EXPECT_TRUE(std::isnan(e.length_error));
  EXPECT_EQ(e.windows.stationary, 7);
  EXPECT_TRUE(e.windows.windows.empty());
}

TEST(TrajectoryErrors, OptionsAreChecked) {
  const std::vector<SE3> path = made_path(10);
  TrajectoryErrorOptions options;
  options.every = 0;
  EXPECT_THROW(trajectory_errors(compared(path, path), options), std::invalid_argument);
}

/// The first python3 that has numpy (a newer one in the PATH may lack Debian's); empty: none.
std::string python_with_numpy() {
  for (const std::string python : {"python3", "/usr/bin/python3"}) {
    if (std::system((python + " -c 'import numpy' >/dev/null 2>&1").c_str()) == 0) return python;
  }
  return "";
}

class TrajectoryFiles : public ::testing::Test {
 protected:
  std::string path(const std::string& name) const { return (folder_.path() / name).string(); }

  void write_kitti(const std::string& name, const std::vector<SE3>& poses) const {
    std::ofstream out(path(name));
    for (const SE3& pose : poses) {
      const Eigen::Matrix4d m = pose.matrix();
      for (int i = 0; i < 12; ++i) {
        out << fmt::format("{:.17g}{}", m(i / 4, i % 4), i == 11 ? '\n' : ' ');
      }
    }
  }

  void write_tum(const std::string& name, const std::vector<SE3>& poses, double start) const {
    std::ofstream out(path(name));
    out << "# timestamp tx ty tz qx qy qz qw\n";
    for (std::size_t i = 0; i < poses.size(); ++i) {
      const Vector3d t = poses[i].translation();
      const Eigen::Quaterniond q = poses[i].rotation();
      out << fmt::format("{:.6f} {} {} {} {} {} {} {}\n", start + 0.1 * static_cast<double>(i),
                         t.x(), t.y(), t.z(), q.x(), q.y(), q.z(), q.w());
    }
  }

  void write_times(const std::string& name, std::size_t count) const {
    std::ofstream out(path(name));
    for (std::size_t i = 0; i < count; ++i) out << 0.1 * static_cast<double>(i) << "\n";
  }

  /// A drive.json with gaps and windows.
  void write_drive(const std::string& name, const std::vector<SE3>& poses) const {
    DriveDocument drive;
    drive.common_sigma = 0.01;
    const CounterRandom random(3, 0);
    double length = 0.0;
    for (std::size_t i = 0; i < poses.size(); ++i) {
      DriveFrame frame;
      frame.id = static_cast<int>(i);
      frame.status = Status::kOk;
      if (i > 1 && i != 77) frame.world_from_camera = poses[i];
      drive.frames.push_back(frame);
      if (i > 2) length += (poses[i].translation() - poses[i - 1].translation()).norm();
    }
    drive.length = length;
    drive.length_sigma = 0.013 * length;
    for (int first = 2; first + 50 < static_cast<int>(poses.size()); first += 10) {
      const double own = 0.015 + 0.01 * random.uniform(static_cast<std::uint64_t>(first));
      drive.windows.push_back({first, first + 50, 50.0, 50.0 * own});
    }
    std::ofstream(path(name)) << to_json(drive);
  }

  static void expect_same(const json& expected, const json& found, const std::string& where) {
    for (const auto& [key, value] : expected.items()) {
      ASSERT_TRUE(found.contains(key)) << where << key;
      if (value.is_object()) {
        expect_same(value, found[key], where + key + ".");
      } else if (value.is_number() && found[key].is_number()) {
        EXPECT_NEAR(found[key].get<double>(), value.get<double>(), 1e-9) << where << key;
      } else {
        EXPECT_EQ(found[key], value) << where << key;
      }
    }
  }

  test::TemporaryFolder folder_;
};

TEST_F(TrajectoryFiles, AgreeWithNumpy) {
  const std::string python = python_with_numpy();
  if (python.empty()) GTEST_SKIP() << "no python3 with numpy";
  for (const int frames : {140, 420}) {  // with sub-paths of half the drive, and up to 400 m
    const std::vector<SE3> truth = made_path(frames);
    write_kitti("truth.txt", truth);
    write_drive("drive.json", estimated_path(truth, 1.013, 2e-4));
    const std::string script =
        (test::source_dir() / "tests/evaluate/trajectory_reference.py").string();
    ASSERT_EQ(std::system((python + " -B '" + script + "' '" + path("truth.txt") + "' '" +
                           path("drive.json") + "' > '" + path("expected.json") + "'")
                              .c_str()),
              0);
    const json expected = json::parse(std::ifstream(path("expected.json")));
    EvaluatedTrajectory found;
    const ComparedTrajectory compared = read_compared_trajectory(
        path("drive.json"), read_true_trajectory(path("truth.txt"), ""), LogSink{});
    found.errors = trajectory_errors(compared.poses, compared.options);
    expect_same(expected, to_json(found), std::to_string(frames) + " frames: ");
    EXPECT_GT(expected["windows"]["count"].get<int>(), 5);
  }
}

TEST_F(TrajectoryFiles, TumIsFoundByTime) {
  const std::vector<SE3> truth = made_path(120);
  write_kitti("truth.txt", truth);
  write_times("times.txt", truth.size());
  const std::vector<SE3> later(truth.begin() + 20, truth.end());
  write_tum("t.tum", later, 2.0);
  const ComparedTrajectory found = read_compared_trajectory(
      path("t.tum"), read_true_trajectory(path("truth.txt"), path("times.txt")), LogSink{});
  EXPECT_EQ(found.method, "TUM");
  const TrajectoryErrors e = trajectory_errors(found.poses, found.options);
  EXPECT_EQ(e.frames, 120);
  EXPECT_EQ(e.posed, 100);
  EXPECT_NEAR(e.rigid.ate_max, 0.0, 1e-6);
}

/// The sentence of an InputError, or nothing.
template <typename Read>
std::string refusal(const Read& read) {
  try {
    read();
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

TEST_F(TrajectoryFiles, OfOtherTimesAreNamed) {
  const std::vector<SE3> truth = made_path(60);
  write_kitti("truth.txt", truth);
  write_times("times.txt", truth.size());
  write_tum("since_1970.tum", truth, 1317000000.0);
  const TrueTrajectory timed = read_true_trajectory(path("truth.txt"), path("times.txt"));
  const std::string reason =
      refusal([&] { read_compared_trajectory(path("since_1970.tum"), timed, LogSink{}); });
  EXPECT_THAT(reason, HasSubstr("other times"));
  EXPECT_THAT(reason, HasSubstr("moved by -1.317e+09 s 60 would be"));
  EXPECT_THAT(refusal([&] {
                read_compared_trajectory(path("since_1970.tum"),
                                         read_true_trajectory(path("truth.txt"), ""), LogSink{});
              }),
              HasSubstr("--times"));
  write_times("few.txt", 7);
  EXPECT_THAT(refusal([&] { read_true_trajectory(path("truth.txt"), path("few.txt")); }),
              HasSubstr("found 7 times, expected one for each of the 60 poses"));
  write_kitti("short.txt", std::vector<SE3>(truth.begin(), truth.begin() + 30));
  EXPECT_THAT(refusal([&] { read_compared_trajectory(path("short.txt"), timed, LogSink{}); }),
              HasSubstr("found 30 poses without times"));
}

TEST_F(TrajectoryFiles, OfAnotherFrameAreNamed) {
  const std::vector<SE3> truth = made_path(60);
  write_kitti("truth.txt", truth);
  const TrueTrajectory true_poses = read_true_trajectory(path("truth.txt"), "");
  Eigen::Matrix3d ros;  // camera from body: x forward, y left, z up
  ros << 0, -1, 0, 0, 0, -1, 1, 0, 0;
  const SE3 camera_from_body(ros, Vector3d::Zero());
  std::vector<SE3> body, inverse, off;
  for (const SE3& pose : truth) {
    body.push_back(pose * camera_from_body);
    inverse.push_back(pose.inverse());
  }
  write_kitti("body.txt", body);
  EXPECT_THAT(refusal([&] { read_compared_trajectory(path("body.txt"), true_poses, LogSink{}); }),
              HasSubstr("move along their +x axis"));
  write_kitti("inverse.txt", inverse);
  EXPECT_THAT(
      refusal([&] { read_compared_trajectory(path("inverse.txt"), true_poses, LogSink{}); }),
      HasSubstr("camera_from_world"));
  // A poor estimate is none of another frame.
  write_kitti("poor.txt", estimated_path(truth, 1.3, 5e-3));
  EXPECT_EQ(refusal([&] { read_compared_trajectory(path("poor.txt"), true_poses, LogSink{}); }),
            "");
}

TEST_F(TrajectoryFiles, ADriveKeepsWhatItSays) {
  const std::vector<SE3> truth = made_path(70);
  write_drive("drive.json", truth);
  const json first = json::parse(std::ifstream(path("drive.json")));
  const DriveDocument drive = read_drive(path("drive.json"));
  EXPECT_FALSE(drive.frames[0].world_from_camera);
  EXPECT_EQ(drive.frames[5].status, Status::kOk);
  const json again = to_json(drive);
  EXPECT_EQ(again["windows"], first["windows"]);
  for (int i = 0; i < 16; ++i) {  // by way of a quaternion
    const double value = first["frames"][50]["world_from_camera"][i];
    EXPECT_NEAR(again["frames"][50]["world_from_camera"][i].get<double>(), value, 1e-12);
  }
  std::vector<std::string> warnings;
  json wrong = first;
  wrong["length"] = 100.0;
  std::ofstream(path("wrong.json")) << wrong;
  write_kitti("truth.txt", truth);
  read_compared_trajectory(path("wrong.json"), read_true_trajectory(path("truth.txt"), ""),
                           [&](const std::string& text) { warnings.push_back(text); });
  ASSERT_EQ(warnings.size(), 1u);
  EXPECT_THAT(warnings[0], HasSubstr("states a length of 100.00 m"));
  wrong["frames"][3]["id"] = 2;
  std::ofstream(path("wrong.json")) << wrong;
  EXPECT_THAT(refusal([&] { read_drive(path("wrong.json")); }),
              HasSubstr("frames[3]: found frame 2 after frame 2"));
}

TEST_F(TrajectoryFiles, AreToldFromLabels) {
  write_kitti("poses.txt", made_path(3));
  std::ofstream(path("labels.txt")) << "Car 0 0 0 1 2 3 4 1 2 3 4 5 6 0\n";
  std::ofstream(path("tracking.txt")) << "0 1 Car 0 0 0 1 2 3 4 1 2 3 4 5 6 0\n";
  EXPECT_TRUE(is_trajectory(path("poses.txt")));
  EXPECT_FALSE(is_trajectory(path("labels.txt")));
  EXPECT_FALSE(is_trajectory(path("tracking.txt")));
  EXPECT_FALSE(is_trajectory(path("nothing.txt")));
}

}  // namespace
}  // namespace camber
