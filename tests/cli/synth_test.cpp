// camber synth: random scenes, single features and what it prints.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>

#include "camber/scene/scene.h"
#include "cli/run_program.h"
#include "support/test_data.h"

namespace camber {
namespace {

using nlohmann::json;
using test::run_camber;

class Synth : public ::testing::Test {
 protected:
  std::string path(const std::string& name) const { return (folder_.path() / name).string(); }
  /// Runs `camber synth` with a small picture.
  test::ProgramResult synth(std::vector<std::string> arguments, const std::string& out) {
    arguments.insert(arguments.begin(), "synth");
    for (const char* more : {"--size", "160x90", "--cloud-points", "200", "--out"}) {
      arguments.emplace_back(more);
    }
    arguments.push_back(path(out));
    return run_camber(arguments);
  }
  test::TemporaryFolder folder_;
};

TEST_F(Synth, RandomScenesAreTheSameForOneNumberAndPrintedAsJson) {
  const auto first = synth({"--random", "4", "--frames", "2", "--json"}, "a");
  ASSERT_EQ(first.exit_code, 0) << first.error;
  EXPECT_EQ(first.error, "");
  const json printed = json::parse(first.out);
  EXPECT_EQ(printed["name"], "random_00004");
  EXPECT_EQ(printed["frames"], 2);
  EXPECT_EQ(printed["options"]["frames"], 2);  // the option replaces what was drawn
  EXPECT_EQ(printed["options"]["camera"]["width"], 160);
  EXPECT_TRUE(printed["options"]["features"].contains("asphalt"));
  EXPECT_TRUE(printed.contains("timings_ms") && printed.contains("seed"));
  const auto again = synth({"--random", "4", "--frames", "2", "--threads", "1"}, "b");
  ASSERT_EQ(again.exit_code, 0) << again.error;
  EXPECT_EQ(again.out, "");
  auto a = test::snapshot(path("a")), b = test::snapshot(path("b"));
  for (auto* files : {&a, &b}) {
    files->erase("run.json");   // times
    files->erase("README.md");  // the command
  }
  EXPECT_GT(a.size(), 8u);
  EXPECT_EQ(a, b);
  const auto other = synth({"--random", "5", "--frames", "2"}, "c");
  ASSERT_EQ(other.exit_code, 0) << other.error;
  EXPECT_NE(test::snapshot(path("c"))["image/000000.png"], a["image/000000.png"]);
}

TEST_F(Synth, WholeDrivesAreMadeAndFollowPaths) {
  const auto run = [&](std::vector<std::string> arguments, const std::string& out) {
    arguments.insert(arguments.begin(), {"synth", "--drive", "--size", "160x64"});
    arguments.insert(arguments.end(), {"--out", path(out)});
    return run_camber(arguments);
  };
  const auto made = run({"--frames", "6", "--seed", "3", "--json", "--focal-sigma", "0.02"}, "a");
  ASSERT_EQ(made.exit_code, 0) << made.error;
  const json printed = json::parse(made.out);
  EXPECT_EQ(printed["frames"], 6);
  EXPECT_EQ(printed["name"], "drive_3");
  EXPECT_NE(printed["true_height"], 1.65);
  const Scene scene = read_scene(path("a"));
  EXPECT_EQ(scene.camera_sigma.focal, 0.02);
  double length = 0.0;
  for (std::size_t i = 1; i < scene.truth->frames.size(); ++i) {
    length += (scene.truth->frames[i].world_from_camera->translation() -
               scene.truth->frames[i - 1].world_from_camera->translation())
                  .norm();
  }
  EXPECT_NEAR(printed["length"].get<double>(), length, 1e-6);

  std::ofstream poses(path("poses.txt"));
  for (int i = 0; i < 20; ++i) {
    poses << "1 0 0 " << 0.02 * i * i << " 0 1 0 0 0 0 1 " << 0.9 * i << "\n";
  }
  poses.close();
  const auto followed = run({"--path", path("poses.txt"), "--json"}, "b");
  ASSERT_EQ(followed.exit_code, 0) << followed.error;
  EXPECT_EQ(json::parse(followed.out)["frames"], 20);
  EXPECT_NEAR(json::parse(followed.out)["length"].get<double>(), 19.0, 1.2);

  EXPECT_ONE_SENTENCE(run({"--profile", "crest"}, "c"), 2, "--profile");
  EXPECT_ONE_SENTENCE(synth({"--standstills", "2"}, "c"), 2, "--drive");
  EXPECT_ONE_SENTENCE(run({"--path", path("none.txt")}, "c"), 2, "none.txt");
  EXPECT_ONE_SENTENCE(run({"--path", path("poses.txt"), "--frames", "30"}, "c"), 2,
                      "poses of the path");
}

TEST_F(Synth, FeaturesAreOptions) {
  const auto made = synth({"--corner",
                           "stem",
                           "--turn",
                           "left",
                           "--corner-radius",
                           "8",
                           "--corner-yaw-rate-deg",
                           "30",
                           "--frames",
                           "3",
                           "--wet",
                           "0.5",
                           "--asphalt",
                           "self_similar",
                           "--lead-car",
                           "7",
                           "--kerb-height",
                           "0.2",
                           "--markings",
                           "none",
                           "--pitch-deg",
                           "-3",
                           "--lights",
                           "--json"},
                          "a");
  ASSERT_EQ(made.exit_code, 0) << made.error;
  const json features = json::parse(made.out)["options"]["features"];
  EXPECT_EQ(features["corner"]["kind"], "stem");
  EXPECT_EQ(features["corner"]["turn"], "left");
  EXPECT_NEAR(features["corner"]["yaw_rate_deg"].get<double>(), 30.0, 1e-9);
  EXPECT_EQ(features["asphalt"]["texture"], "self_similar");
  EXPECT_EQ(features["asphalt"]["wetness"], 0.5);
  EXPECT_EQ(features["lead_car"]["gap"], 7.0);
  EXPECT_EQ(features["roadside"]["kerb_height"], 0.2);
  EXPECT_EQ(features["markings"], "none");
  EXPECT_NEAR(features["mounting"]["pitch_deg"].get<double>(), -3.0, 1e-9);
  EXPECT_EQ(features["weather"]["lights_on"], true);
  const Scene scene = read_scene(path("a"));
  EXPECT_TRUE(scene.markings_m.empty());
  // It turns to the left by 3 degrees a frame.
  ASSERT_TRUE(scene.truth.has_value());
  const SE3 step = scene.truth->frames[0].world_from_camera->inverse() *
                   *scene.truth->frames[1].world_from_camera;
  EXPECT_NEAR(rotation_to_vector(step.rotation()).norm(), 3.0 * 3.14159265 / 180.0, 0.008);
}

TEST_F(Synth, DrawsThroughALens) {
  const auto made =
      synth({"--distortion", "fisheye,0.02,-0.01,0.001,0", "--frames", "2", "--json"}, "a");
  ASSERT_EQ(made.exit_code, 0) << made.error;
  EXPECT_EQ(json::parse(made.out)["options"]["distortion"]["model"], "fisheye");
  const Scene scene = read_scene(path("a"));
  EXPECT_EQ(scene.distortion.model, LensModel::kFisheye);
  EXPECT_EQ(scene.distortion.coefficients, (std::vector<double>{0.02, -0.01, 0.001, 0.0}));
  EXPECT_EQ(scene.distortion.raw.width, 160);
  EXPECT_GT(scene.camera.width, 160);
}

TEST_F(Synth, OfTwoRoadsThatARepeatingTextureShowsTheOneThatAllAgreesOnIsFound) {
  // From frame to frame the camera moves by two tiles of the asphalt: near it nearly the same
  // matches one tile off. The kerbs do not, nor does the road farther ahead.
  const std::string made = path("made");
  ASSERT_EQ(run_camber({"synth", "--random", "316", "--frames", "4", "--supersampling", "1",
                        "--cloud-points", "1000", "--out", made})
                .exit_code,
            0);
  const auto scale_error = [&](std::vector<std::string> words) {
    words.insert(words.begin(), {"reconstruct", made, "--no-pictures", "--out", path("road")});
    const test::ProgramResult result = run_camber(words);
    EXPECT_EQ(result.exit_code, 0) << result.error;
    const json metrics = json::parse(test::read_text(path("road/metrics.json")));
    return metrics.at("scale_error").get<double>();
  };
  EXPECT_NEAR(scale_error({"--frames", "1:3"}), 0.0, 0.05);  // 0.018; from its first start -0.58
}

TEST_F(Synth, RefusesWhatItCannotMake) {
  EXPECT_ONE_SENTENCE(synth({"--corner", "stem", "--corner-radius", "2"}, "a"), 2, "corner.radius");
  EXPECT_ONE_SENTENCE(synth({"--corner", "stem", "--bend-radius", "60"}, "a"), 2, "bend.radius");
  EXPECT_ONE_SENTENCE(synth({"--wet", "7"}, "a"), 2, "asphalt.wetness");
  EXPECT_EQ(synth({"--corner", "roundabout"}, "a").exit_code, 2);
  EXPECT_ONE_SENTENCE(synth({"--distortion", "mirror,1,2,3,4"}, "a"), 2, "brown or fisheye");
  EXPECT_ONE_SENTENCE(synth({"--distortion", "brown,-0.3,x,0,0"}, "a"), 2, "found x");
  EXPECT_ONE_SENTENCE(synth({"--distortion", "fisheye,0,0,0"}, "a"), 2, "3 coefficients");
  EXPECT_ONE_SENTENCE(synth({"--distortion", "brown,-2,0,0,0"}, "a"), 2, "lens's model reaches");
  EXPECT_EQ(synth({"--random", "-1"}, "a").exit_code, 2);
  EXPECT_EQ(synth({"--random", "x"}, "a").exit_code, 2);
  // Options of what the scene does not have.
  EXPECT_ONE_SENTENCE(synth({"--turn", "left"}, "a"), 2, "--turn: expected --corner or");
  EXPECT_ONE_SENTENCE(synth({"--corner-grade", "0.1"}, "a"), 2, "expected --corner beside it");
  EXPECT_ONE_SENTENCE(synth({"--sequence", "3"}, "a"), 2, "expected --layout of a data set");
  EXPECT_ONE_SENTENCE(synth({"--layout", "kitti-tracking", "--classes-only"}, "a"), 2,
                      "expected --layout synthia-sf");
  EXPECT_FALSE(std::filesystem::exists(path("a")));
}

}  // namespace
}  // namespace camber
