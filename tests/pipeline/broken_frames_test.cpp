// Frames that mislead: the surface is right or says that it does not know.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "camber/core/errors.h"
#include "camber/pipeline/reconstruct.h"
#include "scene/write_image.h"
#include "support/drawn_road.h"
#include "support/test_data.h"

namespace camber {
namespace {

using test::DrawnBoard;
using test::DrawnRoad;
using ::testing::HasSubstr;

const PinholeCamera kCamera{620, 220, 420.0, 420.0, 310.0, 90.0};
constexpr double kHeight = 1.65;  // m

SE3 pose(int k, double step) {
  return {rotation_from_vector(Eigen::Vector3d(0.0, 0.003 * k, 0.0)),
          Eigen::Vector3d(0.0, 0.0, step * k)};
}

/// Posts and house fronts on both sides, which hold the motion.
DrawnRoad street(std::function<double(double, double)> ground) {
  DrawnRoad road;
  road.ground = std::move(ground);
  for (int i = 0; i < 6; ++i) {
    const double z = 14.0 + 7.0 * i;
    road.boards.push_back({z, -14.0, -6.0, -4.0 - 0.4 * i, 3.0, 0.0});
    road.boards.push_back({z + 3.0, 6.5, 13.0, -3.0 - 0.3 * i, 3.0, 0.0});
  }
  return road;
}

double flat(double, double) { return kHeight; }
double climbing(double, double z) { return kHeight - 0.002 * z * z; }

using Ground = double (*)(double x, double z);
using Pixels = std::vector<std::uint8_t>;

/// A frame of a street with nothing on the road, drawn once a process.
const Pixels& frame_of_street(Ground ground, int number, double step) {
  static std::map<std::tuple<Ground, int, double>, Pixels> drawn;
  Pixels& out = drawn[{ground, number, step}];
  if (out.empty()) out = test::draw_road(street(ground), kCamera, pose(number, step), number);
  return out;
}

class BrokenFrames : public ::testing::Test {
 protected:
  /// Writes the frames and a manifest without masks and detections.
  Scene make_scene(const DrawnRoad& road, const std::vector<int>& numbers = {-1, 0, 1},
                   double step = 0.8) {
    return make_scene(numbers, [&](int number) {
      return test::draw_road(road, kCamera, pose(number, step), number);
    });
  }

  /// Of a street with nothing on the road.
  Scene make_scene(Ground ground, const std::vector<int>& numbers = {-1, 0, 1}, double step = 0.8) {
    return make_scene(numbers, [&](int number) { return frame_of_street(ground, number, step); });
  }

  Scene make_scene(const std::vector<int>& numbers, const std::function<Pixels(int)>& draw) {
    Scene scene;
    scene.camera = kCamera;
    scene.height_above_road = kHeight;
    for (std::size_t i = 0; i < numbers.size(); ++i) {
      const Pixels image = draw(numbers[i]);
      SceneFrame frame;
      frame.id = static_cast<int>(i);
      frame.image = folder_.path() / (std::to_string(i) + ".png");
      test::write_png(frame.image, kCamera.width, kCamera.height, 0, 8, image);
      scene.frames.push_back(frame);
    }
    return scene;
  }

  /// At each place ahead the surface is within three standard deviations and 3 cm of the truth or
  /// not covered. @return at how many of them it is covered.
  int check(const Reconstruction& result, const DrawnRoad& road, double x = 0.0) {
    int covered = 0;
    for (double z = 6.0; z <= 26.0; z += 2.0) {
      const double truth = road.ground(x, z);
      const SurfaceQuery found = result.surface.query({x, truth, z});
      if (found.status == Status::kFailed) continue;
      ++covered;
      EXPECT_LT(std::abs(found.point.y() - truth), 0.03 + 3.0 * found.sigma_height)
          << "at z = " << z << ", stated " << found.sigma_height;
    }
    return covered;
  }

  test::TemporaryFolder folder_;
};

TEST_F(BrokenFrames, SoundFramesAreRight) {
  const Reconstruction result = reconstruct(make_scene(climbing), {0, 1, 2}, {});
  EXPECT_GE(check(result, street(climbing)), 8);
  EXPECT_LT(result.run.scale_sigma, 0.04);
}

// A flow bends at the lower border of the image, and the nearest road carries the scale.
TEST_F(BrokenFrames, TheScaleIsThatOfTheIntensities) {
  constexpr double kStep = 0.8;
  const Scene scene = make_scene(flat, {-1, 0, 1}, kStep);
  const auto scale_error = [&](bool photometric) {
    ReconstructOptions options;
    options.photometric = photometric;
    const Reconstruction result = reconstruct(scene, {0, 1, 2}, options);
    double length = 0.0;
    for (const RunDocument::CameraPose& camera : result.run.cameras) {
      length += camera.reference_from_camera.translation().norm();
    }
    return std::abs(length / (2.0 * kStep) - 1.0);
  };
  const double with = scale_error(true);
  EXPECT_LT(with, 0.008);               // 0.0074 measured
  EXPECT_LT(with, scale_error(false));  // 0.0098 measured
}

// In a turn the camera, ahead of the rear axle, travels to the inside of where it looks.
TEST_F(BrokenFrames, ATurnIsNotTakenForAWrongPrincipalPoint) {
  constexpr double kRadius = 9.0, kAhead = 2.4, kStep = 0.5;  // m
  const Scene scene = make_scene({-1, 0, 1}, [&](int number) {
    const double heading = kStep * number / kRadius;
    const Eigen::Vector3d forward(std::sin(heading), 0.0, std::cos(heading));
    const Eigen::Vector3d axle(kRadius * (1.0 - forward.z()), 0.0, kRadius * forward.x());
    return test::draw_road(
        street(flat), kCamera,
        {rotation_from_vector(Eigen::Vector3d(0.0, heading, 0.0)), axle + kAhead * forward},
        number);
  });
  const Reconstruction result = reconstruct(scene, {0, 1, 2}, {});
  const Eigen::Vector3d step = result.run.cameras.back().reference_from_camera.translation();
  EXPECT_GT(std::atan2(step.x(), step.z()), 0.25);  // beyond what a straight drive may show
  EXPECT_NEAR(step.norm(), kStep * std::hypot(1.0, kAhead / kRadius), 0.05);
  EXPECT_TRUE(result.run.warnings.empty()) << result.run.warnings[0].text;
}

TEST_F(BrokenFrames, TheScaleIsNoBetterThanTheHeightIsKnown) {
  Scene scene = make_scene(flat);
  scene.height_sigma = 0.2;
  const Reconstruction result = reconstruct(scene, {0, 1, 2}, {});
  EXPECT_GT(result.run.scale_sigma, 0.2 / kHeight);
  EXPECT_NEAR(result.run.extra["scale_from"]["sigma_camera_height"], 0.2 / kHeight, 1e-9);
  EXPECT_EQ(result.run.scale_sigma, result.surface.scale_sigma);
  EXPECT_TRUE(result.run.warnings.empty());
}

TEST_F(BrokenFrames, APrincipalPointFarOffIsNamedAndWidensTheScale) {
  Scene scene = make_scene(flat);
  scene.camera.cx = 60.0;  // 250 px off: 31 degrees
  try {
    const Reconstruction result = reconstruct(scene, {0, 1, 2}, {});
    ASSERT_FALSE(result.run.warnings.empty());
    EXPECT_EQ(result.run.warnings[0].code, "scale_contradicted");
    EXPECT_THAT(result.run.warnings[0].text, HasSubstr("principal point"));
    EXPECT_GT(result.run.scale_sigma, 0.3);
    EXPECT_EQ(result.run.scale_status, Status::kWeak);
  } catch (const NoAnswerError&) {
    // refused is right, too
  }
}

TEST_F(BrokenFrames, WrongExposureOfOneFrame) {
  const Scene scene = make_scene({-1, 0, 1}, [](int k) {
    Pixels image = frame_of_street(climbing, k, 0.8);
    if (k != 1) return image;
    for (std::uint8_t& v : image) v = static_cast<std::uint8_t>(0.55 * v + 10.0);
    return image;
  });
  EXPECT_GE(check(reconstruct(scene, {0, 1, 2}, {}), street(climbing)), 7);
}

TEST_F(BrokenFrames, OneFrameRepeatedIsRefused) {
  const Scene scene = make_scene(flat, {0, 0, 1});
  // Grain differs by the frame's number alone, so the two images are the same.
  try {
    reconstruct(scene, {0, 1, 2}, {});
    FAIL() << "a repeated frame was taken";
  } catch (const NoAnswerError& error) {
    EXPECT_THAT(error.what(), HasSubstr("same image"));
  }
}

/// A broken line and a crossing painted on the ground.
double painted(double x, double z, int) {
  const bool stroke = std::abs(x + 1.0) < 0.06 && z > 5.0 && std::fmod(z - 5.0, 9.0) < 3.0;
  const bool stripe = z > 11.0 && z < 15.0 && x > -0.5 && x < 5.5 && std::fmod(x + 0.5, 1.0) < 0.5;
  return stroke || stripe ? 2.2 : 1.0;
}

TEST_F(BrokenFrames, MarkingsOfKnownSizeGiveMetresWithoutACameraHeight) {
  DrawnRoad road = street(flat);
  road.light = painted;
  Scene scene = make_scene(road);
  scene.height_above_road.reset();
  EXPECT_FALSE(reconstruct(scene, {0, 1}, {}).run.metric);
  scene.markings_m = {{"dash_length", 3.0},
                      {"dash_gap", 6.0},
                      {"line_width", 0.12},
                      {"zebra_stripe_width", 0.5},
                      {"zebra_gap", 0.5}};
  const Reconstruction result = reconstruct(scene, {0, 1, 2}, {});
  ASSERT_TRUE(result.run.metric) << result.run.extra["markings"].dump();
  EXPECT_EQ(result.run.extra["markings"]["status"], "used");
  const double step = result.run.cameras[2].reference_from_camera.translation().norm();
  EXPECT_LT(result.surface.scale_sigma, 0.1);
  EXPECT_NEAR(step / 0.8, 1.0, 3.0 * result.surface.scale_sigma);
  EXPECT_NEAR(step / 0.8, 1.0, 0.04);
  EXPECT_GE(check(result, road, 1.5), 6);

  // Against sizes that are wrong by a quarter the camera's height stands, and the run says so.
  scene.height_above_road = kHeight;
  for (auto& [name, size] : scene.markings_m) size *= 1.25;
  const Reconstruction wrong = reconstruct(scene, {0, 1, 2}, {});
  EXPECT_NEAR(wrong.run.cameras[2].reference_from_camera.translation().norm() / 0.8, 1.0, 0.03);
  ASSERT_FALSE(wrong.run.warnings.empty());
  EXPECT_THAT(wrong.run.warnings[0].text, HasSubstr("lane_markings"));
  EXPECT_GT(wrong.run.scale_sigma, 0.15);
}

/// Three broken lines of 3 m strokes, 6 m apart.
double lanes(double x, double z, int) {
  for (const auto& [line, first] : {std::pair{-3.4, 6.0}, {-1.6, 8.0}, {1.9, 5.0}}) {
    if (std::abs(x - line) < 0.075 && z > first && std::fmod(z - first, 9.0) < 3.0) return 2.2;
  }
  return 1.0;
}

TEST_F(BrokenFrames, StrokesOfKnownLengthContradictAFocalLength) {
  DrawnRoad road = street(flat);
  road.light = lanes;
  Scene scene = make_scene(road);
  scene.markings_m = {{"dash_length", 3.0}, {"dash_gap", 6.0}, {"line_width", 0.15}};
  const auto named = [](const Reconstruction& result) {
    return std::count_if(result.run.warnings.begin(), result.run.warnings.end(),
                         [](const auto& w) { return w.code == "focal_length_contradicted"; });
  };
  EXPECT_EQ(named(reconstruct(scene, {0, 1, 2}, {})), 0);

  scene.camera.fx *= 2.0;
  scene.camera.fy *= 2.0;
  const Reconstruction wrong = reconstruct(scene, {0, 1, 2}, {});
  ASSERT_EQ(named(wrong), 1);
  for (const auto& warning : wrong.run.warnings) {
    if (warning.code != "focal_length_contradicted") continue;
    EXPECT_THAT(warning.text, HasSubstr("strokes of broken lines"));
  }
  // Twice the focal length takes lengths along the road for twice what they are.
  EXPECT_GT(wrong.run.scale_sigma, 0.3);
}

TEST_F(BrokenFrames, TruckAheadWithoutMasks) {
  // Keeps its distance and hides the road ahead: half of the image does not move.
  DrawnRoad road = street(flat);
  road.boards.push_back({9.0, -1.4, 1.4, -2.2, 1.3, 0.8});
  road.light = [](double x, double z, int frame) {
    const double front = 9.0 + 0.8 * frame;
    return std::abs(x) < 1.5 && z > front - 0.8 && z < front + 6.0 ? 0.5 : 1.0;
  };
  const Scene scene = make_scene(road);
  try {
    const Reconstruction result = reconstruct(scene, {0, 1, 2}, {});
    check(result, road);
    check(result, road, -2.5);
    EXPECT_NEAR(result.run.cameras[2].reference_from_camera.translation().norm(), 0.8, 0.04);
  } catch (const NoAnswerError&) {
    SUCCEED();  // says so
  }
}

TEST_F(BrokenFrames, StandingShadowOnTheRoad) {
  DrawnRoad road = street(climbing);
  road.light = [](double x, double z, int) {
    return x > -0.5 && x < 3.0 && z > 8.0 && z < 13.0 ? 0.45 : 1.0;
  };
  EXPECT_GE(check(reconstruct(make_scene(road), {0, 1, 2}, {}), road), 7);
}

TEST_F(BrokenFrames, WetRoadMirrorsTheSky) {
  DrawnRoad road = street(flat);
  road.wet = [](double x, double z) {
    return std::hypot(x - 0.5, (z - 12.0) / 2.5) < 1.2 ||
           std::hypot(x + 2.0, (z - 18.0) / 3.0) < 1.0;
  };
  EXPECT_GE(check(reconstruct(make_scene(road), {0, 1, 2}, {}), road), 5);
}

TEST_F(BrokenFrames, WallAcrossTheRoadIsNotRoad) {
  DrawnRoad road = street(flat);
  road.boards.push_back({18.0, -8.0, 8.0, -4.0, 3.0, 0.0});
  const Reconstruction result = reconstruct(make_scene(road), {0, 1, 2}, {});
  check(result, road);
  for (const PlanePatch& patch : result.surface.patches) {
    EXPECT_LT(patch.plane.plane.normal.y(), -0.9) << "patch " << patch.id << " stands upright";
  }
}

TEST_F(BrokenFrames, NothingIsClaimedBehindACrest) {
  // Level for 14 m, then falling away out of sight.
  const DrawnRoad road = street(
      [](double, double z) { return kHeight + 0.008 * std::pow(std::max(0.0, z - 10.0), 2); });
  const Reconstruction result = reconstruct(make_scene(road), {0, 1, 2}, {});
  EXPECT_GE(check(result, road), 3);
  const double z = 40.0;
  const SurfaceQuery behind = result.surface.query({0.0, road.ground(0.0, z), z});
  EXPECT_TRUE(behind.status == Status::kFailed || behind.sigma_height > 1.0);
}

TEST_F(BrokenFrames, SlowDriveTakesFramesFurtherApart) {
  using Ids = std::vector<int>;
  const Scene slow = make_scene(flat, {-4, -3, -2, -1, 0, 1, 2, 3, 4}, 0.08);
  const ChosenFrames three = choose_frames(slow, {}, 1);
  EXPECT_GE(three.spacing, 3);
  EXPECT_EQ(three.ids, (Ids{4 - three.spacing, 4, 4 + three.spacing}));
  EXPECT_EQ(three.instead, (std::vector<Ids>{{3, 4, 5}}));
  const ChosenFrames five = choose_frames(slow);
  const int half = (five.spacing + 1) / 2;
  EXPECT_EQ(five.spacing, three.spacing);
  EXPECT_EQ(five.ids, (Ids{4 - five.spacing, 4 - half, 4, 4 + half, 4 + five.spacing}));
  EXPECT_EQ(five.instead, (std::vector<Ids>{three.ids, {3, 4, 5}}));
  const Scene usual = make_scene(flat, {-2, -1, 0, 1, 2, 3});
  const ChosenFrames near = choose_frames(usual);
  EXPECT_EQ(near.spacing, 1);
  EXPECT_EQ(near.ids, (Ids{1, 2, 3, 4, 5}));
  EXPECT_EQ(near.instead, (std::vector<Ids>{{2, 3, 4}}));
  EXPECT_GT(near.parallax_px, 6.0);
}

TEST_F(BrokenFrames, CopiesOfAnImageArePassedOver) {
  for (const int copies : {2, 3}) {
    Scene scene = make_scene(flat, {-2, -1, 0, 1, 2});
    std::vector<SceneFrame> frames;
    for (const SceneFrame& frame : scene.frames) {
      for (int k = 0; k < copies; ++k) {
        frames.push_back(frame);
        frames.back().id = static_cast<int>(frames.size()) - 1;
      }
    }
    scene.frames = std::move(frames);
    const ChosenFrames chosen = choose_frames(scene);
    std::vector<int> pictures;
    for (const int id : chosen.ids) pictures.push_back(id / copies);
    EXPECT_EQ(pictures, (std::vector<int>{0, 1, 2, 3, 4})) << copies;
    for (SceneFrame& frame : scene.frames) frame.image = scene.frames.front().image;
    EXPECT_THROW(choose_frames(scene), NoAnswerError);
  }
}

TEST_F(BrokenFrames, AReferenceAtTheEndHasFramesOnOneSide) {
  Scene scene = make_scene(flat, {-2, -1, 0, 1, 2});
  scene.reference_frame = 4;
  EXPECT_EQ(choose_frames(scene).ids, (std::vector<int>{2, 3, 4}));
  EXPECT_THROW(choose_frames(scene, {}, 3), std::invalid_argument);
}

TEST_F(BrokenFrames, WhereThereIsNothingToChooseNoImageIsRead) {
  const FramePixelSource none = [](int id) -> FramePixels {
    ADD_FAILURE() << "frame " << id << " was read";
    return {};
  };
  const ChosenFrames three = choose_frames(make_scene(flat, {-1, 0, 1}), none);
  EXPECT_EQ(three.ids, (std::vector<int>{0, 1, 2}));
  EXPECT_EQ(three.spacing, 1);
  EXPECT_EQ(three.parallax_px, 0.0);
  EXPECT_TRUE(three.instead.empty());
}

TEST_F(BrokenFrames, AnUpThatPointsDownIsRefused) {
  Scene scene = make_scene(flat, {0, 1});
  scene.frames[1].up = Eigen::Vector3d(0.0, 0.99, 0.1);
  EXPECT_THROW(reconstruct(scene, {0, 1}, {}), std::invalid_argument);
}

TEST_F(BrokenFrames, TwoFramesSuffice) {
  const Reconstruction result = reconstruct(make_scene(climbing, {0, 1}), {0, 1}, {});
  EXPECT_GE(check(result, street(climbing)), 6);
}

}  // namespace
}  // namespace camber
