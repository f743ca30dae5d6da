#include "camber/drive/trajectory.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <limits>
#include <vector>

#include "camber/core/random.h"

namespace camber {
namespace {

/// A drive of frames 1 m apart on a curve, and what windows of five of them measure of it.
struct MadeWindows {
  std::vector<int> ids;
  std::vector<SE3> truth;  // world (first camera) from camera
  std::vector<WindowMeasurement> windows;
};

constexpr double kTurnSigma = 3e-4;    // rad, of a relative pose
constexpr double kShiftSigma = 0.003;  // baselines
constexpr double kScaleSigma = 0.02;   // of a window's own scale

MadeWindows make_windows(int frames, std::uint64_t seed, double noise = 1.0,
                         double shift_sigma = kShiftSigma) {
  const CounterRandom random(seed);
  std::uint64_t draw = 0;
  const auto normal = [&] { return random.normal(draw++); };
  MadeWindows out;
  SE3 pose;
  for (int k = 0; k < frames; ++k) {
    out.ids.push_back(10 + k);
    out.truth.push_back(pose);
    pose = pose * SE3(rotation_from_vector({0.002 * std::sin(0.1 * k), 0.01, 0.0}),
                      Eigen::Vector3d(0.0, 0.0, 1.0));
  }
  for (int r = 0; r < frames; ++r) {
    WindowMeasurement w;
    w.reference = out.ids[static_cast<std::size_t>(r)];
    double longest = 0.0;
    std::vector<SE3> poses;
    for (int k = std::max(0, r - 2); k <= std::min(frames - 1, r + 2); ++k) {
      w.frames.push_back(out.ids[static_cast<std::size_t>(k)]);
      poses.push_back(out.truth[static_cast<std::size_t>(k)].inverse() *
                      out.truth[static_cast<std::size_t>(r)]);
      longest = std::max(longest, poses.back().translation().norm());
    }
    const auto size = static_cast<Eigen::Index>(6 * (poses.size() - 1));
    w.covariance = Eigen::MatrixXd::Zero(size, size);
    Eigen::Index at = 0;
    for (std::size_t i = 0; i < poses.size(); ++i) {
      SE3 measured(poses[i].rotation(), poses[i].translation() / longest);
      if (w.frames[i] != w.reference) {
        Eigen::Vector3d turn, shift;
        for (int c = 0; c < 3; ++c) {
          turn[c] = noise * kTurnSigma * normal();
          shift[c] = noise * shift_sigma * normal();
          w.covariance(at + c, at + c) = kTurnSigma * kTurnSigma;
          w.covariance(at + 3 + c, at + 3 + c) = shift_sigma * shift_sigma;
        }
        at += 6;
        measured =
            SE3(rotation_from_vector(turn) * measured.rotation(), measured.translation() + shift);
      }
      w.frame_from_reference.push_back(measured);
    }
    w.log_scale = std::log(longest) + noise * kScaleSigma * normal();
    w.scale_sigma = kScaleSigma;
    w.common_scale_sigma = 0.006;
    out.windows.push_back(std::move(w));
  }
  return out;
}

/// Windows' errors as they are drawn here: neither alike nor shared.
TrajectoryNoise independent() {
  TrajectoryNoise out;
  out.motion_inflation = 1.0;
  out.scale_correlation = 0.0;
  out.rotation_floor = out.translation_floor = out.scale_floor = 1e-6;
  return out;
}

double true_length(const MadeWindows& made) { return static_cast<double>(made.truth.size()) - 1.0; }

TEST(Trajectory, OfExactWindowsIsTheDrive) {
  const MadeWindows made = make_windows(40, 1, 0.0);
  const Trajectory found = smooth_trajectory(made.ids, made.windows);
  ASSERT_EQ(found.poses.size(), made.truth.size());
  EXPECT_TRUE(found.metric);
  for (std::size_t k = 0; k < made.truth.size(); ++k) {
    const SE3 off = made.truth[k].inverse() * found.poses[k].world_from_camera;
    EXPECT_LT(off.translation().norm(), 1e-6) << k;
    EXPECT_LT(rotation_to_vector(off.rotation()).norm(), 1e-7) << k;
    EXPECT_EQ(found.poses[k].status, Status::kOk);
  }
  EXPECT_NEAR(found.whole.length, true_length(made), 1e-6);
}

TEST(Trajectory, StatesLengthsAndPosesAsTheyScatter) {
  // Mean squares over their variances, of 30 drives: within three standard errors of one.
  constexpr int kDrives = 30;
  double length = 0.0, window = 0.0, pose = 0.0;
  int windows = 0;
  for (int d = 0; d < kDrives; ++d) {
    const MadeWindows made = make_windows(71, 100 + static_cast<std::uint64_t>(d));
    const Trajectory found = smooth_trajectory(made.ids, made.windows, independent());
    length += std::pow((found.whole.length - true_length(made)) / found.whole.own_sigma, 2);
    for (const Trajectory::Stretch& w : found.windows) {
      window += std::pow((w.length - 50.0) / w.own_sigma, 2);
      ++windows;
    }
    const SE3 off = made.truth.back().inverse() * found.poses.back().world_from_camera;
    Eigen::Matrix<double, 6, 1> error;
    error << rotation_to_vector(off.rotation()), off.translation();
    pose += error.dot(found.poses.back().covariance.ldlt().solve(error));
  }
  EXPECT_NEAR(length / kDrives, 1.0, 3.0 * std::sqrt(2.0 / kDrives));
  EXPECT_NEAR(window / windows, 1.0, 3.0 * std::sqrt(2.0 / kDrives));
  EXPECT_NEAR(pose / kDrives, 6.0, 3.0 * std::sqrt(12.0 / kDrives));
}

TEST(Trajectory, StepsThatPicturesHardlyShowAreThoseOfASteadySpeed) {
  // Frames 0.04 s apart; steps by the pictures to 6 %.
  constexpr int kDrives = 10;
  double with = 0.0, without = 0.0;
  std::vector<double> times;
  for (int k = 0; k < 60; ++k) times.push_back(0.04 * k);
  for (int d = 0; d < kDrives; ++d) {
    const MadeWindows made = make_windows(60, 300 + static_cast<std::uint64_t>(d), 1.0, 0.06);
    const auto worst_step = [&](const Trajectory& found) {
      double most = 0.0;
      for (std::size_t k = 1; k < found.poses.size(); ++k) {
        const double step = (found.poses[k].world_from_camera.translation() -
                             found.poses[k - 1].world_from_camera.translation())
                                .norm();
        most = std::max(most, std::abs(step - 1.0));
      }
      return most;
    };
    with += worst_step(smooth_trajectory(made.ids, made.windows, independent(), times));
    without += worst_step(smooth_trajectory(made.ids, made.windows, independent()));
  }
  EXPECT_LT(with, 0.5 * without);
}

TEST(Trajectory, OutvotesWindowsThatTookAnotherRoad) {
  MadeWindows made = make_windows(60, 7);
  for (const std::size_t wrong : {12U, 13U, 30U, 45U}) {
    made.windows[wrong].log_scale = *made.windows[wrong].log_scale - 0.7;  // half as long
  }
  const Trajectory found = smooth_trajectory(made.ids, made.windows);
  EXPECT_NEAR(found.whole.length / true_length(made), 1.0, 0.01);
  for (const Trajectory::WindowScale& scale : found.scales) {
    const bool wrong = scale.reference == 22 || scale.reference == 23 || scale.reference == 40 ||
                       scale.reference == 55;
    EXPECT_EQ(std::abs(scale.residual_sigma) > 10.0, wrong) << scale.reference;
  }
}

TEST(Trajectory, AFrameThatIsNotFoundSpoilsNoWindow) {
  // Where a texture repeats, each window has lost one of its outer frames, now the first, now the
  // last.
  MadeWindows made = make_windows(40, 11);
  for (std::size_t r = 18; r < 25; ++r) {
    WindowMeasurement& w = made.windows[r];
    for (std::size_t i = 0; i < w.frames.size(); ++i) {
      const bool outer = i == (r % 4 < 2 ? 0 : w.frames.size() - 1);
      if (!outer) continue;
      SE3& pose = w.frame_from_reference[i];
      const double side = r % 3 == 0 ? -0.3 : 0.3;
      pose.set_translation(0.4 * pose.translation() + Eigen::Vector3d(side, 0.2, 0.0));
    }
  }
  const Trajectory found = smooth_trajectory(made.ids, made.windows, independent());
  for (std::size_t k = 16; k < 27; ++k) {
    const SE3 step =
        found.poses[k].world_from_camera.inverse() * found.poses[k + 1].world_from_camera;
    const SE3 truth = made.truth[k].inverse() * made.truth[k + 1];
    // Two windows of 0.3 % of 2 m and 2 % of the length.
    EXPECT_LT((step.translation() - truth.translation()).head<2>().norm(), 0.02) << k;
    EXPECT_NEAR(step.translation().z(), 1.0, 0.04) << k;
  }
}

TEST(Trajectory, StartsAtStepsThatMostWindowsAgreeOn) {
  // Windows about every third frame; one turns back half-way, and those about the frames beside it,
  // which were measured for that, have each lost the frame beyond it.
  MadeWindows made = make_windows(40, 17);
  std::vector<WindowMeasurement> kept;
  for (std::size_t r = 0; r < made.windows.size(); ++r) {
    WindowMeasurement& w = made.windows[r];
    const std::size_t reference = w.index_of_reference();
    for (std::size_t i = 0; i < w.frames.size(); ++i) {
      SE3& pose = w.frame_from_reference[i];
      if (r == 18 && i > reference) pose.set_translation(-pose.translation());
      const bool lost = (r == 17 && i == reference + 2) || (r == 19 && i + 2 == reference);
      if (lost) pose.set_translation(-1.2 * pose.translation() + Eigen::Vector3d(0.3, 0.1, 0.0));
    }
    if (r % 3 == 0 || r == 17 || r == 19) kept.push_back(w);
  }
  const Trajectory found = smooth_trajectory(made.ids, kept, independent());
  for (std::size_t k = 12; k < 24; ++k) {
    const SE3 step =
        found.poses[k].world_from_camera.inverse() * found.poses[k + 1].world_from_camera;
    const SE3 truth = made.truth[k].inverse() * made.truth[k + 1];
    EXPECT_LT((step.translation() - truth.translation()).norm(), 0.08) << k;
  }
  EXPECT_NEAR(found.whole.length, true_length(made), 3.0 * found.whole.own_sigma);
}

TEST(Trajectory, FramesThatStandStayInTheirPlace) {
  // The camera stands from frame 20 on to 29; a car that passes carries one of the windows away.
  MadeWindows made = make_windows(40, 19, 0.0);
  for (std::size_t r = 0; r < made.windows.size(); ++r) {
    WindowMeasurement& w = made.windows[r];
    if (r < 20 || r > 29) continue;
    w.frames = {made.ids[19], made.ids[r], made.ids[30]};
    w.reference = made.ids[r];
    const SE3 stands = made.truth[20];
    const double longest = 10.0;
    w.frame_from_reference = {made.truth[19].inverse() * stands, SE3(),
                              made.truth[30].inverse() * stands};
    for (SE3& pose : w.frame_from_reference) pose.set_translation(pose.translation() / longest);
    if (r == 24) {
      for (const std::size_t i : {0, 2}) {
        SE3& pose = w.frame_from_reference[i];
        pose.set_translation(pose.translation() + Eigen::Vector3d(0.02, 0.0, 0.03));
      }
    }
    w.covariance = 1e-6 * Eigen::MatrixXd::Identity(12, 12);
    w.log_scale = std::log(longest);
  }
  for (std::size_t r : {18U, 19U, 30U, 31U}) made.windows[r].frame_from_reference.clear();
  std::vector<int> still;
  for (std::size_t k = 21; k < 30; ++k) still.push_back(made.ids[k]);
  const auto way = [&](const std::vector<int>& frames) {
    const Trajectory found =
        smooth_trajectory(made.ids, made.windows, independent(), {}, nullptr, frames);
    double out = 0.0;
    for (std::size_t k = 21; k < 30; ++k) {
      out += (found.poses[k].world_from_camera.translation() -
              found.poses[k - 1].world_from_camera.translation())
                 .norm();
    }
    return out;
  };
  EXPECT_GT(way({}), 0.3);
  EXPECT_LT(way(still), 0.06);
}

TEST(Trajectory, WindowsWhoseMotionIsNoNumberAreLeftOut) {
  MadeWindows made = make_windows(40, 13, 0.0);
  made.windows[10].frame_from_reference[1].set_translation(
      Eigen::Vector3d::Constant(std::numeric_limits<double>::quiet_NaN()));
  made.windows[15].frame_from_reference[0].set_translation({0.0, 1e300, 0.0});
  made.windows[20].covariance(3, 3) = std::numeric_limits<double>::infinity();
  made.windows[25].covariance.resize(6, 6);
  made.windows[30].log_scale = std::numeric_limits<double>::quiet_NaN();
  const Trajectory found = smooth_trajectory(made.ids, made.windows);
  ASSERT_EQ(found.poses.size(), made.truth.size());
  for (std::size_t k = 0; k < made.truth.size(); ++k) {
    const SE3 off = made.truth[k].inverse() * found.poses[k].world_from_camera;
    EXPECT_LT(off.translation().norm(), 1e-6) << k;
    EXPECT_EQ(found.poses[k].status, Status::kOk);
  }
}

TEST(Trajectory, WithoutAnySoundWindowHoldsStillAndSaysSo) {
  MadeWindows made = make_windows(10, 13, 0.0);
  for (WindowMeasurement& w : made.windows) {
    w.frame_from_reference[0].set_translation({1e300, 0.0, 0.0});
  }
  const Trajectory found = smooth_trajectory(made.ids, made.windows);
  ASSERT_EQ(found.poses.size(), 10U);
  for (const TrajectoryPose& pose : found.poses) {
    EXPECT_EQ(pose.status, Status::kNotObservable);
    EXPECT_TRUE(pose.world_from_camera.translation().allFinite());
  }
}

TEST(Trajectory, KeepsWhatAllWindowsShareApart) {
  const MadeWindows made = make_windows(200, 3);
  const Trajectory found = smooth_trajectory(made.ids, made.windows);
  EXPECT_DOUBLE_EQ(found.common_sigma, 0.006);
  EXPECT_GT(found.whole.sigma(), 0.006 * found.whole.length);
  EXPECT_LT(found.whole.own_sigma, 0.006 * found.whole.length);  // of 200 windows
}

TEST(Trajectory, BridgesFramesThatNoWindowJoins) {
  MadeWindows made = make_windows(30, 5, 0.0);
  std::vector<WindowMeasurement> kept;
  for (const WindowMeasurement& w : made.windows) {
    // A cut between 24 and 25: windows on either side of it.
    const bool across = w.frames.front() <= 24 && w.frames.back() >= 25;
    if (!across) kept.push_back(w);
  }
  const Trajectory found = smooth_trajectory(made.ids, kept);
  ASSERT_EQ(found.poses.size(), 30U);
  // As fast as before.
  const double step = (found.poses[15].world_from_camera.translation() -
                       found.poses[14].world_from_camera.translation())
                          .norm();
  EXPECT_NEAR(step, 1.0, 0.05);
  EXPECT_GT(found.poses.back().covariance(5, 5), 0.01);  // a step of 0.3 m is open
}

TEST(Trajectory, WindowsThatHardlyKnowTheirScaleHaveNoVote) {
  // Nine of ten are off by a factor of 50 and known to 40 %, as on film whose asphalt stands still.
  MadeWindows made = make_windows(60, 21);
  for (std::size_t i = 0; i < made.windows.size(); ++i) {
    if (i % 10 == 5) continue;
    made.windows[i].log_scale = *made.windows[i].log_scale - 3.9;
    made.windows[i].scale_sigma = 0.4;
  }
  const Trajectory found = smooth_trajectory(made.ids, made.windows);
  EXPECT_TRUE(found.metric);
  EXPECT_NEAR(found.whole.length / true_length(made), 1.0, 0.03);
  for (WindowMeasurement& w : made.windows) w.scale_sigma = 0.4;
  const Trajectory blind = smooth_trajectory(made.ids, made.windows);
  EXPECT_FALSE(blind.metric);
  EXPECT_LT(blind.whole.own_sigma, 0.2 * blind.whole.length);  // its shape is known
}

TEST(Trajectory, NominalHeightsHaveNoVoteBesideMetres) {
  MadeWindows made = make_windows(40, 22, 0.0);
  for (std::size_t i = 0; i < made.windows.size(); i += 2) {
    made.windows[i].metric = false;
    made.windows[i].log_scale = *made.windows[i].log_scale - 0.5;
  }
  const Trajectory found = smooth_trajectory(made.ids, made.windows);
  EXPECT_TRUE(found.metric);
  EXPECT_NEAR(found.whole.length, true_length(made), 1e-3 * true_length(made));
}

TEST(Trajectory, WithoutMetresIsUpToScale) {
  MadeWindows made = make_windows(20, 9, 0.0);
  for (WindowMeasurement& w : made.windows) w.metric = false;
  EXPECT_FALSE(smooth_trajectory(made.ids, made.windows).metric);
}

}  // namespace
}  // namespace camber
