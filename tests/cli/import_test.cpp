// camber import on sound and broken input: exit codes, one sentence on stderr, nothing
// half-written.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "camber/scene/scene.h"
#include "cli/run_program.h"
#include "scene/write_image.h"
#include "support/test_data.h"

namespace camber {
namespace {

using test::picture;
using test::run_camber;
using test::snapshot;
using test::write_bytes;
using test::write_png;
namespace fs = std::filesystem;

TEST(Program, UsageErrorsExitWithTwo) {
  EXPECT_ONE_SENTENCE(run_camber({"no_such_command"}), 2, "camber --help lists");
  EXPECT_ONE_SENTENCE(run_camber({"import"}), 2, "");
  EXPECT_ONE_SENTENCE(run_camber({"import", "kitti"}), 2, "--images is required");
  EXPECT_ONE_SENTENCE(run_camber({"import", "kitti", "--no-such-option"}), 2, "");
}

TEST(Program, WithoutACommandListsThem) {
  const auto bare = run_camber({});
  EXPECT_EQ(bare.exit_code, 2);
  EXPECT_EQ(bare.out, "");
  EXPECT_THAT(bare.error, testing::StartsWith("camber: a command is required\n"));
  for (const char* verb : {"reconstruct", "plane", "profile", "synth"}) {
    EXPECT_THAT(bare.error, testing::HasSubstr("\n  " + std::string(verb) + " "));
  }
}

TEST(Program, HelpAndVersionExitWithZero) {
  const auto help = run_camber({"import", "kitti", "--help"});
  EXPECT_EQ(help.exit_code, 0);
  EXPECT_EQ(help.error, "");
  EXPECT_THAT(help.out, ::testing::HasSubstr("Examples:\n  camber import kitti --images"));
  EXPECT_EQ(run_camber({"--version"}).exit_code, 0);
}

class ImportKitti : public ::testing::Test {
 protected:
  ImportKitti() {
    fs::create_directories(path("image_02"));
    for (const int id : {0, 1, 2}) {
      write_png(path("image_02/00000" + std::to_string(id) + ".png"), 80, 60, 2, 8,
                picture(80, 60, 3));
    }
    write_bytes(path("calib.txt"), "P2: 100 0 40 6 0 100 30 1.3 0 0 1 0.01\n");
    write_bytes(path("labels.txt"), "0 3 Car 0 2 0.1 10 20 30 40 1.5 1.75 4.25 1 1.6 20 0.5\n");
    write_bytes(path("poses.txt"),
                "1 0 0 0 0 1 0 0 0 0 1 0\n1 0 0 0 0 1 0 0 0 0 1 1\n"
                "1 0 0 0 0 1 0 0 0 0 1 2\n");
  }
  std::string path(const std::string& name) const { return folder_.path() / name; }
  test::ProgramResult import(std::vector<std::string> more) {
    std::vector<std::string> all = {"import",         "kitti", "--images",
                                    path("image_02"), "--out", path("out/scene.json")};
    all.insert(all.end(), more.begin(), more.end());
    return run_camber(all);
  }
  /// The import fails with exit code 2 and a sentence, and every file is as it was.
  void expect_refused(const std::vector<std::string>& more, const std::string& part) {
    const auto before = snapshot(folder_.path());
    EXPECT_ONE_SENTENCE(import(more), 2, part);
    EXPECT_EQ(snapshot(folder_.path()), before);
  }

  test::TemporaryFolder folder_;
};

TEST_F(ImportKitti, WritesAManifestAndSaysWhatItFound) {
  const auto result = import({"--labels", path("labels.txt"), "--detections-from-labels", "--poses",
                              path("poses.txt"), "--frames", "0:2:2", "--camera-height", "1.7"});
  EXPECT_EQ(result.exit_code, 0) << result.error;
  EXPECT_EQ(result.out, "");
  EXPECT_EQ(result.error, "camber: " + path("out/scene.json") +
                              ": 2 frames (0 to 2) of 80 x 60 pixels, 1 detection (truth_boxes); "
                              "truth: 1 vehicle, 2 poses\n"
                              "  missing: no masks: the road is found by geometry alone\n");
  const Scene scene = read_scene(path("out/scene.json"));
  EXPECT_EQ(scene.frames.size(), 2u);
  EXPECT_EQ(scene.detections_source, "truth_boxes");
  EXPECT_EQ(scene.height_above_road, 1.7);
  EXPECT_EQ(scene.frames[0].vehicles.size(), 1u);
  EXPECT_TRUE(fs::exists(scene.frames[0].image));
  // Again, over the old one, and by the folder's name.
  EXPECT_EQ(import({}).exit_code, 0);
  EXPECT_EQ(read_scene(path("out")).frames.size(), 3u);
  EXPECT_EQ(run_camber({"import", "kitti", "--images", path("image_02"), "--out", path("new/deep")})
                .exit_code,
            0);
  EXPECT_TRUE(fs::exists(path("new/deep/scene.json")));
}

TEST_F(ImportKitti, TheHeightHasTwoNamesAndASigma) {
  ASSERT_EQ(import({"--height", "1.7", "--height-sigma", "0.05"}).exit_code, 0);
  EXPECT_EQ(read_scene(path("out")).height_above_road, 1.7);
  EXPECT_EQ(read_scene(path("out")).height_sigma, 0.05);
  expect_refused({"--height-sigma", "0"}, "--height-sigma");
}

TEST_F(ImportKitti, SaysWhatItFoundAsJson) {
  const auto run = import({"--labels", path("labels.txt"), "--json", "--quiet"});
  ASSERT_EQ(run.exit_code, 0) << run.error;
  EXPECT_EQ(run.error, "");
  const nlohmann::json found = nlohmann::json::parse(run.out);
  for (const char* key : {"version", "seed", "options", "timings_ms"}) {
    EXPECT_TRUE(found.contains(key)) << key;
  }
  EXPECT_EQ(found["scene"], path("out/scene.json"));
  EXPECT_EQ(found["frames"], (std::vector<int>{0, 1, 2}));
  EXPECT_EQ(found["detections"], 0);
  EXPECT_EQ(found["truth"],
            nlohmann::json({{"vehicles", 1}, {"poses", 0}, {"depth", 0}, {"cloud", false}}));
  EXPECT_EQ(found["options"]["labels"], path("labels.txt"));
  const auto plain = import({});
  EXPECT_THAT(plain.error, ::testing::HasSubstr(
                               ": 3 frames (0 to 2) of 80 x 60 pixels, 0 detections; truth: none\n"
                               "  missing: no boxes"));
}

TEST(ImportSynthiaSf, SaysWhatItFound) {
  const test::TemporaryFolder folder;
  for (const char* kind : {"RGBLeft", "DepthLeft"}) {
    fs::create_directories(folder.path() / "SEQ1" / kind);
    for (const char* name : {"0000003.png", "0000004.png"}) {
      write_png(folder.path() / "SEQ1" / kind / name, 64, 36, 2, 8, picture(64, 36, 3));
    }
  }
  const std::string manifest = folder.path() / "out" / "scene.json";
  const auto run = run_camber({"import", "synthia-sf", "--sequence",
                               (folder.path() / "SEQ1").string(), "--out", manifest, "--json"});
  ASSERT_EQ(run.exit_code, 0) << run.error;
  EXPECT_THAT(run.error, ::testing::StartsWith("camber: " + manifest +
                                               ": 2 frames (3 to 4) of 64 x 36 pixels, 0 "
                                               "detections; truth: 2 depth images\n"
                                               "  missing: no camera height, speed or poses: the "
                                               "result is up to scale (--height)\n"));
  const nlohmann::json found = nlohmann::json::parse(run.out);
  EXPECT_EQ(found["name"], "SEQ1");
  EXPECT_EQ(found["frames"], (std::vector<int>{3, 4}));
  EXPECT_EQ(found["truth"]["depth"], 2);
  EXPECT_TRUE(found["options"]["camera_height"].is_null());
}

TEST_F(ImportKitti, PathsBelowTheManifestAreRelative) {
  EXPECT_EQ(
      run_camber({"import", "kitti", "--images", path("image_02"), "--out", path("scene.json")})
          .exit_code,
      0);
  EXPECT_THAT(test::read_bytes(path("scene.json")),
              ::testing::HasSubstr("\"image\": \"image_02/000000.png\""));
}

TEST_F(ImportKitti, BrokenInputIsRefusedAndNothingIsLeft) {
  expect_refused({"--labels", path("none.txt")}, "none.txt: no such file");
  expect_refused({"--detections-from-labels"}, "--labels");
  expect_refused({"--frames", "0:9"}, "frame 3 is not in the scene");
  expect_refused({"--frames", "zero"}, "found 'zero'");
  expect_refused({"--camera", "7"}, "--camera");
  expect_refused({"--camera", "0"}, "calib.txt: found P2, expected P0");
  expect_refused({"--camera-height", "-1"}, "--height: Value -1 not in range");
  expect_refused({"--reference", "8"}, "reference frame 8");
  expect_refused({"--calib", path("labels.txt")}, "labels.txt: line 1");
  expect_refused({"--velodyne", path("none")}, "none: is not a folder");
  expect_refused({"--labels", path("labels.txt"), "--detections-from-labels", "--detections",
                  path("labels.txt")},
                 "excludes");
  write_bytes(path("labels.txt"), "0 3 Car 0 2\n");
  expect_refused({"--labels", path("labels.txt")}, "labels.txt: line 1: found 5 columns");
  write_bytes(path("poses.txt"), "1 0 0 0 0 1 0 0 0 0 1 0\n");
  expect_refused({"--poses", path("poses.txt")}, "poses.txt: found 1 poses");
  write_bytes(path("calib.txt"), "P2: nan 0 40 6 0 100 30 1.3 0 0 1 0.01\n");
  expect_refused({}, "calib.txt: line 1, column 5: found 'nan'");
}

TEST_F(ImportKitti, BrokenImagesAreRefused) {
  const std::string image = test::read_bytes(path("image_02/000001.png"));
  write_bytes(path("image_02/000001.png"), image.substr(0, 20));
  expect_refused({}, "000001.png: found a truncated PNG image");
  write_png(path("image_02/000001.png"), 40, 30, 2, 8, picture(40, 30, 3));
  expect_refused({}, "000001.png: found an image of 40 x 30 pixels, expected 80 x 60");
  write_bytes(path("image_02/000001.png"), "");
  expect_refused({}, "000001.png: found an empty file");
}

TEST_F(ImportKitti, AnOldManifestSurvivesAFailure) {
  ASSERT_EQ(import({}).exit_code, 0);
  write_bytes(path("calib.txt"), "P2: 1 2 3\n");
  expect_refused({}, "calib.txt: line 1: found 3 numbers for P2, expected 12");
  EXPECT_EQ(read_scene(path("out")).frames.size(), 3u);
}

TEST_F(ImportKitti, PlacesThatCannotBeWrittenExitWithThree) {
  const auto before = snapshot(folder_.path());
  EXPECT_ONE_SENTENCE(run_camber({"import", "kitti", "--images", path("image_02"), "--out",
                                  path("calib.txt/scene.json")}),
                      3, "calib.txt");
  EXPECT_ONE_SENTENCE(
      run_camber({"import", "kitti", "--images", path("image_02"), "--out", "/proc/no/scene.json"}),
      3, "/proc/no");
  EXPECT_EQ(snapshot(folder_.path()), before);
}

TEST_F(ImportKitti, WarningsAreSilencedByQuiet) {
  write_bytes(path("labels.txt"), "7 3 Car 0 2 0.1 10 20 30 40 1.5 1.75 4.25 1 1.6 20 0.5\n");
  const auto loud = import({"--labels", path("labels.txt")});
  EXPECT_EQ(loud.exit_code, 0);
  EXPECT_THAT(loud.error, ::testing::StartsWith("camber: warning: "));
  EXPECT_EQ(import({"--labels", path("labels.txt"), "--quiet"}).error, "");
}

}  // namespace
}  // namespace camber
