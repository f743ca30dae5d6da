// Files that other files name: read or refused, their content quoted nowhere.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <sys/stat.h>

#include <nlohmann/json.hpp>

#include "camber/cloud/cloud_io.h"
#include "camber/scene/results.h"
#include "cli/run_program.h"
#include "scene/write_image.h"
#include "support/test_data.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

using nlohmann::json;
using test::run_camber;
using test::write_bytes;
using ::testing::HasSubstr;
using ::testing::Not;

constexpr const char* kMarker = "MARKER";
constexpr const char* kConfined = "expected a path that stays in the manifest's folder (--confine)";

class ReferredFiles : public ::testing::Test {
 protected:
  ReferredFiles() {
    fs::create_directories(folder_.path() / "scene");
    fs::create_directories(folder_.path() / "result");
    fs::create_directories(folder_.path() / "elsewhere");
    test::write_png(path("scene/image.png"), 64, 32, 0, 8, test::picture(64, 32, 1));
    scene_ = {
        {"format", "camber-scene"},
        {"version", 1},
        {"name", "drive"},
        {"camera", {{"width", 64}, {"height", 32}, {"fx", 50}, {"fy", 50}, {"cx", 32}, {"cy", 16}}},
        {"frames", {{{"id", 0}, {"image", "image.png"}, {"time_s", 1.5}}}},
        {"truth", {{"frames", {{{"id", 0}}}}, {"cloud_frame", 0}}}};
    put_scene();
    RoadCloud road;
    road.frame = CloudFrame::kCamera;
    for (int i = 0; i < 20; ++i) {
      for (int j = 0; j < 20; ++j) {
        road.points.emplace_back(0.2f * static_cast<float>(i) - 2.0f, 1.5f,
                                 4.0f + 0.5f * static_cast<float>(j));
      }
    }
    write_cloud(road, path("result/road.ply"));
    put_run(path("scene/scene.json"));
    VehicleDocument vehicles;
    vehicles.frames = {{0, {}}};
    write_json(to_json(vehicles), path("result/vehicles.json"));
  }

  std::string path(const std::string& name) const { return folder_.path() / name; }
  void put_scene() { write_bytes(path("scene/scene.json"), scene_.dump()); }
  void put_truth(const std::string& cloud) {
    scene_["truth"]["cloud"] = cloud;
    put_scene();
  }
  void put_run(const std::string& scene, const json& extra = json::object()) {
    RunDocument run;
    run.cameras = {{0, SE3()}};
    run.scene = scene;
    run.extra = extra;
    write_json(to_json(run), path("result/run.json"));
  }

  /// Runs the program, which may print and write nothing of the marker.
  test::ProgramResult run(const std::vector<std::string>& arguments) {
    fs::remove_all(path("out"));
    fs::create_directories(path("out"));
    const test::ProgramResult result = run_camber(arguments);
    EXPECT_THAT(result.out, Not(HasSubstr(kMarker)));
    EXPECT_THAT(result.error, Not(HasSubstr(kMarker)));
    for (const auto& [name, bytes] : test::snapshot(path("out"))) {
      if (fs::path(name).extension() == ".ply") continue;  // a cloud, decoded and coloured
      EXPECT_EQ(bytes.find(kMarker), std::string::npos) << name;
    }
    return result;
  }
  void expect_refusal(const std::vector<std::string>& arguments, const std::string& part) {
    SCOPED_TRACE(::testing::PrintToString(arguments));
    EXPECT_ONE_SENTENCE(run(arguments), 2, part);
  }

  json scene_;
  test::TemporaryFolder folder_;
};

TEST_F(ReferredFiles, TruthClouds) {
  const std::pair<const char*, const char*> secrets[] = {
      {"secret.txt", "MARKER line one\n"},
      {"names.txt", "a b MARKER\n1 2 3\n"},
      {"twice.csv", "x,y,z,MARKER,MARKER\n1,2,3,4,5\n"},
      {"row.xyz", "x y z\n1 2 3\nMARKER 2 3\n"},
      {"magic.ply", "MARKER\n"},
      {"format.ply", "ply\nformat MARKER 1.0\n"},
      {"element.ply", "ply\nformat ascii 1.0\nelement MARKER\n"},
      {"key.ply", "ply\nformat ascii 1.0\nMARKER\n"},
      {"short.ply",
       "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
       "property float z\nelement MARKER 99\nproperty float MARKER\nend_header\n1 2 3\n"},
      {"value.ply",
       "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
       "property float z\nend_header\n1 2 MARKER\n"},
      {"word.pcd", "MARKER\n"},
      {"size.pcd", "VERSION .7\nFIELDS x y z\nSIZE MARKER 4 4\n"},
      {"data.pcd", "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nDATA MARKER\n"},
      {"scan.ptx", "MARKER\n1\n"},
      {"scan.bin", "MARKER"},
      {"scan.las", "LASFMARKER"},
      {"points3D.txt", "MARKER\n"},
      {"archive.e57", "ASTM-E57MARKER"}};
  for (const auto& [name, content] : secrets) {
    SCOPED_TRACE(name);
    const std::string secret = path(std::string("elsewhere/") + name);
    write_bytes(secret, content);
    put_truth(secret);
    const std::string expected = "expected a point cloud";
    expect_refusal({"compare", path("result"), path("scene")}, expected);
    expect_refusal({"render", path("result"), "--truth", "scene", "--out", path("out/a.png")},
                   expected);
  }
  put_truth(path("elsewhere/row.xyz"));
  expect_refusal({"compare", path("result"), path("scene")}, "row.xyz: line 3: expected");
}

TEST_F(ReferredFiles, SoundTruthCloudsNameNothingOfTheirs) {
  std::string text = "x,y,z,MARKER_number,MARKER_word\n";
  for (int i = 0; i < 20; ++i) {
    for (int j = 0; j < 20; ++j) {
      text += std::to_string(0.2 * i - 2) + ",1.5," + std::to_string(4 + 0.5 * j) + ",7,word\n";
    }
  }
  write_bytes(path("truth.csv"), text);
  put_truth(path("truth.csv"));
  const auto compared =
      run({"compare", path("result"), path("scene"), "--out", path("out/compared"), "--json"});
  EXPECT_EQ(compared.exit_code, 0) << compared.error;
  EXPECT_THAT(compared.error, HasSubstr("truth.csv: 1 remark on it not shown"));
  const auto drawn = run({"render", path("result"), "--truth", "scene", "--size", "160x120",
                          "--out", path("out/a.png"), "--json"});
  EXPECT_EQ(drawn.exit_code, 0) << drawn.error;
}

TEST_F(ReferredFiles, OpenCrgRoads) {
  write_bytes(path("secret.txt"), "MARKER line one\n");
  write_bytes(path("scene/road.crg"), "$ROAD_CRG_FILE\n" + path("secret.txt") + "\n$\n");
  for (const char* verb : {"info", "profile"}) {
    expect_refusal({verb, path("scene/road.crg"), "--json"},
                   "secret.txt: line 1: expected an OpenCRG file");
  }
  expect_refusal({"compare", path("result"), path("scene/road.crg")}, "secret.txt: line 1");
  put_truth("road.crg");
  expect_refusal({"compare", path("result"), path("scene")}, "secret.txt: line 1");
  expect_refusal({"compare", path("result"), path("scene"), "--confine"},
                 "road.crg: names a file elsewhere, expected one that stays in the manifest's "
                 "folder (--confine)");
}

TEST_F(ReferredFiles, ScenesOfRuns) {
  const std::string expected = "secret.json: ";
  for (const std::string& content :
       {std::string("MARKER line one\n"), std::string("\"MARKER\""),
        std::string(R"({"MARKER": 1, "MARKER": 2})"), std::string(R"({"format": "MARKER"})"),
        std::string(R"({"format": "camber-scene", "version": 1, "camera": "MARKER"})"),
        std::string(R"({"format": "camber-scene", "version": 1, "camera": {}, "MARKER": 1})")}) {
    write_bytes(path("secret.json"), content);
    put_run(path("secret.json"));
    expect_refusal({"render", path("result"), "--view", "overlay", "--out", path("out/a.png")},
                   expected);
    expect_refusal({"render", path("result"), "--out", path("out/a.png")}, expected);
    expect_refusal({"render", path("result"), "--out", path("out/report.html")}, expected);
    expect_refusal(
        {"export", path("result"), "--to", "trajectory", "--out", path("out/cameras.tum")},
        expected);
  }
  json unknown = scene_;
  unknown["MARKER"] = 1;
  unknown["frames"][0]["image"] = path("scene/image.png");
  write_bytes(path("secret.json"), unknown.dump());
  const auto drawn =
      run({"render", path("result"), "--view", "overlay", "--out", path("out/a.png")});
  EXPECT_EQ(drawn.exit_code, 0) << drawn.error;
  EXPECT_THAT(drawn.error, HasSubstr("secret.json: 1 remark on it not shown"));
}

TEST_F(ReferredFiles, ImagesAndVideosOfScenes) {
  write_bytes(path("secret.txt"), "MARKER line one\n");
  write_bytes(path("secret.mp4"), "MARKER line one\n");
  scene_["frames"][0]["vehicles"] = {{{"id", 0}, {"box", {5, 2, 60, 30}}, {"class", "car"}}};
  for (const std::string& image : {path("secret.txt"), path("secret.mp4#0")}) {
    scene_["frames"][0]["image"] = image;
    put_scene();
    expect_refusal({"render", path("result"), "--view", "overlay", "--out", path("out/a.png")},
                   "secret.");
    expect_refusal({"keypoints", "run", path("scene"), "--out", path("out/keypoints.json")},
                   "secret.");
  }
  scene_["frames"][0]["image"] = "image.png";
  for (const char* key : {"segmentation", "road_mask"}) {
    scene_["frames"][0][key] = path("secret.txt");
    scene_["segmentation_classes"] = {{"road", {1}}};
    put_scene();
    EXPECT_NE(run({"reconstruct", path("scene"), "--out", path("out/result")}).exit_code, 0);
    scene_["frames"][0].erase(key);
  }
  scene_["truth"]["frames"][0]["depth"] = path("secret.txt");
  scene_["truth"]["frames"][0]["depth_encoding"] = "kitti";
  put_scene();
  expect_refusal({"compare", path("result"), path("scene")}, "secret.txt");
}

TEST_F(ReferredFiles, PipesThatScenesNameAreNotWaitedFor) {
  ASSERT_EQ(::mkfifo(path("scene/pipe.png").c_str(), 0600), 0);
  test::Surroundings limited;
  limited.limit_s = 60.0;
  for (const char* key : {"image", "segmentation", "road_mask"}) {
    const json image = scene_["frames"][0]["image"];
    scene_["frames"][0][key] = "pipe.png";
    put_scene();
    for (const std::string verb : {"reconstruct", "detect", "triangulate"}) {
      const std::string out = verb == "triangulate" ? "out.ply" : "out.json";
      const std::string reason = std::string("scene.json: frames[0].") + key +
                                 ": found \"pipe.png\", expected a file that is neither a pipe "
                                 "nor a device";
      EXPECT_ONE_SENTENCE(test::run_camber_in(limited, {verb, path("scene/scene.json"), "--out",
                                                        path("elsewhere/" + out)}),
                          2, reason);
    }
    scene_["frames"][0].erase(key);
    scene_["frames"][0]["image"] = image;
  }
}

TEST_F(ReferredFiles, ASystemOfAResultNamesNoFile) {
  write_bytes(path("secret.txt"), "EPSG:32632");
  put_run("", {{"georeference",
                {{"status", "ok"},
                 {"crs", path("secret.txt")},
                 {"map_from_reference", {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1}}}}});
  expect_refusal({"convert", path("result/road.ply"), "--to-map", "--out", path("out/road.las")},
                 "secret.txt', expected EPSG:n, well-known text or a PROJ string");
}

TEST_F(ReferredFiles, EveryVerbThatReadsScenesCanBeConfined) {
  write_bytes(path("secret.png"), "MARKER");
  scene_["frames"][0]["segmentation"] = "../secret.png";
  put_scene();
  const std::vector<std::vector<std::string>> commands = {
      {"compare", path("result"), path("scene")},
      {"compare", path("result"), path("result"), "--camera", path("scene")},
      {"render", path("result"), "--scene", path("scene"), "--out", path("out/a.png")},
      {"evaluate", "--truth", path("scene"), "--estimate", path("result")},
      {"convert", path("scene/image.png"), "--depth", "kitti", "--camera", path("scene"), "--out",
       path("out/depth.ply")},
      {"reconstruct", path("scene"), "--out", path("out/result")},
      {"triangulate", path("scene"), "--out", path("out/cloud.ply")},
      {"vehicles", path("scene"), "--out", path("out/vehicles.json")},
      {"keypoints", "run", path("scene"), "--out", path("out/keypoints.json")},
      {"keypoints", "evaluate", path("scene"), "--out", path("out/evaluated.json")}};
  for (std::vector<std::string> command : commands) {
    command.emplace_back("--confine");
    expect_refusal(command, kConfined);
  }
}

TEST_F(ReferredFiles, ConfinedTruthModelsNameNothingOutsideTheirFolder) {
  write_bytes(path("points3D.txt"), "MARKER\n");
  fs::create_directories(path("scene/model"));
  fs::create_symlink(path("points3D.txt"), path("scene/model/points3D.txt"));
  put_truth("model");
  expect_refusal({"compare", path("result"), path("scene"), "--confine"}, kConfined);
}

TEST_F(ReferredFiles, ConfinedScenesOfRunsLieInTheResult) {
  const auto overlay = [&] {
    return std::vector<std::string>{"render",    path("result"), "--view",         "overlay",
                                    "--confine", "--out",        path("out/a.png")};
  };
  const auto trajectory = [&] {
    return std::vector<std::string>{"export",    path("result"), "--to",  "trajectory",
                                    "--confine", "--json",       "--out", path("out/cameras.tum")};
  };
  expect_refusal(overlay(), "lies outside the result's folder (--confine)");
  const auto elsewhere = run(trajectory());
  EXPECT_EQ(elsewhere.exit_code, 0) << elsewhere.error;
  EXPECT_THAT(elsewhere.error, HasSubstr("lies outside the result's folder (--confine)"));
  EXPECT_EQ(json::parse(elsewhere.out)["clock"], "frames");

  fs::rename(path("scene"), path("result/scene"));
  put_run(path("result/scene"));
  const auto drawn = run(overlay());
  EXPECT_EQ(drawn.exit_code, 0) << drawn.error;
  EXPECT_EQ(json::parse(run(trajectory()).out)["clock"], "seconds");
  scene_["frames"][0]["image"] = "../../secret.png";
  write_bytes(path("result/scene/scene.json"), scene_.dump());
  expect_refusal(overlay(), kConfined);
  expect_refusal(trajectory(), kConfined);
}

}  // namespace
}  // namespace camber
