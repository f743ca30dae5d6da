// camber tiles: plan, run, join as a user, a scheduler and a kill see them.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <future>
#include <iomanip>
#include <nlohmann/json.hpp>

#include "camber/cloud/cloud_io.h"
#include "camber/core/random.h"
#include "cli/run_program.h"
#include "scene/write_image.h"
#include "support/test_data.h"
#include "tiles/made_survey.h"

namespace camber {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using test::ProgramResult;
using test::run_camber;
using testing::HasSubstr;

class Tiles : public ::testing::Test {
 protected:
  void SetUp() override {
    const RoadCloud cloud = test::made_survey(330.0, 1.2);
    points_ = cloud.size();
    write_cloud(test::strip_of(cloud, 0.0, 140.0), path("west.laz"));
    write_cloud(test::strip_of(cloud, 140.0, 400.0), path("east.laz"));
    write_cloud(cloud, path("whole.laz"));
  }
  std::string path(const std::string& name) const { return folder_.path() / name; }
  static ProgramResult must(const std::vector<std::string>& words) {
    const ProgramResult result = run_camber(words);
    EXPECT_EQ(result.exit_code, 0) << result.error;
    return result;
  }
  static json run(std::vector<std::string> words) {
    words.emplace_back("--json");
    const ProgramResult result = must(words);
    return result.exit_code == 0 ? json::parse(result.out) : json();
  }
  std::vector<std::string> plan_words(const std::string& name) const {
    return {"tiles", "plan",  path("west.laz"), path("east.laz"),   "--tile",
            "100",   "--out", path(name),       "--largest-object", "10"};
  }
  /// The surface in tiles answers as the one file does.
  void expect_by_tile(const json& surface) const {
    EXPECT_GT(test::files_below(path("plan/patches/surface")).size(), 4u);
    {
      std::ofstream line(path("line.csv"));
      line << std::setprecision(12) << "x,y,z\n";
      for (int x = 20; x <= 120; x += 10) line << 651000 + x << "," << 6270080 << ",100\n";
    }
    std::map<std::string, std::string> profiles;
    for (const std::string& input : {path("plan/patches"), path("plan/patches/surface.json")}) {
      must({"profile", input, "--along", path("line.csv"), "--reach", "20", "--out",
            path("profile.csv")});
      profiles[test::read_text(path("profile.csv"))] = input;
    }
    EXPECT_EQ(profiles.size(), 1u);
    // Without the file that holds all.
    fs::rename(path("plan/patches/surface.json"), path("surface.json"));
    must({"profile", path("plan/patches"), "--along", path("line.csv"), "--reach", "20", "--out",
          path("profile.csv")});
    EXPECT_EQ(profiles.count(test::read_text(path("profile.csv"))), 1u);
    const json drawn = run({"render", path("plan/patches"), "--view", "map", "--size", "640x480",
                            "--out", path("map.png")});
    EXPECT_EQ(drawn["options"]["view"], "map");
    EXPECT_TRUE(fs::exists(path("map.png")));
    must({"render", path("plan/patches"), "--view", "bev", "--bounds",
          "651000,6270000,651100,6270100", "--out", path("part.png")});
    fs::rename(path("surface.json"), path("plan/patches/surface.json"));
    EXPECT_ONE_SENTENCE(
        run_camber({"render", path("whole.laz"), "--view", "map", "--out", path("no.png")}), 2,
        "camber tiles join --job patches");
    std::size_t patches = 0;
    const json index = json::parse(test::read_text(path("plan/patches/surface/index.json")));
    for (const json& tile : index["tiles"]) patches += tile["patches"].get<std::size_t>();
    EXPECT_EQ(patches, surface["patches"].size());
  }
  /// All files of a plan but for what does not hang on its input.
  std::map<std::string, std::string> files(const std::string& name) const {
    return test::files_below(path(name));
  }

  test::TemporaryFolder folder_;
  std::size_t points_ = 0;
};

TEST_F(Tiles, PlanRunJoin) {
  const json planned = run(plan_words("plan"));
  EXPECT_EQ(planned["points"], points_);
  EXPECT_EQ(planned["tiles"], 16);
  EXPECT_EQ(planned["ground"]["largest_object"], 10.0);
  EXPECT_EQ(planned["options"]["tile"], 100.0);
  const json ran = run({"tiles", "run", path("plan"), "--job", "ground"});
  EXPECT_EQ(ran["points"], points_);
  EXPECT_EQ(ran["points_answered"], points_);
  EXPECT_GT(ran["points_read"], ran["points_answered"]);
  EXPECT_GT(ran["counts"]["ground"].get<std::size_t>(), points_ / 2);
  const json again = run({"tiles", "run", path("plan"), "--job", "ground"});
  EXPECT_EQ(again["done_before"], 16);
  EXPECT_EQ(again["counts"], ran["counts"]);
  const json joined = run({"tiles", "join", path("plan"), "--job", "ground"});
  EXPECT_EQ(joined["counts"], ran["counts"]);
  EXPECT_EQ(joined["out"], path("plan/ground/index.json"));
  const std::string text = must({"tiles", "run", path("plan"), "--job", "ground"}).out;
  EXPECT_THAT(text, HasSubstr("16 tiles were done before"));

  // The undivided cloud has the same classes.
  const json whole =
      run({"ground", path("whole.laz"), "--plan", path("plan"), "--out", path("whole_ground.laz")});
  EXPECT_EQ(whole["ground"], ran["counts"]["ground"]);
  std::vector<fs::path> tiles;
  for (const auto& entry : fs::directory_iterator(path("plan/ground"))) {
    if (entry.path().extension() == ".laz") tiles.push_back(entry.path());
  }
  EXPECT_EQ(test::classes_by_id(tiles), test::classes_by_id({path("whole_ground.laz")}));
}

TEST_F(Tiles, ShardsInAnyOrderGiveTheSameFiles) {
  must(plan_words("plan"));
  must({"tiles", "run", path("plan"), "--job", "ground", "--threads", "2"});
  must({"tiles", "join", path("plan"), "--job", "ground"});
  const auto expected = files("plan");
  fs::remove_all(path("plan/ground"));
  for (const char* const shard : {"3/3", "1/3", "2/3"}) {
    must({"tiles", "run", path("plan"), "--job", "ground", "--shard", shard, "--threads", "1"});
  }
  must({"tiles", "join", path("plan"), "--job", "ground"});
  EXPECT_EQ(files("plan"), expected);
  fs::remove_all(path("plan/ground"));
  for (int tile = 15; tile >= 0; --tile) {
    must({"tiles", "run", path("plan"), "--job", "ground", "--tile", std::to_string(tile)});
  }
  must({"tiles", "join", path("plan"), "--job", "ground"});
  EXPECT_EQ(files("plan"), expected);
}

TEST_F(Tiles, TwoProcessesAtOnceGiveTheSameFiles) {
  must(plan_words("plan"));
  const std::vector<std::string> words = {"tiles", "run", path("plan"), "--job", "ground"};
  must(words);
  const auto expected = files("plan");
  for (const bool shards : {true, false}) {
    fs::remove_all(path("plan/ground"));
    std::vector<std::future<ProgramResult>> runs;
    for (const char* const shard : {"1/2", "2/2"}) {
      std::vector<std::string> one = words;
      one.insert(one.end(), {"--threads", "1"});
      if (shards) one.insert(one.end(), {"--shard", shard});  // else both do all tiles
      runs.push_back(std::async(std::launch::async, [one] { return run_camber(one); }));
    }
    for (std::future<ProgramResult>& one : runs) {
      const ProgramResult result = one.get();
      EXPECT_EQ(result.exit_code, 0) << result.error;
    }
    EXPECT_EQ(files("plan"), expected) << shards;
  }
}

TEST_F(Tiles, WhatIsBrokenIsNamedAndWhatIsDoneStays) {
  // Of two coordinate systems.
  must({"convert", path("west.laz"), "--crs", "EPSG:32631", "--out", path("utm.laz")});
  EXPECT_ONE_SENTENCE(
      run_camber({"tiles", "plan", path("utm.laz"), path("east.laz"), "--out", path("two")}), 2,
      "EPSG:32631");
  EXPECT_FALSE(fs::exists(path("two")));
  must(plan_words("plan"));
  const std::vector<std::string> words = {"tiles", "run", path("plan"), "--job", "ground"};
  must(words);
  const auto expected = files("plan");
  fs::remove_all(path("plan/ground"));
  std::vector<std::string> tiles;
  for (const auto& [name, bytes] : expected) {
    if (fs::path(name).parent_path() == "tiles" && fs::path(name).extension() == ".laz") {
      tiles.push_back(name);
    }
  }
  ASSERT_EQ(tiles.size(), 16u);
  const std::string broken = "plan/" + tiles.back();
  std::string damaged = expected.at(tiles.back());
  damaged[damaged.size() / 2] = static_cast<char>(damaged[damaged.size() / 2] ^ 1);
  test::write_bytes(path(broken), damaged);
  EXPECT_ONE_SENTENCE(run_camber(words), 2, fs::path(broken).filename().string());
  const auto left = files("plan/ground");
  EXPECT_GT(left.size(), 2u);
  fs::remove(path(broken));
  EXPECT_ONE_SENTENCE(run_camber(words), 2, fs::path(broken).filename().string());
  for (const auto& [name, bytes] : left) EXPECT_EQ(files("plan/ground").at(name), bytes) << name;
  test::write_bytes(path(broken), expected.at(tiles.back()));
  std::vector<std::string> again = words;
  EXPECT_GT(run(std::move(again))["done_before"], 0);
  EXPECT_EQ(files("plan"), expected);
}

TEST_F(Tiles, AFullDiskKeepsWhatIsDone) {
  must(plan_words("plan"));
  const std::vector<std::string> words = {"tiles", "run", path("plan"), "--job", "ground"};
  must(words);
  const auto expected = files("plan");
  std::vector<std::size_t> sizes;
  for (const auto& [name, bytes] : expected) {
    if (name.rfind("ground/", 0) == 0 && fs::path(name).extension() == ".laz") {
      sizes.push_back(bytes.size());
    }
  }
  ASSERT_EQ(sizes.size(), 16u);
  std::sort(sizes.begin(), sizes.end());
  // Files beyond a size between those of the first tile, which lies at the survey's corner, and the
  // largest are refused, as by a disk that is full.
  const std::size_t blocks = (sizes[8] + 511) / 512;
  ASSERT_LT(512 * blocks, sizes.back());
  fs::remove_all(path("plan/ground"));
  test::Surroundings full;
  full.shell = "trap '' XFSZ; ulimit -f " + std::to_string(blocks);
  std::vector<std::string> limited = words;
  limited.insert(limited.end(), {"--threads", "1"});
  EXPECT_ONE_SENTENCE(test::run_camber_in(full, limited), 3, "plan/ground");
  for (const auto& [name, bytes] : files("plan/ground")) {
    if (fs::path(name).filename().string()[0] == '.') continue;
    EXPECT_EQ(bytes, expected.at("ground/" + name)) << name;
  }
  must(words);
  std::map<std::string, std::string> found;
  for (const auto& [name, bytes] : files("plan")) {
    if (fs::path(name).filename().string()[0] != '.') found[name] = bytes;
  }
  EXPECT_EQ(found, expected);
  // A plan, too: nothing of it counts before it is complete.
  full.shell = "trap '' XFSZ; ulimit -f 100";
  EXPECT_ONE_SENTENCE(test::run_camber_in(full, plan_words("other")), 3, "other");
  EXPECT_FALSE(fs::exists(path("other/index.json")));
  must(plan_words("other"));
  EXPECT_EQ(files("other/tiles"), files("plan/tiles"));
}

TEST_F(Tiles, PatchesBecomeOneSurfaceAndLabels) {
  run(plan_words("plan"));
  const json ran = run({"tiles", "run", path("plan"), "--job", "patches"});
  EXPECT_EQ(ran["points"], points_);
  const json joined = run({"tiles", "join", path("plan"), "--job", "patches"});
  EXPECT_GT(joined["patches"], 20);
  EXPECT_EQ(joined["on_pieces"], ran["counts"]["on_pieces"]);
  const json surface = json::parse(test::files_below(path("plan/patches")).at("surface.json"));
  EXPECT_EQ(surface["patches"].size(), joined["patches"]);
  const json labels = run({"tiles", "run", path("plan"), "--job", "labels"});
  EXPECT_LE(labels["counts"]["on_patches"], joined["on_pieces"]);
  expect_by_tile(surface);
  EXPECT_GT(labels["counts"]["on_patches"], points_ / 2);
  run({"tiles", "join", path("plan"), "--job", "labels"});
  // Other shards, in another order, by one thread, and another plan: the same surface.
  run(plan_words("again"));
  for (const char* shard : {"3/3", "1/3", "2/3"}) {
    run({"tiles", "run", path("again"), "--job", "patches", "--shard", shard, "--threads", "1"});
  }
  run({"tiles", "join", path("again"), "--job", "patches"});
  EXPECT_EQ(files("again/patches").at("surface.json"), files("plan/patches").at("surface.json"));
  EXPECT_EQ(files("again/patches").at("patches.ids"), files("plan/patches").at("patches.ids"));
  // Before there are patches there are no labels.
  run(plan_words("bare"));
  const ProgramResult early = run_camber({"tiles", "run", path("bare"), "--job", "labels"});
  EXPECT_EQ(early.exit_code, 2);
  EXPECT_THAT(early.error, HasSubstr("patches.ids"));
}

/// A crowned road of 200 m in a bend, with bushes beside it; classes 2 and 1.
RoadCloud made_road() {
  RoadCloud cloud;
  cloud.origin = {456000.0, 5428000.0, 0.0};
  const CounterRandom random(8);
  std::vector<int> classes;
  for (std::uint64_t i = 0; i < 40000; ++i) {
    const double s = random.uniform(3 * i, -15.0, 215.0),
                 v = random.uniform(3 * i + 1, -12.0, 12.0);
    const double turn = s / 300.0, r = 300.0 - v;
    const bool bush = std::abs(v) > 4.0 && random.uniform(3 * i + 2) < 0.2;
    const double z = 100.0 + 0.03 * s + std::sin(s / 25.0) - 0.025 * std::abs(v) +
                     0.01 * random.normal(i) + (bush ? 1.0 : 0.0);
    // On a lattice of millimetres.
    const auto on_lattice = [](double x) { return std::round(1000.0 * x) / 1000.0; };
    cloud.points.push_back(Eigen::Vector3d(on_lattice(200.0 + r * std::sin(turn)),
                                           on_lattice(400.0 - r * std::cos(turn)), on_lattice(z))
                               .cast<float>());
    classes.push_back(bush ? 1 : 2);
  }
  cloud.labels["classification"] = std::move(classes);
  return cloud;
}

TEST_F(Tiles, ProfileIsThatOfTheWhole) {
  write_cloud(made_road(), path("road.laz"));
  {
    std::ofstream line(path("line.csv")), other(path("other.csv"));
    line << "x,y\n" << std::setprecision(12);
    other << "x,y\n456200,5428100\n456300,5428110\n";
    for (int s = 0; s <= 200; s += 4) {
      line << 456200.0 + 300.0 * std::sin(s / 300.0) << ","
           << 5428400.0 - 300.0 * std::cos(s / 300.0) << "\n";
    }
  }
  must({"profile", path("road.laz"), "--along", path("line.csv"), "--ground-from", "class",
        "--crown", "--out", path("whole.csv")});
  must({"tiles", "plan", path("road.laz"), "--tile", "40", "--out", path("plan")});
  const std::vector<std::string> step = {"tiles",          "run",           path("plan"),
                                         "--job",          "profile",       "--along",
                                         path("line.csv"), "--ground-from", "class"};
  EXPECT_ONE_SENTENCE(run_camber({"tiles", "run", path("plan"), "--job", "profile"}), 2, "--along");
  for (const char* const shard : {"2/2", "1/2"}) {
    std::vector<std::string> words = step;
    words.insert(words.end(), {"--shard", shard});
    must(words);
  }
  EXPECT_ONE_SENTENCE(
      run_camber({"tiles", "join", path("plan"), "--job", "profile", "--along", path("other.csv")}),
      2, "another line");
  const json joined = run(
      {"tiles", "join", path("plan"), "--job", "profile", "--along", path("line.csv"), "--crown"});
  const json whole = run({"profile", path("road.laz"), "--along", path("line.csv"), "--ground-from",
                          "class", "--crown"});
  EXPECT_EQ(joined["ground_points"], whole["ground_points"]);
  // The tiles hold the corridor, not the survey.
  EXPECT_LT(joined["points"].get<std::size_t>(), 30000u);
  const auto files = test::files_below(folder_.path());
  EXPECT_EQ(files.at("plan/profile/profile.csv"), files.at("whole.csv"));
  EXPECT_EQ(json::parse(files.at("plan/profile/profile.json"))["stations"], whole["stations"]);
}

TEST_F(Tiles, KilledAndRepeatedGivesEqualFiles) {
  must(plan_words("plan"));
  must({"tiles", "run", path("plan"), "--job", "ground"});
  const auto expected = files("plan");
  const std::vector<std::vector<std::string>> steps = {
      plan_words("killed"), {"tiles", "run", path("killed"), "--job", "ground"}};
  int killed = 0;
  for (int round = 0; round < 2; ++round) {
    fs::remove_all(path("killed"));
    for (const std::vector<std::string>& step : steps) {
      for (int attempt = 0;; ++attempt) {
        ASSERT_LT(attempt, 20);                                   // the last has a minute
        const int after = 20 + 10 * round + (60 << attempt / 2);  // ms
        const int code = run_camber(step, after, attempt % 2 == 0 ? SIGKILL : SIGTERM).exit_code;
        if (code == 0) break;
        ASSERT_THAT(code, testing::AnyOf(130, 128 + SIGKILL, 128 + SIGTERM));
        ++killed;
      }
    }
    // What a killed write staged has another name.
    std::map<std::string, std::string> found;
    for (const auto& [name, bytes] : files("killed")) {
      if (expected.count(name) > 0 || fs::path(name).filename().string()[0] != '.') {
        found[name] = bytes;
      }
    }
    EXPECT_EQ(found, expected);
  }
  EXPECT_GT(killed, 6);
}

TEST_F(Tiles, RefusesInOneSentence) {
  EXPECT_ONE_SENTENCE(run_camber({"tiles", "run", path("none"), "--job", "ground"}), 2,
                      "expected a folder that camber tiles plan wrote");
  EXPECT_ONE_SENTENCE(
      run_camber({"tiles", "plan", path("west.laz"), path("gone.laz"), "--out", path("plan")}), 2,
      "gone.laz");
  EXPECT_FALSE(fs::exists(path("plan")));
  must(plan_words("plan"));
  EXPECT_ONE_SENTENCE(
      run_camber({"tiles", "plan", path("west.laz"), "--tile", "100", "--out", path("plan")}), 2,
      "another value of 'inputs'");
  EXPECT_ONE_SENTENCE(run_camber({"tiles", "plan", path("west.laz"), "--in-place", "--tile", "50",
                                  "--out", path("other")}),
                      2, "--in-place");
  EXPECT_ONE_SENTENCE(run_camber({"tiles", "run", path("plan"), "--job", "ground", "--tile", "16"}),
                      2, "0 to 15");
  EXPECT_ONE_SENTENCE(
      run_camber({"tiles", "run", path("plan"), "--job", "ground", "--shard", "3/2"}), 2, "i/n");
  EXPECT_ONE_SENTENCE(run_camber({"tiles", "join", path("plan"), "--job", "ground"}), 1,
                      "16 of 16 tiles are not done");
  std::string index = test::read_text(path("plan/index.json"));
  test::write_bytes(path("plan/index.json"), index.substr(0, index.size() / 2));
  EXPECT_ONE_SENTENCE(run_camber({"tiles", "run", path("plan"), "--job", "ground"}), 2,
                      "index.json");
  const std::size_t cell = index.find("\"cell\": ");
  index.insert(cell + 8, "-");
  test::write_bytes(path("plan/index.json"), index);
  EXPECT_ONE_SENTENCE(run_camber({"tiles", "run", path("plan"), "--job", "ground"}), 2,
                      "ground.cell");
}

}  // namespace
}  // namespace camber
