// camber render on sound and broken input.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "camber/image/image_io.h"
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
  const std::filesystem::path& folder_path() const { return folder_.path(); }
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
  EXPECT_EQ(free.error, "");
}

TEST_F(Render, FreeViewsAreInTheInputsCoordinates) {
  // The same cloud far from the origin, and in feet: the same picture but for its axes' titles.
  const auto cloud = [&](const std::string& name, double east, double north, double unit) {
    std::string points = "x y z\n";
    for (int i = 0; i < 400; ++i) {
      points += std::to_string((east + 0.3 * (i % 20)) / unit) + " " +
                std::to_string((north + 0.5 * (i / 20)) / unit) + " " +
                std::to_string(0.01 * (i / 20) / unit) + "\n";
    }
    write_bytes(path(name), points);
  };
  cloud("near.xyz", 0.0, 0.0, 1.0);
  cloud("map.xyz", 2000000.0, 500000.0, 1.0);
  cloud("feet.xyz", 2000000.0, 500000.0, 0.3048);
  const auto picture = [&](const std::string& name, const std::string& camera,
                           const std::vector<std::string>& more = {}) {
    std::vector<std::string> arguments = {
        "render",   path(name), "--out",  path("f.png"), "--camera=" + camera + ",0,0,1,40",
        "--size",   "160x120",  "--hide", "grid",        "--title",
        "the cloud"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    const auto result = run_camber(arguments);
    EXPECT_EQ(result.exit_code, 0) << result.error;
    EXPECT_THAT(result.error, ::testing::Not(::testing::HasSubstr("none of the points")));
    return read_color_image(path("f.png")).data;
  };
  const auto expected = picture("near.xyz", "3,-15,8,3,5,0");
  const auto differing = [&](const std::vector<std::uint8_t>& found) {
    if (found.size() != expected.size()) return found.size();
    std::size_t count = 0;
    for (std::size_t i = 0; i < found.size(); ++i) count += found[i] != expected[i];
    return count;
  };
  // Rounding moves few points over the edge of a pixel: 1 % of 57600 bytes.
  EXPECT_LT(differing(picture("map.xyz", "2000003,499985,8,2000003,500005,0")), 576u);
  EXPECT_LT(differing(picture("feet.xyz",
                              "6561689.632545932,1640370.734908136,26.246719160104987,"
                              "6561689.632545932,1640436.351706037,0",
                              {"--crs", "EPSG:2222"})),
            576u);
  const auto blank = run_camber({"render", path("map.xyz"), "--out", path("f.png"),
                                 "--camera=3,-15,8,3,5,0,0,0,1,40", "--size", "160x120"});
  EXPECT_EQ(blank.exit_code, 0);
  EXPECT_THAT(blank.error, ::testing::HasSubstr("holds none of the points"));
}

TEST_F(Render, WarnsOfLengthsUpToScale) {
  write_bytes(
      path("up.ply"),
      "ply\nformat ascii 1.0\ncomment camber metric false\nelement vertex 3\nproperty float "
      "x\nproperty float y\nproperty float z\nend_header\n0 0 0\n1 0 0\n0 1 0\n");
  const auto drawn =
      run_camber({"render", path("up.ply"), "--out", path("u.png"), "--size", "160x120"});
  EXPECT_EQ(drawn.exit_code, 0);
  EXPECT_THAT(drawn.error, ::testing::HasSubstr("up to scale"));
}

TEST_F(Render, WritesGltfAndReport) {
  for (const char* name : {"scene.glb", "report.html"}) {
    const auto result = run_camber({"render", path("cloud.xyz"), "--out", path(name)});
    EXPECT_EQ(result.exit_code, 0) << result.error;
    EXPECT_EQ(result.out, path(name) + "\n");
    EXPECT_GT(std::filesystem::file_size(path(name)), 4000u);
  }
}

TEST_F(Render, DenseTruthErrorsAndATransparentGround) {
  const std::string out = path("error.png");
  const auto run = run_camber({"render", path("cloud.xyz"), "--truth", path("cloud.xyz"), "--color",
                               "error", "--out", out, "--size", "320x240", "--transparent",
                               "--show", "normals,links", "--hide", "grid", "--json"});
  ASSERT_EQ(run.exit_code, 0) << run.error;
  EXPECT_EQ(read_image_info(out).channels, 4);
  // What is hidden is missing.
  const auto plain = run_camber({"render", path("cloud.xyz"), "--out", path("a.png"), "--size",
                                 "320x240", "--view", "oblique"});
  const auto without = run_camber({"render", path("cloud.xyz"), "--out", path("b.png"), "--size",
                                   "320x240", "--view", "oblique", "--hide", "points"});
  ASSERT_EQ(plain.exit_code + without.exit_code, 0) << plain.error << without.error;
  const auto inked = [](const Image& image) {
    return std::count_if(image.data.begin(), image.data.end(), [](auto v) { return v < 200; });
  };
  EXPECT_LT(inked(read_color_image(path("b.png"))), inked(read_color_image(path("a.png"))) / 2);
}

TEST_F(Render, SameFileForAnyNumberOfThreads) {
  const auto bytes = [&](const std::string& threads, const std::string& view) {
    const std::string out = path(threads + view + ".png");
    const auto run =
        run_camber({"render", path("cloud.xyz"), "--truth", path("cloud.xyz"), "--color", "error",
                    "--view", view, "--out", out, "--size", "320x240", "--threads", threads});
    EXPECT_EQ(run.exit_code, 0) << run.error;
    return snapshot(folder_path())[threads + view + ".png"];
  };
  for (const std::string view : {"both", "bev"}) {
    const std::string first = bytes("1", view);
    EXPECT_GT(first.size(), 1000u);
    EXPECT_EQ(first == bytes("3", view), true);
  }
}

TEST_F(Render, ASeriesThatCannotBeWrittenLeavesNoPartOfIt) {
  std::filesystem::create_directory(path("t_002.png"));  // the third of three
  expect_failure({"render", path("cloud.xyz"), "--out", path("t.png"), "--turntable", "3", "--size",
                  "160x120"},
                 3, "t_002.png");
}

TEST_F(Render, SaysWhatIsWrongWithScenesAndTruth) {
  const std::string scene = test::source_dir() / "samples" / "steep_hill";
  const auto render = [&](std::vector<std::string> more) {
    const std::vector<std::string> base = {"render", path("cloud.xyz"), "--out", path("x.png")};
    more.insert(more.begin(), base.begin(), base.end());
    return more;
  };
  std::filesystem::create_directory(path("folder"));
  expect_failure({"render", path("folder"), "--out", path("x.png")}, 2, "found no run.json");
  expect_failure(render({"--show", "nonsense"}), 2, "'nonsense'");
  expect_failure(render({"--hide", "points,grade"}), 2, "'grade'");
  expect_failure(render({"--view", "bev", "--show", "normals"}), 2, "'normals'");
  expect_failure(render({"--view", "overlay"}), 2, "expected --scene");
  expect_failure(render({"--truth", "scene"}), 2, "expected a --scene");
  expect_failure(render({"--truth", path("none.ply")}), 2, "none.ply");
  expect_failure(render({"--transparent", "--view", "bev"}), 2, "--transparent");
  expect_failure(render({"--color", "error"}), 1, "no dense truth to measure against");
  expect_failure(render({"--color", "error", "--truth", path("nan.xyz")}), 1, "cannot be coloured");
  expect_failure(render({"--scene", path("none")}), 2, "none");
  expect_failure(render({"--scene", scene, "--view", "overlay", "--frame", "99"}), 1,
                 "no image of frame 99");
  expect_failure(render({"--scene", scene, "--view", "overlay", "--frame", "1", "--show", "grade"}),
                 1, "no patches to draw");
  expect_failure(render({"--scene", scene, "--view", "overlay", "--upscale", "1000"}), 2,
                 "upscale");
  expect_failure({"render", path("cloud.xyz"), "--out", path("folder") + "/none/x.png"}, 3,
                 "cannot be written");
  std::filesystem::create_directory(path("taken.png"));
  expect_failure({"render", path("cloud.xyz"), "--out", path("taken.png")}, 3, "taken.png");
}

TEST_F(Render, ReadsTheSceneThatTheRunNames) {
  namespace fs = std::filesystem;
  const fs::path scene = folder_path() / "scene";
  fs::copy(test::source_dir() / "samples" / "steep_hill", scene, fs::copy_options::recursive);
  // From another folder than the one that the path is meant in.
  const std::string relative = fs::relative(scene, fs::current_path()).string();
  const auto made = run_camber({"reconstruct", relative, "--frames", "0,1", "--no-pictures",
                                "--quiet", "--out", path("result")});
  ASSERT_EQ(made.exit_code, 0) << made.error;
  const nlohmann::json run =
      nlohmann::json::parse(test::read_bytes(folder_path() / "result" / "run.json"));
  EXPECT_TRUE(fs::path(run["scene"].get<std::string>()).is_absolute()) << run["scene"];
  EXPECT_TRUE(fs::equivalent(run["scene"].get<std::string>(), scene));
  const auto overlay = [&](const std::string& out, const std::vector<std::string>& more) {
    std::vector<std::string> arguments = {"render",  path("result"), "--view",
                                          "overlay", "--out",        path(out)};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return arguments;
  };
  const auto named = run_camber(overlay("named.png", {"--scene", scene.string()}));
  ASSERT_EQ(named.exit_code, 0) << named.error;
  const auto by_run = run_camber(overlay("by_run.png", {}));
  ASSERT_EQ(by_run.exit_code, 0) << by_run.error;
  EXPECT_EQ(by_run.error, "");
  auto files = snapshot(folder_path());
  EXPECT_TRUE(files["named.png"] == files["by_run.png"]);

  // No longer there: what needs it fails with one sentence, the rest is drawn with a warning.
  fs::rename(scene, folder_path() / "moved");
  expect_failure(overlay("x.png", {}), 2, "no longer at " + run["scene"].get<std::string>());
  expect_failure({"render", path("result"), "--view", "driver", "--out", path("x.png")}, 2,
                 "no longer at");
  const auto without = run_camber(
      {"render", path("result"), "--view", "bev", "--size", "320x240", "--out", path("bev.png")});
  EXPECT_EQ(without.exit_code, 0) << without.error;
  EXPECT_THAT(without.error, ::testing::StartsWith("camber: warning: "));
  EXPECT_THAT(without.error, ::testing::HasSubstr("no longer at"));
  EXPECT_EQ(run_camber(overlay("again.png", {"--scene", path("moved")})).exit_code, 0);
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
