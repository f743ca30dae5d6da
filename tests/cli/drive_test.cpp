// camber drive on the embedded sample: its files, and what it refuses.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <csignal>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <vector>

#include "camber/core/random.h"
#include "cli/run_program.h"
#include "support/test_data.h"

namespace camber {
namespace {

using nlohmann::json;
using test::run_camber;
using ::testing::HasSubstr;
namespace fs = std::filesystem;

std::size_t lines_of(const fs::path& path) {
  std::istringstream in(test::read_text(path));
  std::size_t out = 0;
  for (std::string line; std::getline(in, line);) ++out;
  return out;
}

class Drive : public ::testing::Test {
 protected:
  std::string out() const { return (folder_.path() / "drive").string(); }
  json read(const std::string& name) const {
    return json::parse(test::read_text(fs::path(out()) / name));
  }
  const std::string scene_ = (test::source_dir() / "samples" / "steep_hill").string();
  test::TemporaryFolder folder_;
};

TEST_F(Drive, WritesItsFiles) {
  const test::ProgramResult result = run_camber({"drive", scene_, "--out", out()});
  ASSERT_EQ(result.exit_code, 0) << result.error;
  EXPECT_THAT(result.out, HasSubstr("3 frames"));
  const json drive = read("drive.json");
  EXPECT_TRUE(drive.at("metric"));
  ASSERT_EQ(drive.at("frames").size(), 3U);
  EXPECT_EQ(drive.at("frames")[0].at("covariance").size(), 36U);
  EXPECT_GT(drive.at("length_sigma").get<double>(), 0.0);
  EXPECT_EQ(lines_of(fs::path(out()) / "trajectory.tum"), 3U);
  EXPECT_EQ(lines_of(fs::path(out()) / "poses.txt"), 3U);
  EXPECT_EQ(read("vehicles.json").at("frames").size(), 3U);
  EXPECT_GT(read("tracks.json").at("tracks").size(), 2U);
  const json index = read("strip/index.json");
  ASSERT_EQ(index.at("stretches").size(), 1U);
  EXPECT_TRUE(read("run.json").at("complete"));
  for (const char* gone : {"windows.log", "film.pieces"}) {
    EXPECT_FALSE(fs::exists(fs::path(out()) / gone)) << gone;
  }
  for (const char* file : {"film.mp4", "report.html", "plots/map.png", "plots/profile.png",
                           "surface/surface.json", "surface/road.ply", "surface/run.json"}) {
    EXPECT_TRUE(fs::exists(fs::path(out()) / file)) << file;
  }
  const std::string strip = (fs::path(out()) / "strip" / "000000.ply").string();
  const test::ProgramResult info = run_camber({"info", strip, "--json"});
  EXPECT_EQ(info.exit_code, 0) << info.error;
  EXPECT_THAT(info.out, HasSubstr("lateral"));
  // Again, over its own result.
  EXPECT_EQ(
      run_camber({"drive", scene_, "--frames", "0,1", "--no-pictures", "--out", out()}).exit_code,
      0);
  EXPECT_EQ(read("drive.json").at("frames").size(), 2U);
  EXPECT_FALSE(fs::exists(fs::path(out()) / "film.mp4"));
  EXPECT_FALSE(fs::exists(fs::path(out()) / "report.html"));
  // A complete result of the same inputs stays as it is; of others it is named.
  const auto before = test::snapshot(out());
  const test::ProgramResult again =
      run_camber({"drive", scene_, "--frames", "0,1", "--no-pictures", "--out", out(), "--resume"});
  EXPECT_EQ(again.exit_code, 0) << again.error;
  EXPECT_THAT(again.out, HasSubstr("it was there"));
  EXPECT_EQ(test::snapshot(out()), before);
  const test::ProgramResult other =
      run_camber({"drive", scene_, "--no-pictures", "--out", out(), "--resume"});
  EXPECT_ONE_SENTENCE(other, 2, "another frames");
}

TEST_F(Drive, ItsRoadIsTakenByWhatTakesARoad) {
  ASSERT_EQ(run_camber({"drive", scene_, "--no-pictures", "--out", out()}).exit_code, 0);
  const auto to = [&](const char* name) { return (folder_.path() / name).string(); };
  // Three frames drive over less road than lies under the camera: a line goes on ahead.
  std::ofstream line(to("line.csv"));
  line << "x,y,z\n0,1.65,5\n0,1.65,20\n";
  line.close();
  const std::vector<std::vector<std::string>> commands = {
      {"profile", out(), "--along", to("line.csv"), "--out", to("profile.csv")},
      {"render", out(), "--view", "bev", "--out", to("bev.png")},
      {"render", out(), "--view", "overlay", "--frame", "1", "--show", "grade", "--out",
       to("overlay.png")},
      {"export", out(), "--along", to("line.csv"), "--to", "opencrg", "--out", to("road.crg")},
      {"export", out(), "--along", to("line.csv"), "--to", "opendrive", "--out", to("road.xodr")},
      {"export", out(), "--along", to("line.csv"), "--to", "mesh", "--out", to("road.glb")},
      {"export", out(), "--to", "trajectory", "--out", to("cameras.tum")},
      {"compare", out(), scene_, "--json"},
      {"info", out()}};
  for (const auto& command : commands) {
    const test::ProgramResult result = run_camber(command);
    EXPECT_EQ(result.exit_code, 0) << command[0] << " " << command[2] << ": " << result.error;
    if (command[0] != "compare") continue;
    // Against the scene's true road.
    const json compared = json::parse(result.out);
    EXPECT_LT(compared.at("accuracy").at("median").get<double>(), 0.2);  // m; 0.10 measured
  }
  // The poses are the drive's, and the profile has bands.
  EXPECT_EQ(lines_of(to("cameras.tum")), 4U);  // with the line of names
  EXPECT_THAT(test::read_text(to("profile.csv")), HasSubstr(",ok,"));
}

TEST_F(Drive, ABatchHasOneSummary) {
  const fs::path copy = folder_.path() / "still";
  fs::copy(scene_, copy, fs::copy_options::recursive);
  // A camera that does not move gives no answer, and the others go on.
  json manifest = json::parse(test::read_text(copy / "scene.json"));
  const json first = manifest.at("frames")[0].at("image");
  for (json& frame : manifest.at("frames")) frame["image"] = first;
  std::ofstream(copy / "scene.json") << manifest.dump();
  std::ofstream(folder_.path() / "list.txt") << "# two drives\n\n" << copy.string() << "\n";
  const std::vector<std::string> command = {
      "drive",         scene_,  "--list", (folder_.path() / "list.txt").string(), "--frames", "0,1",
      "--no-pictures", "--out", out()};
  const test::ProgramResult result = run_camber(command);
  EXPECT_EQ(result.exit_code, 1) << result.error;
  EXPECT_THAT(result.out, HasSubstr("steep_hill"));
  EXPECT_THAT(result.out, HasSubstr("the camera does not move"));
  const std::string summary = test::read_text(fs::path(out()) / "summary.csv");
  EXPECT_THAT(summary, HasSubstr("\nsteep_hill," + scene_ + ",0,2,"));
  EXPECT_THAT(summary, HasSubstr("\nstill," + copy.string() + ",1,"));
  EXPECT_EQ(read("run.json").at("drives").size(), 2U);
  EXPECT_TRUE(fs::exists(fs::path(out()) / "steep_hill" / "drive.json"));
  // Again: what is complete stays.
  std::vector<std::string> again = command;
  again.emplace_back("--resume");
  EXPECT_THAT(run_camber(again).out, HasSubstr("was there"));
  EXPECT_ONE_SENTENCE(run_camber({"drive", scene_, scene_, "--out", out()}), 2, "both called");
  EXPECT_ONE_SENTENCE(run_camber({"drive", "--out", out()}), 2, "found no scene");
}

/// The files of a result without what may differ between runs of the same inputs.
std::map<std::string, std::string> comparable(const fs::path& folder) {
  std::map<std::string, std::string> out = test::snapshot(folder);
  for (auto& [name, content] : out) {
    if (name == "run.json") {
      json run = json::parse(content);
      for (const char* key : {"timings_ms", "command", "resumed"}) run.erase(key);
      content = run.dump();
    }
  }
  return out;
}

TEST_F(Drive, KilledAtAnyMomentItResumesToTheSameFiles) {
  ASSERT_EQ(run_camber({"drive", scene_, "--out", out()}).exit_code, 0);
  const auto whole = comparable(out());
  double ms = 0.0;
  const json timings = read("run.json").at("timings_ms");
  for (const auto& [stage, time] : timings.items()) ms += time.get<double>();
  ASSERT_GT(ms, 100.0);
  const std::string killed = (folder_.path() / "killed").string();
  const CounterRandom random(20);
  int resumed = 0;
  for (std::uint64_t trial = 0; trial < 4; ++trial) {
    fs::remove_all(killed);
    // Killed up to three times on its way.
    for (std::uint64_t kill = 0; kill < 3; ++kill) {
      test::Surroundings surroundings;
      surroundings.signal = SIGKILL;
      surroundings.signal_after_ms = random.uniform(3 * trial + kill, 0.02, 0.5) * ms;
      const auto result =
          test::run_camber_in(surroundings, {"drive", scene_, "--out", killed, "--resume"});
      if (result.exit_code == 0) break;
      EXPECT_EQ(result.exit_code, 128 + SIGKILL) << result.error;
      ++resumed;
    }
    const auto result = run_camber({"drive", scene_, "--out", killed, "--resume"});
    ASSERT_EQ(result.exit_code, 0) << result.error;
    const auto files = comparable(killed);
    ASSERT_EQ(files.size(), whole.size());
    for (const auto& [name, content] : whole) {
      ASSERT_EQ(files.count(name), 1U) << name;
      EXPECT_TRUE(files.at(name) == content) << name << " differs, trial " << trial;
    }
  }
  EXPECT_GT(resumed, 2);
}

TEST_F(Drive, LeavesAForeignFolderAlone) {
  fs::create_directories(out());
  std::ofstream(fs::path(out()) / "mine.txt") << "keep";
  const test::ProgramResult result = run_camber({"drive", scene_, "--out", out()});
  EXPECT_EQ(result.exit_code, 3);
  EXPECT_THAT(result.error, HasSubstr("--overwrite"));
  EXPECT_EQ(test::read_text(fs::path(out()) / "mine.txt"), "keep");
}

TEST_F(Drive, AnInterruptedOneKeepsItsPartAndResumes) {
  const test::ProgramResult stopped =
      run_camber({"drive", scene_, "--out", out(), "--threads", "1"}, 700);
  if (stopped.exit_code == 0) GTEST_SKIP() << "done before it was stopped";
  EXPECT_EQ(stopped.exit_code, 130);
  EXPECT_LT(stopped.seconds_after_signal, 1.5);  // a second, and what a busy machine adds
  EXPECT_FALSE(read("run.json").at("complete"));
  EXPECT_TRUE(fs::exists(fs::path(out()) / "windows.log"));
  const test::ProgramResult other =
      run_camber({"drive", scene_, "--out", out(), "--resume", "--seed", "5"});
  EXPECT_EQ(other.exit_code, 2);
  EXPECT_THAT(other.error, HasSubstr("another seed"));
  const test::ProgramResult result = run_camber({"drive", scene_, "--out", out(), "--resume"});
  EXPECT_EQ(result.exit_code, 0) << result.error;
  EXPECT_TRUE(read("run.json").at("complete"));
}

}  // namespace
}  // namespace camber
