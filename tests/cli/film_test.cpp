// A film, images and slips on the command line, as somebody has them who starts with Camber.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>

#include "camber/image/video.h"
#include "camber/import/import_own.h"
#include "camber/scene/results.h"
#include "camber/scene/scene.h"
#include "cli/run_program.h"
#include "support/test_data.h"

namespace camber {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using test::run_camber;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

fs::path film() { return test::source_dir() / "samples/own_drive/drive.mp4"; }

TEST(Film, IsReconstructedInOneCommand) {
  const test::TemporaryFolder folder;
  fs::create_directories(folder.path() / "own drive");
  fs::copy(film(), folder.path() / "own drive" / "drive.mp4");
  const std::string name = (folder.path() / "own drive" / "drive.mp4").string();
  const fs::path out = folder.path() / "new" / "out";
  const auto made = run_camber({"reconstruct", name, "--height", "1.4", "--fov", "81",
                                "--no-calibrate", "--out", out.string(), "--no-pictures"});
  ASSERT_EQ(made.exit_code, 0) << made.error;
  EXPECT_THAT(made.error, AllOf(HasSubstr("video of 20 whole frames"), HasSubstr("out/scene"),
                                HasSubstr("shipped detector"),
                                HasSubstr("of 20 frames are used; camber drive uses all")));
  EXPECT_THAT(made.out, HasSubstr("since the field of view is known to 5 degrees only (81)"));

  // Nothing but the result is left behind, and the scene in it leads to the film wherever both go.
  std::size_t entries = 0;
  for (const auto& entry : fs::directory_iterator(out.parent_path())) {
    EXPECT_EQ(entry.path().filename(), "out");
    ++entries;
  }
  EXPECT_EQ(entries, 1u);
  const Scene scene = read_scene(out / "scene");
  EXPECT_TRUE(fs::equivalent(image_file_of(scene.frames[0].image), name));
  EXPECT_NEAR(scene.camera_sigma.focal, 5.0 / 57.29578 / std::sin(81.0 / 57.29578), 1e-6);
  EXPECT_EQ(scene.height_sigma, kTypedHeightSigma);
  ASSERT_TRUE(scene.frame_rate);
  EXPECT_NEAR(*scene.frame_rate, 10.0, 0.01);

  const RunDocument run = read_run(out / "run.json");
  EXPECT_TRUE(fs::equivalent(run.scene, out / "scene" / "scene.json"));
  ASSERT_TRUE(run.calibration);
  EXPECT_NEAR(run.calibration->sigma_of_scale, scene.camera_sigma.focal, 0.01);
  EXPECT_GT(run.scale_sigma, run.calibration->sigma_of_scale);
  EXPECT_EQ(run.scale_status, Status::kOk) << run.scale_reason;
  // The command can be pasted.
  const std::string command = json::parse(test::read_text(out / "run.json"))["command"];
  EXPECT_THAT(command, HasSubstr("'" + name + "'"));
  EXPECT_THAT(test::read_text(out / "vehicles.csv"), StartsWith("frame,time_s,"));

  // Vehicles are known along their rays as badly as the scale, and their heights well.
  for (const VehicleFrame& frame : read_vehicles(out / "vehicles.json").frames) {
    for (const VehicleEstimate& v : frame.vehicles) {
      if (v.status != Status::kOk) continue;
      EXPECT_GT(std::sqrt(v.covariance(2, 2)), 0.08 * v.pose.center().z());
    }
  }
  // It is read from elsewhere, too.
  fs::rename(out, folder.path() / "moved");
  fs::create_directories(folder.path() / "deep");
  fs::rename(folder.path() / "moved", folder.path() / "deep" / "moved");
  EXPECT_EQ(run_camber({"info", (folder.path() / "deep" / "moved" / "scene").string()}).exit_code,
            0);
}

/// samples/own_drive/camera.yaml: 560 px, k1 -0.3.
TEST(Film, ShowsACameraOfWhichNothingIsGiven) {
  const test::TemporaryFolder folder;
  const fs::path out = folder.path() / "out", again = folder.path() / "again";
  const auto made = run_camber(
      {"reconstruct", film().string(), "--height", "1.4", "--out", out.string(), "--no-pictures"});
  ASSERT_EQ(made.exit_code, 0) << made.error;
  EXPECT_THAT(made.error, HasSubstr("the camera is calibrated by the drive: a field of view of "));
  const json run = json::parse(test::read_text(out / "run.json"));
  const json& shown = run.at("camera_by_drive");
  EXPECT_EQ(shown.at("used"), true);
  EXPECT_THAT(made.error, HasSubstr(shown.at("text").get<std::string>()));
  const double sigma = shown.at("camera").at("focal").at("relative_sigma");
  const double focal = shown.at("camera").at("focal").at("value");
  EXPECT_LT(std::abs(std::log(focal / 560.0)), 3.0 * sigma);
  EXPECT_LT(sigma, 0.1);
  EXPECT_NEAR(run.at("calibration").at("focal_sigma").get<double>(), sigma, 1e-6);
  // The result is of the scene with that camera, lens and all, wherever it goes.
  fs::rename(out, folder.path() / "moved");
  const Scene scene = read_scene(folder.path() / "moved" / "scene");
  EXPECT_EQ(scene.distortion.model, LensModel::kBrown);
  EXPECT_NEAR(scene.distortion.raw.fx, focal, 1e-3);
  EXPECT_NEAR(scene.camera_sigma.focal, sigma, 1e-6);
  EXPECT_EQ(scene.height_above_road, 1.4);
  // It is calibrated now: another run takes it as it is.
  const auto taken = run_camber({"reconstruct", (folder.path() / "moved" / "scene").string(),
                                 "--out", again.string(), "--no-pictures", "--detector", "none"});
  ASSERT_EQ(taken.exit_code, 0) << taken.error;
  EXPECT_THAT(taken.error, Not(HasSubstr("calibrated")));
  EXPECT_FALSE(json::parse(test::read_text(again / "run.json")).contains("camera_by_drive"));
}

/// A scene is left as it is; that with the other camera is the result's.
TEST(Film, OfASceneWithAGuessedCameraTheResultKeepsItsOwn) {
  const test::TemporaryFolder folder;
  const fs::path given = folder.path() / "given", out = folder.path() / "out";
  ASSERT_EQ(run_camber({"import", film().string(), "--fov", "75", "--height", "1.4", "--out",
                        given.string()})
                .exit_code,
            0);
  const std::string before = test::read_text(given / "scene.json");
  const auto made = run_camber(
      {"drive", given.string(), "--out", out.string(), "--no-pictures", "--detector", "none"});
  ASSERT_EQ(made.exit_code, 0) << made.error;
  EXPECT_THAT(made.error, HasSubstr("the camera is calibrated by the drive"));
  EXPECT_EQ(test::read_text(given / "scene.json"), before);
  const json run = json::parse(test::read_text(out / "run.json"));
  EXPECT_TRUE(fs::equivalent(run.at("scene").get<std::string>(), out / "scene" / "scene.json"));
  const Scene scene = read_scene(out / "scene");
  EXPECT_NEAR(scene.distortion.raw.fx,
              run.at("camera_by_drive").at("camera").at("focal").at("value").get<double>(), 1e-3);
  EXPECT_TRUE(fs::equivalent(image_file_of(scene.frames[0].image), film()));
  // The same with the guess alone.
  const auto kept = run_camber({"drive", given.string(), "--out", out.string(), "--no-pictures",
                                "--detector", "none", "--no-calibrate"});
  ASSERT_EQ(kept.exit_code, 0) << kept.error;
  EXPECT_FALSE(json::parse(test::read_text(out / "run.json")).contains("camera_by_drive"));
}

TEST(Film, ThatGivesNoAnswerLeavesNothing) {
  const test::TemporaryFolder folder;
  const fs::path out = folder.path() / "out";
  const auto refused = run_camber({"reconstruct", film().string(), "--height", "1.4", "--frames",
                                   "900", "--out", out.string()});
  EXPECT_EQ(refused.exit_code, 2);
  EXPECT_TRUE(test::snapshot(folder.path()).empty());
}

TEST(Film, OptionsOfTheCameraAreForFilmsAlone) {
  const test::TemporaryFolder folder;
  const auto refused =
      run_camber({"reconstruct", (test::source_dir() / "samples/steep_hill").string(), "--height",
                  "1.3", "--out", (folder.path() / "out").string()});
  EXPECT_ONE_SENTENCE(refused, 2, "--height: ");
  EXPECT_THAT(refused.error, HasSubstr("is a scene, which states its camera itself"));
}

TEST(Slips, WhereASceneIsExpectedAFilmNamesTheCommand) {
  const test::TemporaryFolder folder;
  const auto refused =
      run_camber({"triangulate", film().string(), "--out", (folder.path() / "a.ply").string()});
  EXPECT_ONE_SENTENCE(refused, 2, "camber import video ");
}

TEST(Slips, TheKindOfAnImportIsGuessed) {
  const test::TemporaryFolder folder;
  const auto made = run_camber({"import", film().string(), "--fov", "81", "--height", "1.4",
                                "--out", (folder.path() / "scene").string()});
  ASSERT_EQ(made.exit_code, 0) << made.error;
  EXPECT_THAT(made.error, HasSubstr("camber import video"));
  EXPECT_EQ(read_scene(folder.path() / "scene").frames.size(), 20u);
}

TEST(Slips, NumbersThatNoCameraHasAreRefused) {
  const auto refused = [](const std::vector<std::string>& options) {
    std::vector<std::string> words = {"reconstruct", film().string(), "--out", "/nowhere/out"};
    words.insert(words.end(), options.begin(), options.end());
    return run_camber(words);
  };
  EXPECT_ONE_SENTENCE(refused({"--height", "130"}), 2, "130 cm are 1.3");
  EXPECT_ONE_SENTENCE(refused({"--fov", "1.3", "--height", "70"}), 2, "1.3 rad are 74");
  EXPECT_ONE_SENTENCE(refused({"--fov", "70", "--height", "70"}), 2, "metres");
}

TEST(Slips, UnknownArgumentsAreListedAsTheyWereTyped) {
  const auto refused =
      run_camber({"reconstruct", film().string(), "--out", "o", "--heigth", "1.3", "--fow", "70"});
  EXPECT_ONE_SENTENCE(refused, 2, "--heigth 1.3 --fow 70");
  EXPECT_THAT(refused.error, HasSubstr("did you mean --height?"));
}

TEST(Slips, APipeThatIsClosedIsNoFailure) {
  const std::string program = CAMBER_PROGRAM;
  const test::TemporaryFolder folder;
  const std::string errors = (folder.path() / "errors").string();
  const std::string command = "sh -c '{ " + program + " reconstruct --help 2>" + errors +
                              "; echo $? >" + (folder.path() / "code").string() + "; } | true'";
  ASSERT_EQ(std::system(command.c_str()), 0);
  EXPECT_EQ(test::read_text(folder.path() / "code"), "0\n");
  EXPECT_EQ(test::read_text(errors), "");
}

}  // namespace
}  // namespace camber
