// camber render: several frames to files, a contact sheet or a film; the timings of a run.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "camber/image/image_io.h"
#include "cli/run_program.h"
#include "scene/write_image.h"
#include "support/test_data.h"

namespace camber {
namespace {

namespace fs = std::filesystem;
using test::run_camber;
using test::snapshot;

TEST(RenderSeries, FramesToFilesSheetsAndFilms) {
  const test::TemporaryFolder folder;
  const auto path = [&](const std::string& name) { return (folder.path() / name).string(); };
  const std::string scene = test::source_dir() / "samples" / "steep_hill";
  ASSERT_EQ(run_camber({"reconstruct", scene, "--no-pictures", "--quiet", "--out", path("result")})
                .exit_code,
            0);
  const auto render = [&](std::vector<std::string> more) {
    const std::vector<std::string> base = {"render", path("result"), "--scene", scene};
    more.insert(more.begin(), base.begin(), base.end());
    return run_camber(more);
  };

  auto run = render({"--view", "overlay", "--frames", "0,2", "--out", path("f.png"), "--json"});
  ASSERT_EQ(run.exit_code, 0) << run.error;
  const auto said = nlohmann::json::parse(run.out);
  ASSERT_EQ(said["files"].size(), 2u);
  EXPECT_EQ(said["files"][1], path("f_002.png"));
  const Image first = read_color_image(path("f_000.png"));
  EXPECT_NE(first.data, read_color_image(path("f_002.png")).data);

  run = render({"--view", "overlay", "--frames", "all", "--sheet", "--sheet-columns", "2", "--out",
                path("sheet.png")});
  ASSERT_EQ(run.exit_code, 0) << run.error;
  const Image sheet = read_color_image(path("sheet.png"));
  EXPECT_GT(sheet.width, first.width);
  EXPECT_LE(sheet.width, 2400);

  for (const char* name : {"film.avi", "film.mp4"}) {
    run = render({"--view", "overlay", "--frames", "all", "--out", path(name)});
    ASSERT_EQ(run.exit_code, 0) << run.error;
    EXPECT_EQ(run.out, path(name) + "\n");
    EXPECT_GT(fs::file_size(path(name)), 20000u);
  }
  run = render({"--view", "oblique", "--turntable", "3", "--size", "320x200", "--rate", "5",
                "--out", path("around.avi")});
  ASSERT_EQ(run.exit_code, 0) << run.error;

  run = render({"--view", "timings", "--size", "800x500", "--out", path("timings.png")});
  ASSERT_EQ(run.exit_code, 0) << run.error;
  EXPECT_EQ(read_color_image(path("timings.png")).width, 800);

  run = render({"--beside", path("result"), "--frame", "0", "--vehicle", "2", "--size", "900x600",
                "--out", path("beside.png")});
  ASSERT_EQ(run.exit_code, 0) << run.error;
  EXPECT_EQ(read_color_image(path("beside.png")).width, 900);
  // The vehicles alone, as camber vehicles writes them, are enough of a result.
  run = render({"--beside", path("result/vehicles.json"), "--frame", "0", "--vehicle", "2",
                "--size", "900x600", "--out", path("beside_file.png")});
  ASSERT_EQ(run.exit_code, 0) << run.error;
  EXPECT_EQ(test::read_bytes(path("beside_file.png")), test::read_bytes(path("beside.png")));

  // The same result of a scene from memory: it names no scene.
  fs::copy(path("result"), path("unnamed"), fs::copy_options::recursive);
  nlohmann::json document = nlohmann::json::parse(test::read_bytes(path("unnamed/run.json")));
  document["scene"] = "";
  test::write_bytes(path("unnamed/run.json"), document.dump());

  const auto before = snapshot(folder.path());
  const std::vector<std::pair<std::vector<std::string>, const char*>> misuses = {
      {{"--frames", "all", "--out", path("x.gif")}, ".mp4 or .avi"},
      {{"--frames", "all", "--out", path("x.glb")}, "--out must end in .png, .mp4 or .avi"},
      {{"--out", path("x.mp4")}, "a film needs several pictures"},
      {{"--sheet", "--out", path("x.png")}, "--sheet needs several pictures"},
      {{"--frames", "0", "--rate", "5", "--out", path("x.png")}, "--rate goes with a film"},
      {{"--frames", "0", "--sheet-columns", "2", "--out", path("x.png")}, "goes with --sheet"},
      {{"--frames", "7", "--out", path("x.mp4")}, "frame 7"},
      {{"--frames", "0", "--frame", "1", "--out", path("x.png")}, "exclude each other"},
      {{"--frames", "0", "--turntable", "2", "--out", path("x.png")}, "exclude each other"},
      {{"--frames", "0", "--sheet", "--out", path("x.mp4")}, "must end in .png"},
      {{"--beside", path("result"), "--out", path("x.glb")}, "--beside makes one picture"},
      {{"--vehicle", "2", "--out", path("x.png")}, "--vehicle names the one"},
      {{"--view", "timings", "--frames", "0", "--out", path("x.png")}, "timings is one picture"}};
  for (const auto& [arguments, part] : misuses) EXPECT_ONE_SENTENCE(render(arguments), 2, part);
  for (const char* name : {"none/x.mp4", "none/x.png"}) {
    EXPECT_ONE_SENTENCE(render({"--view", "overlay", "--frames", "0", "--out", path(name)}), 3,
                        "none/x");
  }
  // A picture that fails in the middle leaves no part of a film.
  EXPECT_ONE_SENTENCE(run_camber({"render", path("unnamed"), "--view", "driver", "--frames", "0",
                                  "--out", path("x.avi")}),
                      1, "driver");
  EXPECT_ONE_SENTENCE(
      run_camber({"render", path("result/road.ply"), "--view", "timings", "--out", path("x.png")}),
      1, "no result folder");
  // As a full disk does: the encoder gives no reason.
  test::Surroundings small;
  small.shell = "ulimit -f 8";
  for (const char* name : {"x.avi", "x.mp4"}) {
    EXPECT_ONE_SENTENCE(
        test::run_camber_in(small, {"render", path("result"), "--scene", scene, "--view", "overlay",
                                    "--frames", "all", "--out", path(name)}),
        3, std::string(name) + ": writing failed: File too large");
  }
  EXPECT_EQ(snapshot(folder.path()), before);
}

}  // namespace
}  // namespace camber
