// camber drive on the embedded sample: its files, and what it refuses.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

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
  EXPECT_FALSE(fs::exists(fs::path(out()) / "windows.log"));
  const std::string strip = (fs::path(out()) / "strip" / "000000.ply").string();
  const test::ProgramResult info = run_camber({"info", strip, "--json"});
  EXPECT_EQ(info.exit_code, 0) << info.error;
  EXPECT_THAT(info.out, HasSubstr("lateral"));
  // Again, over its own result.
  EXPECT_EQ(run_camber({"drive", scene_, "--frames", "0,1", "--out", out()}).exit_code, 0);
  EXPECT_EQ(read("drive.json").at("frames").size(), 2U);
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
