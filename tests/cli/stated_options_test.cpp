// The options that results on standard output state: all that a command has.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>

#include "cli/run_program.h"
#include "support/test_data.h"

namespace camber {
namespace {

using test::ProgramResult;
using test::run_camber;

/// The options that --print-config lists, as keys of JSON; without those of the program and of
/// where it writes.
std::vector<std::string> options_of(std::vector<std::string> command) {
  static const std::set<std::string> others = {"seed", "threads", "quiet",
                                               "json", "out",     "overwrite"};
  command.emplace_back("--print-config");
  const ProgramResult printed = run_camber(command);
  EXPECT_EQ(printed.exit_code, 0) << printed.error;
  std::vector<std::string> keys;
  std::istringstream lines(printed.out);
  for (std::string line; std::getline(lines, line);) {
    if (line.empty() || line[0] == '[') continue;
    std::string key = line.substr(line.rfind("# ", 0) == 0 ? 2 : 0);
    key = key.substr(0, key.find(' '));
    if (others.count(key) > 0) continue;
    std::replace(key.begin(), key.end(), '-', '_');
    keys.push_back(key);
  }
  EXPECT_GT(keys.size(), 4u);
  return keys;
}

TEST(PrintedConfiguration, GivenBackIsTheSameLine) {
  const test::TemporaryFolder folder;
  const auto path = [&](const char* name) { return (folder.path() / name).string(); };
  const auto again = [&](const std::vector<std::string>& command) {
    std::vector<std::string> print = command;
    print.emplace_back("--print-config");
    const ProgramResult first = run_camber(print);
    EXPECT_EQ(first.exit_code, 0) << first.error;
    std::ofstream(path("c.toml")) << first.out;
    const ProgramResult second =
        run_camber({command[0], "--config", path("c.toml"), "--print-config"});
    EXPECT_EQ(second.exit_code, 0) << second.error;
    EXPECT_EQ(second.out, first.out);
    return first.out;
  };
  const std::string made = again({"synth", "--random", "7", "--frames", "1", "--size", "160x60",
                                  "--cloud-points", "1000", "--out", path("scene")});
  EXPECT_THAT(made, testing::HasSubstr("\nframes = 1\n"));
  EXPECT_THAT(made, testing::HasSubstr("\n# corner-radius = 9\n"));
  const ProgramResult scene = run_camber({"synth", "--config", path("c.toml")});
  EXPECT_EQ(scene.exit_code, 0) << scene.error;
  EXPECT_THAT(again({"render", "cloud.ply", "--camera", "0,0,9,0,0,0,0,1,0,60", "--out", "p.png"}),
              testing::HasSubstr("\n# view = "));
  EXPECT_THAT(again({"profile", "result", "--out", "p.csv"}),
              testing::HasSubstr("\n# levelling-sigma-deg = "));
}

TEST(Configuration, AnArrayForOneValueIsNamedWithItsLine) {
  const test::TemporaryFolder folder;
  const std::string config = folder.path() / "c.toml";
  std::ofstream(config) << "# steps\nstep = [1, 2]\n";
  EXPECT_ONE_SENTENCE(run_camber({"profile", "--config", config, "--out", folder.path() / "p.csv"}),
                      2, config + ": line 2: step: found an array of 2 values, expected one value");
  std::ofstream(config) << "antenna = [1, 2, 3, 4]\n";
  EXPECT_ONE_SENTENCE(run_camber({"import", "kitti", "--images", "i", "--config", config, "--out",
                                  folder.path() / "out"}),
                      2, config + ": line 1: ");
}

TEST(StatedOptions, SeedOfAPriorIsTheOneInUse) {
  const test::TemporaryFolder folder;
  const auto path = [&](const char* name) { return (folder.path() / name).string(); };
  const auto learn = [&](const char* name, std::vector<std::string> more) {
    std::vector<std::string> command = {"prior",    "learn",  "--family",       "--out",
                                        path(name), "--json", "--coefficients", "1"};
    command.insert(command.end(), more.begin(), more.end());
    const ProgramResult run = run_camber(command);
    EXPECT_EQ(run.exit_code, 0) << run.error;
    return nlohmann::json::parse(run.out).at("seed").get<std::uint64_t>();
  };
  const ProgramResult config =
      run_camber({"prior", "learn", "--family", "--out", path("a.json"), "--print-config"});
  const std::uint64_t seed = learn("a.json", {});
  EXPECT_THAT(config.out, testing::HasSubstr("\nseed = " + std::to_string(seed) + "\n"));
  EXPECT_EQ(learn("b.json", {"--seed", std::to_string(seed)}), seed);
  EXPECT_EQ(test::read_text(path("a.json")), test::read_text(path("b.json")));
  EXPECT_EQ(learn("c.json", {"--seed", "0"}), 0u);
  EXPECT_NE(test::read_text(path("a.json")), test::read_text(path("c.json")));
  EXPECT_THAT(test::read_text(path("a.json")),
              testing::HasSubstr("seed " + std::to_string(seed) + ","));
}

TEST(StatedOptions, AreAllThatACommandHas) {
  const test::TemporaryFolder folder;
  const auto path = [&](const char* name) { return (folder.path() / name).string(); };
  const std::string scene = (test::source_dir() / "samples/steep_hill/scene.json").string();
  const std::string result = path("result"), cloud = path("result/road.ply");
  const std::string labels = path("labels.txt"), calibration = path("calib.txt");
  ASSERT_EQ(run_camber({"reconstruct", scene, "--no-pictures", "--out", result}).exit_code, 0);
  ASSERT_EQ(run_camber({"vehicles", scene, "--surface", result, "--out", path("vehicles.json"),
                        "--kitti-labels", labels})
                .exit_code,
            0);
  std::ofstream(calibration) << "P2: 720 0 620 0 0 720 170 0 0 0 1 0\n";
  for (const std::vector<std::string>& command : std::vector<std::vector<std::string>>{
           {"plane", cloud},
           {"patches", cloud, "--out", path("patches")},
           {"ground", cloud, "--out", path("ground.ply")},
           {"convert", cloud, "--out", path("convert.ply")},
           {"filter", cloud, "--normals", "10", "--up", "0,-1,0", "--out", path("filter.ply")},
           {"render", result, "--hide", "points,vehicles", "--out", path("picture.png")},
           {"lift", labels, "--surface", result, "--calib", calibration, "--out", path("l.txt")},
           {"evaluate", "--truth", scene, "--estimate", result},
       }) {
    SCOPED_TRACE(command[0]);
    std::vector<std::string> stating = command;
    stating.emplace_back("--json");
    const ProgramResult run = run_camber(stating);
    ASSERT_EQ(run.exit_code, 0) << run.error;
    const nlohmann::json options = nlohmann::json::parse(run.out).at("options");
    for (const std::string& key : options_of(command)) {
      EXPECT_TRUE(options.contains(key)) << key;
    }
    EXPECT_FALSE(options.contains("command"));
    if (command[0] == "filter") {
      EXPECT_EQ(options["up"], nlohmann::json({0.0, -1.0, 0.0}));
      EXPECT_EQ(options["format"], "");
    }
    if (command[0] == "render") {
      EXPECT_EQ(options["hide"], nlohmann::json({"points", "vehicles"}));
      EXPECT_EQ(options["upscale"], 1.0);
    }
    if (command[0] == "lift") {
      EXPECT_EQ(options["calib"], nlohmann::json({calibration}));
    }
    if (command[0] == "evaluate") {
      EXPECT_EQ(options["image_size"], nlohmann::json({1242, 375}));
    }
  }
}

}  // namespace
}  // namespace camber
