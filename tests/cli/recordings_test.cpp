// convert and import rosbag on recordings of ROS 2, export --to mcap.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "camber/cloud/cloud_io.h"
#include "cli/run_program.h"
#include "support/test_data.h"

namespace camber {
namespace {

using nlohmann::json;
using test::run_camber;
using testing::HasSubstr;
namespace fs = std::filesystem;

class Recordings : public ::testing::Test {
 protected:
  std::string path(const std::string& name) const { return folder_.path() / name; }
  static std::string bag(const std::string& name) {
    return test::data_dir() / "survey-files/rosbag2" / name;
  }
  test::TemporaryFolder folder_;
};

TEST_F(Recordings, CloudsComeOutOneByOneAndMerged) {
  CAMBER_REQUIRE_DATA("survey-files/rosbag2/made_zstd.mcap");
  for (const char* const name : {"made_zstd.mcap", "made_split", "made_message_zstd"}) {
    SCOPED_TRACE(name);
    const auto folder = run_camber({"convert", bag(name), "--topic", "/lidar/points", "--out",
                                    path(std::string(name) + "/"), "--json"});
    ASSERT_EQ(folder.exit_code, 0) << folder.error;
    const json written = json::parse(folder.out);
    EXPECT_EQ(written["messages"], 2);
    const RoadCloud first = read_cloud(path(std::string(name) + "/1700000000_000000000.ply"));
    EXPECT_EQ(first.size(), 60u);
    EXPECT_EQ(first.scalars.count("intensity"), 1u);
    EXPECT_EQ(first.labels.count("ring"), 1u);
    const std::string out = path(std::string(name) + ".ply");
    const auto one = run_camber({"convert", bag(name), "--message", "1", "--out", out});
    EXPECT_EQ(one.exit_code, 0) << one.error;
    EXPECT_EQ(read_cloud(out).size(), 60u);
    // The second, 0.3 s later at 13 m/s, in the frame of the odometry.
    const auto merged = run_camber({"convert", bag(name), "--merge", "--out", out});
    EXPECT_EQ(merged.exit_code, 0) << merged.error;
    EXPECT_THAT(merged.error, HasSubstr("frame 'odom'"));
    EXPECT_EQ(read_cloud(out).size(), 120u);
  }
}

TEST_F(Recordings, WrongUseIsOneSentence) {
  CAMBER_REQUIRE_DATA("survey-files/rosbag2/made_zstd.mcap");
  const std::string file = bag("made_zstd.mcap");
  EXPECT_ONE_SENTENCE(run_camber({"convert", file, "--out", path("a.ply")}), 2,
                      "found a file for 2 clouds");
  EXPECT_ONE_SENTENCE(run_camber({"convert", file, "--topic", "/odom", "--out", path("a.ply")}), 2,
                      "found no topic /odom with point clouds");
  EXPECT_ONE_SENTENCE(run_camber({"convert", file, "--message", "7", "--out", path("a.ply")}), 2,
                      "expected a message 7");
  EXPECT_ONE_SENTENCE(run_camber({"convert", bag("made_bad_chunk.mcap"), "--out", path("a.ply")}),
                      2, "chunk ");
  EXPECT_ONE_SENTENCE(run_camber({"convert", bag("talker"), "--out", path("a.ply")}), 2,
                      "found no point clouds");
}

TEST_F(Recordings, ImportTakesWhatTheyHave) {
  CAMBER_REQUIRE_DATA("survey-files/rosbag2/made_split");
  for (const char* const name : {"made_split", "made_lz4.mcap", "made_2019/made_2019_0.db3"}) {
    SCOPED_TRACE(name);
    const auto run =
        run_camber({"import", "rosbag", bag(name), "--topic", "/camera/front/image_raw/compressed",
                    "--height", "1.4", "--out", path("scene")});
    ASSERT_EQ(run.exit_code, 0) << run.error;
    const json scene = json::parse(test::read_text(path("scene/scene.json")));
    EXPECT_GE(scene["frames"].size(), 2u);
    EXPECT_NEAR(scene["frames"][0]["time_s"].get<double>(), 1.7e9, 1.0);
    EXPECT_TRUE(scene["frames"][0].contains("speed"));
  }
  EXPECT_FALSE(fs::exists(bag("made_2019/made_2019_0.db3-wal")));
}

TEST_F(Recordings, ResultsAreExportedForFoxglove) {
  const std::string scene = test::source_dir() / "samples/steep_hill/scene.json";
  const auto result = run_camber({"reconstruct", scene, "--no-pictures", "--out", path("result")});
  ASSERT_EQ(result.exit_code, 0) << result.error;
  const auto run =
      run_camber({"export", path("result"), "--to", "mcap", "--out", path("a.mcap"), "--json"});
  ASSERT_EQ(run.exit_code, 0) << run.error;
  const json written = json::parse(run.out);
  const json& counts = written["messages"];
  const std::size_t frames = written["frames"];
  EXPECT_EQ(counts["/camera/image"], frames);
  EXPECT_EQ(counts["/camera/calibration"], frames);
  EXPECT_EQ(counts["/vehicles"], frames);
  EXPECT_EQ(counts["/road/points"], 1);
  EXPECT_EQ(counts["/road/patches"], 1);
  EXPECT_EQ(test::read_text(path("a.mcap")).substr(1, 4), "MCAP");
}

}  // namespace
}  // namespace camber
