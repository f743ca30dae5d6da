// camber render on sound and broken input.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "camber/scene/image_io.h"
#include "cli/run_program.h"
#include "scene/write_image.h"
#include "support/test_data.h"

namespace camber {
namespace {

using test::run_camber;
using test::snapshot;
using test::write_bytes;

class Render : public ::testing::Test {
 protected:
  Render() {
    std::string points = "x y z\n";
    for (int i = 0; i < 400; ++i) {
      points += std::to_string(0.3 * (i % 20)) + " " + std::to_string(0.5 * (i / 20)) + " " +
                std::to_string(0.01 * (i / 20)) + "\n";
    }
    write_bytes(path("cloud.xyz"), points);
    write_bytes(path("nan.xyz"), "x y z\nnan nan nan\nnan nan nan\n");
    write_bytes(path("empty.ply"),
                "ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nproperty float y\n"
                "property float z\nend_header\n");
  }
  std::string path(const std::string& name) const { return folder_.path() / name; }
  void expect_failure(const std::vector<std::string>& arguments, int code,
                      const std::string& part) {
    const auto before = snapshot(folder_.path());
    EXPECT_ONE_SENTENCE(run_camber(arguments), code, part);
    EXPECT_EQ(snapshot(folder_.path()), before);
  }

 private:
  test::TemporaryFolder folder_;
};

TEST_F(Render, WritesEveryView) {
  for (const char* view : {"both", "oblique", "side", "bev"}) {
    const std::string out = path(std::string(view) + ".png");
    const auto result = run_camber(
        {"render", path("cloud.xyz"), "--out", out, "--view", view, "--size", "320x240"});
    EXPECT_EQ(result.exit_code, 0) << result.error;
    EXPECT_EQ(result.out, out + "\n");
    const Image image = read_color_image(out);
    EXPECT_EQ(image.width, 320);
    EXPECT_EQ(image.height, 240);
  }
}

TEST_F(Render, TurntableAndFreeViewAndJson) {
  const auto series = run_camber({"render", path("cloud.xyz"), "--out", path("t.png"),
                                  "--turntable", "3", "--size", "160x120", "--json"});
  ASSERT_EQ(series.exit_code, 0) << series.error;
  const nlohmann::json said = nlohmann::json::parse(series.out);
  EXPECT_EQ(said["files"].size(), 3u);
  EXPECT_TRUE(said["timings_ms"].contains("compute"));
  EXPECT_FALSE(said["gl_renderer"].get<std::string>().empty());
  EXPECT_NE(read_color_image(path("t_000.png")).data, read_color_image(path("t_001.png")).data);
  const auto free = run_camber({"render", path("cloud.xyz"), "--out", path("f.png"),
                                "--camera=3,-15,8,3,5,0,0,0,1,40", "--size", "160x120"});
  EXPECT_EQ(free.exit_code, 0) << free.error;
}

TEST_F(Render, WritesGltfAndReport) {
  for (const char* name : {"scene.glb", "report.html"}) {
    const auto result = run_camber({"render", path("cloud.xyz"), "--out", path(name)});
    EXPECT_EQ(result.exit_code, 0) << result.error;
    EXPECT_EQ(result.out, path(name) + "\n");
    EXPECT_GT(std::filesystem::file_size(path(name)), 4000u);
  }
}

TEST_F(Render, SaysWhatIsWrongAndLeavesNothing) {
  expect_failure({"render", path("none.ply"), "--out", path("x.png")}, 2, "no such file");
  expect_failure({"render", path("nan.xyz"), "--out", path("x.png")}, 1,
                 "none of the 2 points has finite coordinates");
  expect_failure({"render", path("empty.ply"), "--out", path("x.png")}, 1, "nothing to draw");
  expect_failure({"render", path("cloud.xyz"), "--out", path("none/x.png")}, 3,
                 "cannot be written");
  expect_failure({"render", path("cloud.xyz"), "--out", path("x.png"), "--size", "0x0"}, 2,
                 "found 0, expected 64 to 8192");
  expect_failure({"render", path("cloud.xyz"), "--out", path("x.png"), "--size", "big"}, 2,
                 "expected WIDTHxHEIGHT");
  expect_failure({"render", path("cloud.xyz"), "--out", path("x.jpg")}, 2, ".png");
  expect_failure({"render", path("cloud.xyz"), "--out", path("x.png"), "--color", "sigma"}, 1,
                 "no standard deviations");
  expect_failure({"render", path("cloud.xyz"), "--out", path("x.png"), "--view", "driver"}, 1,
                 "driver's view needs the camera");
  expect_failure(
      {"render", path("cloud.xyz"), "--out", path("x.png"), "--camera=1,1,1,1,1,1,0,0,1,40"}, 2,
      "eye, target and up on one line");
}

}  // namespace
}  // namespace camber
