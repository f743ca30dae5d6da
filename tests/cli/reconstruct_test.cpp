// camber reconstruct, triangulate and info on sound and broken scenes.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <nlohmann/json.hpp>

#include "cli/run_program.h"
#include "scene/write_image.h"
#include "support/drawn_road.h"
#include "support/test_data.h"

namespace camber {
namespace {

using nlohmann::json;
using test::picture;
using test::read_bytes;
using test::run_camber;
using test::snapshot;
using test::write_bytes;
using test::write_png;
using ::testing::HasSubstr;
namespace fs = std::filesystem;

/// A scene of three small pictures whose manifest each test breaks in its own way. The run comes to
/// its inputs before anything else, so the pictures need not show a road.
class BrokenScene : public ::testing::Test {
 protected:
  BrokenScene() {
    json frames = json::array();
    for (const int id : {0, 1, 2}) {
      const std::string name = std::to_string(id) + ".png";
      write_png(path(name), 320, 240, 2, 8, picture(320, 240, 3));
      frames.push_back({{"id", id}, {"image", name}});
    }
    manifest_ = {{"format", "camber-scene"},
                 {"version", 1},
                 {"camera",
                  {{"width", 320},
                   {"height", 240},
                   {"fx", 200},
                   {"fy", 200},
                   {"cx", 160},
                   {"cy", 120},
                   {"height_above_road", 1.65}}},
                 {"frames", frames}};
    put(manifest_.dump());
    // Earlier results, which no failure may touch.
    fs::create_directory(path("result"));
    write_bytes(path("result/run.json"), "{}");
    write_bytes(path("result/road.ply"), "old");
    write_bytes(path("cloud.ply"), "old");
  }
  std::string path(const std::string& name) const { return folder_.path() / name; }
  void put(const std::string& text) { write_bytes(path("scene.json"), text); }

  /// Both commands that read images fail with the same sentence and leave everything as it was.
  void expect_failure(int exit_code, const std::string& part,
                      const std::vector<std::string>& more = {}) {
    const auto before = snapshot(folder_.path());
    for (const auto& [command, out] :
         {std::pair{"reconstruct", "result"}, std::pair{"triangulate", "cloud.ply"}}) {
      SCOPED_TRACE(command);
      std::vector<std::string> arguments = {command, path("scene.json"), "--out", path(out)};
      arguments.insert(arguments.end(), more.begin(), more.end());
      EXPECT_ONE_SENTENCE(run_camber(arguments), exit_code, part);
      EXPECT_EQ(snapshot(folder_.path()), before);
    }
  }

  json manifest_;
  test::TemporaryFolder folder_;
};

TEST_F(BrokenScene, ManifestsThatAreNoManifests) {
  fs::remove(path("scene.json"));
  expect_failure(2, "scene.json: no such file");
  put("");
  expect_failure(2, "scene.json: line 1, column 1 (byte 1): found the end of the file");
  put("{\"format\": \"camber-scene\",\n \"version\": 1,}");
  expect_failure(2, "scene.json: line 2, column 15");
  put(std::string(300000, '['));
  expect_failure(2, "nested deeper than 64 levels");
  put(std::string("\x00\x01\x02\xff", 4));
  expect_failure(2, "scene.json: line 1, column 1");
}

TEST_F(BrokenScene, ConfinedScenesNameNothingOutsideTheirFolder) {
  const test::TemporaryFolder elsewhere;
  write_bytes(elsewhere.path() / "secret.png", "not to be read");
  const auto with_image = [&](const std::string& name) {
    json changed = manifest_;
    changed["frames"][1]["image"] = name;
    put(changed.dump());
  };
  const std::string refusal = "frames[1].image: found \"";
  const std::string expected = "expected a path that stays in the manifest's folder (--confine)";
  with_image((elsewhere.path() / "secret.png").string());
  expect_failure(2, expected, {"--confine"});
  expect_failure(2, "secret.png");  // without: opened, and no image
  with_image("../" + elsewhere.path().filename().string() + "/secret.png");
  expect_failure(2, refusal + "..", {"--confine"});
  fs::create_symlink(elsewhere.path() / "secret.png", path("inside.png"));
  for (const char* name : {"inside.png", "inside.png#3"}) {
    with_image(name);
    expect_failure(2, refusal + name, {"--confine"});
  }
  fs::create_directory_symlink(elsewhere.path(), path("folder"));
  with_image("folder/new.png");
  expect_failure(2, expected, {"--confine"});
}

TEST_F(BrokenScene, ManifestsWithAWrongValue) {
  const auto with = [&](const char* pointer, const json& value) {
    json changed = manifest_;
    changed[json::json_pointer(pointer)] = value;
    put(changed.dump());
  };
  with("/camera/fx", -200);
  expect_failure(2, "scene.json: camera.fx: found -200, expected a positive number of pixels");
  with("/camera/cy", "middle");
  expect_failure(2, "scene.json: camera.cy: found \"middle\", expected");
  with("/frames/2/id", 1);
  expect_failure(2, "scene.json: frames[2].id: found 1 a second time");
  with("/frames/1/vehicles", {{{"id", 0}, {"box", {1, 2, 3}}}});
  expect_failure(2,
                 "scene.json: frames[1].vehicles[0].box: found 3 numbers, expected 4 [x1, y1, x2, "
                 "y2]");
  with("/version", 2);
  expect_failure(2, "scene.json: version: found 2, expected 1");
  json changed = manifest_;
  changed["camera"].erase("cx");
  put(changed.dump());
  expect_failure(2, "scene.json: camera.cx: missing");
}

TEST_F(BrokenScene, IntrinsicsThatAreNotFinite) {
  std::string text = manifest_.dump();
  const auto replace = [&](const std::string& value) {
    std::string changed = text;
    changed.replace(changed.find("\"fx\":200"), 8, "\"fx\":" + value);
    put(changed);
  };
  for (const char* value : {"NaN", "Infinity", "-Infinity", "1e999"}) {
    replace(value);
    expect_failure(2, std::string("found '") + value + "', expected a finite number");
  }
  replace("null");
  expect_failure(2, "camera.fx: found null, expected a positive number of pixels");
}

TEST_F(BrokenScene, ImagesThatAreMissingOrDamaged) {
  const std::string whole = read_bytes(path("1.png"));
  fs::remove(path("1.png"));
  expect_failure(2, "1.png: no such file");
  write_bytes(path("1.png"), whole.substr(0, whole.size() / 2));
  expect_failure(2, "1.png: found a truncated PNG image");
  write_bytes(path("1.png"), whole.substr(0, whole.size() - 8));  // IEND without its end
  expect_failure(2, "1.png: found a truncated PNG image");
  std::string flipped = whole;
  flipped[whole.size() / 2] = static_cast<char>(flipped[whole.size() / 2] ^ 4);
  write_bytes(path("1.png"), flipped);
  expect_failure(2, "1.png: found a damaged PNG image");
  write_bytes(path("1.png"), "P5 3 3 255 012345678");
  expect_failure(2, "1.png: found a file that is neither PNG nor JPEG");
  test::write_jpeg(path("1.png"), 320, 240, 3, picture(320, 240, 3));
  const std::string jpeg = read_bytes(path("1.png"));
  write_bytes(path("1.png"), jpeg.substr(0, jpeg.size() / 2));
  expect_failure(2, "1.png: found a truncated JPEG image");
}

TEST_F(BrokenScene, SizesThatDisagree) {
  write_png(path("2.png"), 320, 200, 2, 8, picture(320, 200, 3));
  expect_failure(2, "2.png: found an image of 320 x 200 pixels, expected the camera's 320 x 240");
  write_png(path("2.png"), 320, 240, 2, 8, picture(320, 240, 3));
  json changed = manifest_;
  changed["segmentation_classes"] = {{"road", {1}}};
  for (json& frame : changed["frames"]) frame["segmentation"] = "labels.png";
  put(changed.dump());
  write_png(path("labels.png"), 160, 120, 0, 8, picture(160, 120, 1));
  expect_failure(2,
                 "labels.png: found an image of 160 x 120 pixels, expected the camera's 320 x 240");
  write_png(path("labels.png"), 320, 240, 2, 8, picture(320, 240, 3));
  expect_failure(2, "labels.png: found a PNG of 3 channel(s) of 8 bits");
}

TEST_F(BrokenScene, FramesThatAreNotThere) {
  expect_failure(2, "frame 7 is not in the scene", {"--frames", "0,7"});
  expect_failure(2, "found 'every'", {"--frames", "every"});
}

TEST_F(BrokenScene, MoreFramesThanARunTakesAreRefusedBeforeTheNetworksLook) {
  json changed = manifest_;
  changed["frames"] = json::array();
  for (int id = 0; id < 65; ++id) {
    // No such image: a network that looked would fail at it.
    changed["frames"].push_back(
        {{"id", id}, {"image", "no.png"}, {"vehicles", {{{"id", 0}, {"box", {10, 90, 90, 150}}}}}});
  }
  put(changed.dump());
  expect_failure(2, "65 frames, expected at most 64", {"--frames", "all"});
}

TEST_F(BrokenScene, SceneThatCannotAnswer) {
  expect_failure(1, "one frame alone", {"--frames", "1"});
  expect_failure(1, "");  // three times the same picture
  for (const char* name : {"0.png", "1.png", "2.png"}) {
    write_png(path(name), 320, 240, 0, 8, std::vector<std::uint8_t>(320 * 240, 128));
  }
  expect_failure(1, "");  // no texture at all
}

TEST_F(BrokenScene, FoldersOfOthersAreNotReplaced) {
  fs::remove(path("result/run.json"));
  const auto before = snapshot(folder_.path());
  const auto result = run_camber({"reconstruct", path("scene.json"), "--out", path("result")});
  EXPECT_NE(result.exit_code, 0);
  EXPECT_EQ(snapshot(folder_.path()), before);
}

TEST_F(BrokenScene, InfoRefusesThemToo) {
  put("{");
  EXPECT_ONE_SENTENCE(run_camber({"info", path("scene.json")}), 2,
                      "scene.json: line 1, column 2 (byte 2): found the end of the file");
  fs::remove(path("scene.json"));
  EXPECT_ONE_SENTENCE(run_camber({"info", path("scene.json")}), 2, "scene.json");
  write_bytes(path("result/run.json"), "{\"seed\": -1}");
  EXPECT_ONE_SENTENCE(run_camber({"info", path("result")}), 2,
                      "run.json: seed: found -1, expected an integer of at least 0");
}

// A slow drive, whose farther frames show nothing.
TEST(ReconstructWithoutFrames, NeighboursAnswerWhereFramesFartherApartDoNot) {
  const test::TemporaryFolder folder;
  const PinholeCamera camera{620, 220, 420.0, 420.0, 310.0, 90.0};
  test::DrawnRoad road;
  for (int i = 0; i < 6; ++i) {
    const double z = 14.0 + 7.0 * i;
    road.boards.push_back({z, -14.0, -6.0, -4.0 - 0.4 * i, 3.0, 0.0});
    road.boards.push_back({z + 3.0, 6.5, 13.0, -3.0 - 0.3 * i, 3.0, 0.0});
  }
  json frames = json::array();
  for (const int id : {0, 1, 2, 3, 4}) {
    constexpr double kStep = 0.15;  // m
    const SE3 pose(Eigen::Quaterniond::Identity(), {0.0, 0.0, kStep * (id - 2)});
    const bool dark = id == 0 || id == 4;
    const std::string name = std::to_string(id) + ".png";
    write_png(
        folder.path() / name, camera.width, camera.height, 0, 8,
        dark ? std::vector<std::uint8_t>(620 * 220, 30) : test::draw_road(road, camera, pose, id));
    frames.push_back({{"id", id}, {"image", name}});
  }
  const json manifest = {{"format", "camber-scene"},
                         {"version", 1},
                         {"camera",
                          {{"width", camera.width},
                           {"height", camera.height},
                           {"fx", camera.fx},
                           {"fy", camera.fy},
                           {"cx", camera.cx},
                           {"cy", camera.cy},
                           {"height_above_road", 1.65}}},
                         {"frames", frames}};
  write_bytes(folder.path() / "scene.json", manifest.dump());
  const std::string scene = folder.path() / "scene.json", out = folder.path() / "result";
  const std::string evidence = folder.path() / "evidence.json";
  const auto result = run_camber(
      {"reconstruct", scene, "--out", out, "--no-pictures", "--json", "--evidence", evidence});
  ASSERT_EQ(result.exit_code, 0) << result.error;
  EXPECT_THAT(result.error, HasSubstr("frames 0,1,2,3,4 give no answer"));
  const json known = json::parse(read_bytes(evidence));
  EXPECT_EQ(known["format"], "camber-evidence");
  EXPECT_EQ(known["answered"], true);
  EXPECT_EQ(known["evidence"], json::parse(result.out)["evidence"]);
  ASSERT_FALSE(known["evidence"].empty());
  EXPECT_EQ(known["evidence"][0]["name"], "camera_height");
  EXPECT_EQ(json::parse(result.out)["cameras"].size(), 3u);
  EXPECT_EQ(json::parse(result.out)["cameras"][0]["id"], 1);
  // Who asks for them gets the reason.
  const auto refused =
      run_camber({"reconstruct", scene, "--frames", "0,2,4", "--out", out, "--evidence", evidence});
  EXPECT_ONE_SENTENCE(refused, 1, "");
  const json unknown = json::parse(read_bytes(evidence));
  EXPECT_EQ(unknown["answered"], false);
  EXPECT_THAT(refused.error, HasSubstr(unknown["reason"].get<std::string>()));
}

// 16 m of a drive at once: the flow does not follow the road over 8 m to each side, and what it
// finds in its place turned the camera by half a degree.
TEST(LongDrive, FramesOutOfReachAreLeftOutAndNamed) {
  const test::TemporaryFolder folder;
  const std::string scene = folder.path() / "drive", out = folder.path() / "road";
  ASSERT_EQ(run_camber({"synth",
                        "--profile",
                        "steep_hill",
                        "--frames",
                        "17",
                        "--speed",
                        "18",
                        "--size",
                        "621x188",
                        "--intrinsics",
                        "360,360,305,86",
                        "--cars",
                        "0",
                        "--seed",
                        "3",
                        "--cloud-points",
                        "1000",
                        "--supersampling",
                        "1",
                        "--out",
                        scene})
                .exit_code,
            0);
  const auto run =
      run_camber({"reconstruct", scene, "--frames", "0:16", "--no-pictures", "--out", out});
  ASSERT_EQ(run.exit_code, 0) << run.error;
  EXPECT_THAT(run.error, HasSubstr("share too little with frame 8, the reference"));
  const json stated = json::parse(read_bytes(out + "/run.json"));
  const auto frames = stated.at("options").at("frames").get<std::vector<int>>();
  EXPECT_EQ(stated.at("cameras").size(), frames.size());
  EXPECT_THAT(stated.at("warnings").at(0).at("text").get<std::string>(),
              HasSubstr("frames 0 to " + std::to_string(frames.front() - 1) + " and " +
                        std::to_string(frames.back() + 1) + " to 16 share"));
  const json errors = json::parse(read_bytes(out + "/metrics.json"));
  EXPECT_LT(errors.at("rotation_error_deg"), 0.1);   // 0.66 with all
  EXPECT_LT(errors.at("direction_error_deg"), 0.2);  // 2.0
  EXPECT_LT(std::abs(errors.at("scale_error").get<double>()), 0.01);
}

// A dip behind a crest: the road comes into view again beyond it, and what bridges the dip was
// stated to be known to 3 cm.
TEST(RoadBehindACrest, IsNotBridged) {
  const test::TemporaryFolder folder;
  const std::string scene = folder.path() / "dip", out = folder.path() / "road";
  ASSERT_EQ(run_camber({"synth",
                        "--profile",
                        "rolling",
                        "--seed",
                        "10",
                        "--camera-height",
                        "1.1",
                        "--cars",
                        "0",
                        "--speed",
                        "7",
                        "--frames",
                        "3",
                        "--size",
                        "621x188",
                        "--intrinsics",
                        "360,360,305,86",
                        "--supersampling",
                        "2",
                        "--cloud-points",
                        "1000",
                        "--out",
                        scene})
                .exit_code,
            0);
  const auto run = run_camber({"reconstruct", scene, "--no-pictures", "--out", out});
  ASSERT_EQ(run.exit_code, 0) << run.error;
  int known = 0, edge_on = 0;
  std::vector<double> depths;
  const json surface = json::parse(read_bytes(out + "/surface.json"));
  for (const json& patch : surface.at("patches")) {
    const double depth = patch.at("centroid").at(2);
    for (const double other : depths) EXPECT_GT(std::abs(depth - other), 1.0);
    depths.push_back(depth);
    edge_on += patch.at("reason").get<std::string>().find("edge-on") != std::string::npos;
    if (patch.at("status") != "ok") continue;
    ++known;
    EXPECT_LT(depth, 18.0);  // at 20 m 0.23 m off, stated 0.034
  }
  EXPECT_GE(known, 3);
  EXPECT_GE(edge_on, 2);
}

/// The scene that ships with the program.
class SteepHill : public ::testing::Test {
 protected:
  static std::string scene() { return test::source_dir() / "samples" / "steep_hill"; }
  std::string path(const std::string& name) const { return folder_.path() / name; }
  test::TemporaryFolder folder_;
};

TEST_F(SteepHill, TwoEqualFramesHaveNoParallax) {
  fs::copy(scene(), path("scene"), fs::copy_options::recursive);
  fs::copy_file(path("scene/image/000000.png"), path("scene/image/000001.png"),
                fs::copy_options::overwrite_existing);
  for (const auto& [command, out] :
       {std::pair{"reconstruct", "result"}, std::pair{"triangulate", "cloud.ply"}}) {
    EXPECT_ONE_SENTENCE(run_camber({command, path("scene"), "--frames", "0,1", "--out", path(out)}),
                        1, "");
    EXPECT_FALSE(fs::exists(path(out)));
  }
}

TEST_F(SteepHill, AResultHasItsFilesAndReplacesAnOlderOne) {
  fs::create_directory(path("result"));
  write_bytes(path("result/run.json"), "{}");
  write_bytes(path("result/leftover.txt"), "old");
  const auto result =
      run_camber({"reconstruct", scene(), "--out", path("result"), "--no-pictures", "--json"});
  ASSERT_EQ(result.exit_code, 0) << result.error;
  const json run = json::parse(result.out);
  for (const char* key : {"version", "seed", "options", "timings_ms"}) {
    EXPECT_TRUE(run.contains(key)) << key;
  }
  for (const char* stage :
       {"load", "correspondences", "motion", "triangulation", "surface", "vehicles"}) {
    EXPECT_TRUE(run["timings_ms"].contains(stage)) << stage;
  }
  for (const char* file :
       {"road.ply", "surface.json", "vehicles.json", "run.json", "metrics.json"}) {
    EXPECT_TRUE(fs::exists(path("result") + "/" + file)) << file;
  }
  EXPECT_FALSE(fs::exists(path("result/leftover.txt")));
  EXPECT_EQ(snapshot(folder_.path()).count("result"), 1u);
  for (const auto& entry : fs::directory_iterator(folder_.path())) {
    EXPECT_EQ(entry.path().filename(), "result") << "something else was left behind";
  }
  const auto info = run_camber({"info", path("result"), "--json"});
  EXPECT_EQ(info.exit_code, 0) << info.error;
  EXPECT_EQ(json::parse(info.out)["files"][0]["kind"], "result");
  for (const std::string kind : {"run", "surface", "vehicles", "metrics"}) {
    const auto one = run_camber({"info", path("result/" + kind + ".json"), "--json"});
    ASSERT_EQ(one.exit_code, 0) << one.error;
    EXPECT_EQ(json::parse(one.out)["files"][0]["kind"], kind);
  }
}

TEST_F(SteepHill, WhatIsMissingIsNamedForWhatItIs) {
  fs::copy(scene(), path("scene"), fs::copy_options::recursive);
  json manifest = json::parse(read_bytes(path("scene/scene.json")));
  manifest["camera"].erase("height_above_road");
  manifest["gnss"] = {{"crs", "EPSG:32632"}};
  for (json& frame : manifest["frames"]) {
    frame["gnss"] = {{"position", {500000.0, 5500000.0 + frame["id"].get<double>(), 100.0}}};
    frame["vehicles"][0]["class"] = "unicorn";
  }
  write_bytes(path("scene/scene.json"), manifest.dump());
  const auto result =
      run_camber({"reconstruct", path("scene"), "--out", path("result"), "--no-pictures"});
  ASSERT_EQ(result.exit_code, 0) << result.error;
  EXPECT_THAT(result.error,
              HasSubstr("camber: warning: class \"unicorn\" of 3 detections is not known: taken as "
                        "car\n"));
  EXPECT_THAT(result.error, HasSubstr("camber: warning: no place on the map: "));
  EXPECT_THAT(result.out, HasSubstr("up to scale: units are taken for metres in what follows\n"
                                    "against the truth:"));
  const json run = json::parse(read_bytes(path("result/run.json")));
  EXPECT_EQ(run["metric"], false);
  EXPECT_THAT(run["scale_reason"].get<std::string>(),
              HasSubstr("no source of metres but lane markings: they measure the scale to"));
  EXPECT_EQ(run["scale_from"]["source"], "not given");
  EXPECT_TRUE(run["scale_from"]["sigma_camera_height"].is_null());
  EXPECT_EQ(run["warnings"][0]["code"], "unknown_class");
  for (const char* view : {"both", "bev"}) {
    EXPECT_ONE_SENTENCE(run_camber({"render", path("result"), "--frame", "9", "--view", view,
                                    "--out", path("x.png")}),
                        2, "--frame: found 9, expected one of the frames of");
  }
  EXPECT_FALSE(fs::exists(path("x.png")));
}

TEST_F(SteepHill, ThePaperIsAPresetThatTakesOneImageToo) {
  const auto result =
      run_camber({"reconstruct", scene(), "--frames", "0,1", "--preset", "paper", "--paper-terms",
                  "printed", "--paper-scale", "patch", "--keypoint-set", "14", "--out",
                  path("result"), "--no-pictures", "--json"});
  ASSERT_EQ(result.exit_code, 0) << result.error;
  const json options = json::parse(result.out)["options"];
  EXPECT_EQ(options["preset"], "paper");
  EXPECT_EQ(options["paper_terms"], "printed");
  EXPECT_EQ(options["paper_scale"], "patch");
  EXPECT_EQ(options["keypoint_set"], 14);
  for (const std::vector<std::string>& alone :
       {std::vector<std::string>{"--paper-terms", "printed"}, {"--paper-scale", "patch"}}) {
    EXPECT_ONE_SENTENCE(
        run_camber({"reconstruct", scene(), alone[0], alone[1], "--out", path("alone")}), 2,
        alone[0] + ": expected --preset paper beside it");
  }
  const auto single = run_camber(
      {"reconstruct", scene(), "--preset", "paper", "--frames", "1", "--out", path("single")});
  ASSERT_EQ(single.exit_code, 0) << single.error;
  for (const char* file : {"road.ply", "scene.png", "report.html", "metrics.json"}) {
    EXPECT_TRUE(fs::exists(path("single") + "/" + file)) << file;
  }
}

TEST_F(SteepHill, OneImageIsAnsweredByItsMarkingsOrSaysThatTheyAreMissing) {
  const auto result = run_camber(
      {"reconstruct", scene(), "--frames", "1", "--out", path("one"), "--no-pictures", "--json"});
  ASSERT_EQ(result.exit_code, 0) << result.error;
  const json run = json::parse(result.out);
  EXPECT_EQ(run["road_from"], "markings");
  ASSERT_FALSE(run["markings"]["found"].empty());
  const json& dash = run["markings"]["found"][0];
  EXPECT_EQ(dash["kind"], "dash");
  // A dash of 4 m some 14 m ahead; its own sigma is 2 m, since it is the only one.
  EXPECT_NEAR(dash["distance"].get<double>(), 13.5, 4.0);
  EXPECT_GT(dash["sigma_distance"].get<double>(), 0.0);
  EXPECT_TRUE(fs::exists(path("one") + "/road.ply"));
  EXPECT_GT(run["points"]["kept"]["road"].get<int>(), 20);

  fs::copy(scene(), path("bare"), fs::copy_options::recursive);
  json manifest = json::parse(read_bytes(path("bare/scene.json")));
  manifest.erase("markings_m");
  write_bytes(path("bare/scene.json"), manifest.dump());
  EXPECT_ONE_SENTENCE(
      run_camber({"reconstruct", path("bare"), "--frames", "1", "--out", path("none")}), 1,
      "markings_m");
  EXPECT_FALSE(fs::exists(path("none")));
}

TEST_F(SteepHill, PicturesComeWithAReportAndAScene) {
  const auto result =
      run_camber({"reconstruct", scene(), "--frames", "0,1", "--out", path("result"), "--quiet"});
  ASSERT_EQ(result.exit_code, 0) << result.error;
  for (const char* file :
       {"scene.png", "bev.png", "overlay_000000.png", "overlay_000001.png", "scene.glb"}) {
    EXPECT_TRUE(fs::exists(path("result") + "/" + file)) << file;
  }
  const std::string page = read_bytes(path("result/report.html"));
  for (const char* part : {"camber reconstruct", "Profile along the driven line", "Errors against",
                           "Vehicle by vehicle", "surface", "image/000000.png", "Frame 1",
                           "data:image/jpeg;base64,", "Ceres", "option.method"}) {
    EXPECT_THAT(page, HasSubstr(part));
  }
}

TEST_F(SteepHill, InterruptedRunsLeaveNothing) {
  // With one thread and pictures a run takes some two seconds.
  const auto result =
      run_camber({"reconstruct", scene(), "--threads", "1", "--out", path("result")}, 400);
  EXPECT_ONE_SENTENCE(result, 130, "interrupted");
  EXPECT_TRUE(fs::is_empty(folder_.path()));
}

TEST_F(SteepHill, RunsThatAreToldToEndLeaveNothing) {
  for (const int signal : {SIGTERM, SIGHUP}) {
    const auto result = run_camber(
        {"reconstruct", scene(), "--threads", "1", "--out", path("result")}, 400, signal);
    EXPECT_ONE_SENTENCE(result, 130, "interrupted");
    EXPECT_TRUE(fs::is_empty(folder_.path()));
  }
}

TEST_F(SteepHill, AFolderThatHoldsTheSceneIsNotReplaced) {
  fs::copy(scene(), path("scene"), fs::copy_options::recursive);
  const auto before = snapshot(folder_.path());
  ASSERT_TRUE(before.count("scene/run.json"));  // made by camber synth, so it looks like a result
  for (const std::string out : {"scene", "scene/", "scene/."}) {
    EXPECT_ONE_SENTENCE(run_camber({"reconstruct", path("scene/scene.json"), "--no-pictures",
                                    "--overwrite", "--out", path(out)}),
                        2, "holds the input");
  }
  EXPECT_ONE_SENTENCE(run_camber({"patches", path("scene/truth/road.ply"), "--out", path("scene")}),
                      2, "holds the input");
  EXPECT_ONE_SENTENCE(
      run_camber({"compare", path("scene/truth/road.ply"), path("scene/truth/road.ply"), "--out",
                  path("scene/truth"), "--overwrite"}),
      2, "holds the input");
  EXPECT_EQ(snapshot(folder_.path()), before);
}

TEST_F(SteepHill, MoreThreadsThanTheMachineCanHold) {
  const auto result = run_camber({"reconstruct", scene(), "--frames", "0,1", "--threads", "100000",
                                  "--no-pictures", "--out", path("result")});
  EXPECT_EQ(result.exit_code, 0) << result.error;
}

TEST_F(SteepHill, NumbersThatAreNoneAreNamedWithWhatWasExpected) {
  const std::vector<std::array<std::string, 3>> cases = {
      {"--seed", "-1", "found '-1', expected a whole number from 0 to 18446744073709551615"},
      {"--seed", "99999999999999999999", "expected a whole number from 0"},
      {"--threads", "0", "found '0', expected a number above 0"},
      {"--out", "", "found an empty name"}};
  for (const auto& [option, value, part] : cases) {
    std::vector<std::string> arguments = {"reconstruct", scene(), "--no-pictures", option, value};
    if (option != "--out") arguments.insert(arguments.end(), {"--out", path("result")});
    EXPECT_ONE_SENTENCE(run_camber(arguments), 2, part);
  }
  EXPECT_TRUE(fs::is_empty(folder_.path()));
}

TEST_F(SteepHill, PlacesThatCannotBeWrittenExitWithThree) {
  write_bytes(path("file"), "not a folder");
  fs::create_directory(path("foreign"));
  write_bytes(path("foreign/thesis.txt"), "years of work");
  const auto before = snapshot(folder_.path());
  for (const char* out : {"file", "file/below", "foreign"}) {
    EXPECT_ONE_SENTENCE(run_camber({"reconstruct", scene(), "--out", path(out), "--no-pictures"}),
                        3, out);
  }
  EXPECT_ONE_SENTENCE(run_camber({"triangulate", scene(), "--out", path("none/cloud.ply")}), 3,
                      "none/cloud.ply");
  EXPECT_ONE_SENTENCE(run_camber({"triangulate", scene(), "--out", path("cloud.docx")}), 2,
                      "cloud.docx");
  EXPECT_EQ(snapshot(folder_.path()), before);
}

TEST_F(SteepHill, InfoShowsTheManifest) {
  const auto info = run_camber({"info", scene() + "/scene.json", "--json"});
  ASSERT_EQ(info.exit_code, 0) << info.error;
  EXPECT_EQ(info.error, "");
  const json file = json::parse(info.out)["files"][0];
  EXPECT_EQ(file["kind"], "scene");
  EXPECT_EQ(file["frames"].size(), 3u);
}

}  // namespace
}  // namespace camber
