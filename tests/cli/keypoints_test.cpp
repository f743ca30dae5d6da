// camber keypoints: crops for training.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "camber/image/image_io.h"
#include "camber/synth/car_family.h"
#include "cli/run_program.h"
#include "scene/write_image.h"
#include "support/test_data.h"

namespace camber {
namespace {

using nlohmann::json;
using test::run_camber;

class Keypoints : public ::testing::Test {
 protected:
  std::string path(const std::string& name) const { return (folder_.path() / name).string(); }
  static test::ProgramResult synthesise(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), {"keypoints", "synthesise"});
    return run_camber(arguments);
  }
  test::TemporaryFolder folder_;
};

TEST_F(Keypoints, SynthesiseWritesArraysOfOneLengthTheSameForAnyThreads) {
  const auto made = synthesise({"--count", "9", "--seed", "4", "--size", "32", "--threads", "2",
                                "--out", path("a"), "--json"});
  ASSERT_EQ(made.exit_code, 0) << made.error;
  EXPECT_EQ(made.error, "");
  const json printed = json::parse(made.out);
  EXPECT_EQ(printed["crops"], 9);
  EXPECT_EQ(printed["cars"], 3);
  EXPECT_EQ(printed["seed"], 4);
  auto files = test::snapshot(path("a"));
  EXPECT_EQ(files["images.npy"].size(), 128u + 9u * 32u * 32u * 3u);
  EXPECT_EQ(files["keypoints.npy"].size(), 128u + 9u * 36u * 2u * 4u);
  EXPECT_EQ(files["visibility.npy"].size(), 128u + 9u * 36u);
  EXPECT_EQ(files["boxes.npy"].size(), 128u + 9u * 16u);
  EXPECT_EQ(files["true_boxes.npy"].size(), 128u + 9u * 16u);
  EXPECT_EQ(files["heading.npy"].size(), 128u + 9u * 12u);
  EXPECT_EQ(files["car.npy"].size(), 128u + 9u * 4u);
  const json described = json::parse(files["crops.json"]);
  EXPECT_EQ(described["format"], "camber keypoint crops 1");
  int points = 0;
  for (const auto& [name, count] : described["keypoints_by_visibility"].items()) {
    points += count.get<int>();
  }
  EXPECT_EQ(points, 9 * 36);
  for (const auto& [name, meaning] : described["files"].items()) EXPECT_EQ(files.count(name), 1u);

  // Over the old result, which it knows as its own.
  ASSERT_EQ(synthesise({"--count", "9", "--seed", "4", "--size", "32", "--threads", "1", "--quiet",
                        "--out", path("a")})
                .exit_code,
            0);
  auto again = test::snapshot(path("a"));
  for (auto* set : {&files, &again}) set->erase("run.json");  // times, command
  EXPECT_EQ(files, again);
}

TEST_F(Keypoints, SynthesiseMakesPiecesSplitsAndASheet) {
  const std::vector<std::string> common = {"--size", "16", "--quiet"};
  const auto run = [&](std::vector<std::string> arguments) {
    arguments.insert(arguments.end(), common.begin(), common.end());
    const auto result = synthesise(arguments);
    EXPECT_EQ(result.exit_code, 0) << result.error;
    EXPECT_EQ(result.out + result.error, "");
  };
  run({"--count", "6", "--out", path("all")});
  run({"--count", "2", "--first", "4", "--out", path("piece")});
  run({"--count", "6", "--split", "validation", "--out", path("validation")});
  auto all = test::snapshot(path("all")), piece = test::snapshot(path("piece"));
  auto validation = test::snapshot(path("validation"));
  constexpr std::size_t kHeader = 128, kImage = 16 * 16 * 3;
  EXPECT_EQ(piece["images.npy"].substr(kHeader), all["images.npy"].substr(kHeader + 4 * kImage));
  EXPECT_NE(validation["images.npy"], all["images.npy"]);
  run({"--count", "5", "--sheet", path("sheet.png")});
  const ImageInfo sheet = read_image_info(path("sheet.png"));
  EXPECT_EQ(sheet.format, "PNG");
  EXPECT_GT(sheet.width, 6 * 2 * 160);
}

TEST_F(Keypoints, RunDoesNotReplaceTheCropsThatItReads) {
  ASSERT_EQ(synthesise({"--count", "1", "--out", path("a"), "--quiet"}).exit_code, 0);
  const auto before = test::snapshot(path("a"));
  for (const char* file : {"images.npy", "crops.json"}) {
    EXPECT_ONE_SENTENCE(
        run_camber({"keypoints", "run", path("a"), "--out", path("a") + "/" + file}), 2,
        "is the input");
  }
  EXPECT_EQ(test::snapshot(path("a")), before);
}

/// A person's annotations with other axes would make a prior of nonsense.
TEST_F(Keypoints, APriorIsLearntFromShapesInItsAxesAlone) {
  const auto write_shapes = [&](bool header, double right) {
    std::ofstream csv(path("shapes.csv"));
    if (header) csv << "model,x00\n";
    for (int i = 0; i < 4; ++i) {
      const CarModel car = sample_car(CarClass::kSaloon, CounterRandom(8), i);
      csv << "car" << i;
      for (const Eigen::Vector3d& k : car.keypoints) {
        csv << ',' << k.x() << ',' << k.y() << ',' << right * k.z();
      }
      csv << '\n';
    }
  };
  const std::vector<std::string> learn = {
      "prior", "learn", path("shapes.csv"), "--out", path("prior.json"), "--json"};
  for (const bool header : {true, false}) {
    write_shapes(header, 1.0);
    const auto learnt = run_camber(learn);
    ASSERT_EQ(learnt.exit_code, 0) << learnt.error;
    EXPECT_EQ(json::parse(learnt.out)["shapes"][0]["samples"], 4) << header;
  }
  std::filesystem::remove(path("prior.json"));
  write_shapes(true, -1.0);
  EXPECT_ONE_SENTENCE(run_camber(learn), 2,
                      "shapes.csv: found 4 of 4 shapes that are no car, expected axes");
  EXPECT_FALSE(std::filesystem::exists(path("prior.json")));
}

TEST_F(Keypoints, BadOptionsAndForeignFoldersAreRefused) {
  EXPECT_ONE_SENTENCE(synthesise({}), 2, "either --out or --sheet");
  EXPECT_ONE_SENTENCE(synthesise({"--out", path("a"), "--count", "0"}), 2, "--count");
  EXPECT_ONE_SENTENCE(synthesise({"--out", path("a"), "--first", "-3"}), 2, "--first");
  EXPECT_ONE_SENTENCE(synthesise({"--out", path("a"), "--size", "8"}), 2, "--size");
  EXPECT_ONE_SENTENCE(synthesise({"--out", path("a"), "--split", "test"}), 2, "--split");
  EXPECT_ONE_SENTENCE(synthesise({"--out", path("a"), "--sheet", path("s.png")}), 2, "either");
  EXPECT_ONE_SENTENCE(synthesise({"--sheet", path("s.png"), "--count", "5000"}), 2, "1200");
  EXPECT_ONE_SENTENCE(synthesise({"--sheet", path("no/s.png"), "--count", "2"}), 3, "no/s.png");
  EXPECT_ONE_SENTENCE(synthesise({"--sheet", path("s.jpg"), "--count", "2"}), 2,
                      "--sheet: found '" + path("s.jpg") + "', expected FILE.png");
  EXPECT_ONE_SENTENCE(run_camber({"keypoints", "evaluate", "x", "--least-height", "nan"}), 2,
                      "--least-height");
  EXPECT_ONE_SENTENCE(run_camber({"keypoints"}), 2, "synthesise");
  const auto before = test::snapshot(folder_.path());
  EXPECT_TRUE(before.empty());
  std::filesystem::create_directory(path("mine"));
  test::write_bytes(path("mine") + "/notes.txt", "mine");
  EXPECT_ONE_SENTENCE(synthesise({"--count", "1", "--out", path("mine")}), 3, "mine");
  EXPECT_EQ(test::read_bytes(path("mine") + "/notes.txt"), "mine");
}

}  // namespace
}  // namespace camber
