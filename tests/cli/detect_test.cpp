// camber detect, and --detector and --segmenter of reconstruct, as a person uses them: with
// networks made here.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "camber/core/hash.h"
#include "camber/image/image_io.h"
#include "camber/scene/scene.h"
#include "cli/run_program.h"
#include "detect/made_onnx.h"
#include "scene/write_image.h"
#include "support/test_data.h"

namespace camber {
namespace {

using test::run_camber_in;
using test::snapshot;
using test::write_file;
using testing::HasSubstr;
using testing::Not;
using testing::StartsWith;
namespace fs = std::filesystem;

constexpr const char* kDetector =
    R"({"format": "camber-network", "version": 1, "task": "detector",
        "input": {"width": 128, "height": 64, "fit": "stretch"}, "head": "fastestdet",
        "classes": ["other", "car"], "tiles": false})";
constexpr const char* kSegmenter =
    R"({"format": "camber-network", "version": 1, "task": "segmenter",
        "input": {"width": 128, "height": 64, "fit": "stretch"}, "head": "argmax",
        "classes": ["other", "road", "pavement"]})";

class Detect : public ::testing::Test {
 protected:
  Detect() {
    write_file(path("red.onnx"), test::red_cell_detector(128, 64, 16.0));
    write_file(path("red.json"), kDetector);
    write_file(path("colors.onnx"), test::color_segmenter(128, 64));
    write_file(path("colors.json"), kSegmenter);
    fs::create_directories(path("scene"));
    nlohmann::json scene = {
        {"format", "camber-scene"},
        {"version", 1},
        {"camera",
         {{"width", 128}, {"height", 64}, {"fx", 100}, {"fy", 100}, {"cx", 64}, {"cy", 32}}},
        {"frames", nlohmann::json::array()}};
    for (int id = 0; id < 2; ++id) {
      std::vector<std::uint8_t> pixels(3u * 128 * 64, 0);
      for (int y = 40; y < 48; ++y) {
        for (int x = 24 + 16 * id; x < 32 + 16 * id; ++x) pixels[3u * (128 * y + x)] = 255;
        for (int x = 96; x < 104; ++x) pixels[3u * (128 * y + x) + 1] = 255;
      }
      const std::string name = std::to_string(id) + ".png";
      test::write_png(path("scene/" + name), 128, 64, 2, 8, pixels);
      scene["frames"].push_back(
          {{"id", id}, {"image", name}, {"vehicles", {{{"id", 7}, {"box", {1, 1, 9, 9}}}}}});
    }
    write_file(path("scene/scene.json"), scene.dump());
  }
  std::string path(const std::string& name) const { return folder_.path() / name; }
  test::ProgramResult run(const std::vector<std::string>& arguments) const {
    test::Surroundings surroundings;
    surroundings.variables = {"CAMBER_CACHE=" + path("cache")};
    return run_camber_in(surroundings, arguments);
  }
  test::ProgramResult detect(std::vector<std::string> more) const {
    more.insert(more.begin(), {"detect", path("scene"), "--out", path("out")});
    return run(more);
  }
  void expect_refused(const std::vector<std::string>& more, const std::string& part) const {
    const auto before = snapshot(folder_.path());
    EXPECT_ONE_SENTENCE(detect(more), 2, part);
    EXPECT_EQ(snapshot(folder_.path()), before);
  }
  test::TemporaryFolder folder_;
};

TEST_F(Detect, TheShippedNetworkFindsTheSamplesCars) {
  const fs::path sample = test::source_dir() / "samples/steep_hill";
  const std::vector<std::string> arguments = {"detect",  sample,        "--detector",
                                              "shipped", "--keypoints", "none",
                                              "--out",   path("out"),   "--json"};
  const auto result = run(arguments);
  ASSERT_EQ(result.exit_code, 0) << result.error;
  EXPECT_EQ(nlohmann::json::parse(result.out)["networks"]["detector"]["file"], "shipped");
  const Scene truth = read_scene(sample), found = read_scene(path("out"));
  EXPECT_THAT(found.detections_source, StartsWith("shipped:"));
  int cars = 0, matched = 0, boxes = 0;
  for (const SceneFrame& frame : found.frames) {
    boxes += static_cast<int>(frame.vehicles.size());
    for (const TruthFrame& of : truth.truth->frames) {
      if (of.id != frame.id) continue;
      for (const TruthVehicle& car : of.vehicles) {
        if (car.box.height() < 30.0 || car.occlusion > 0.5) continue;
        ++cars;
        matched += std::any_of(frame.vehicles.begin(), frame.vehicles.end(), [&](const auto& v) {
          return intersection_over_union(v.box, car.box) > 0.5;
        });
      }
    }
  }
  EXPECT_GE(cars, 9);
  EXPECT_GE(matched, cars - 1);
  EXPECT_LE(boxes, cars + 6);  // farther and hidden ones, too
  EXPECT_EQ(run({"detect", sample, "--detector", "shipped", "--detector-config", path("none.json"),
                 "--out", path("other")})
                .exit_code,
            2);
}

TEST_F(Detect, TheShippedNetworkFindsVehiclesWhereASceneHasNone) {
  const fs::path sample = test::source_dir() / "samples/steep_hill";
  nlohmann::json scene = nlohmann::json::parse(test::read_text(sample / "scene.json"));
  for (nlohmann::json& frame : scene["frames"]) {
    frame["image"] = (sample / frame["image"].get<std::string>()).string();
    frame["segmentation"] = (sample / frame["segmentation"].get<std::string>()).string();
    frame.erase("vehicles");
  }
  scene.erase("truth");
  write_file(path("bare.json"), scene.dump());
  nlohmann::json kept;  // points of the last run
  const std::vector<std::string> reconstruct = {"reconstruct", path("bare.json"), "--no-pictures",
                                                "--out",       path("result"),    "--json"};
  const std::vector<std::string> triangulate = {"triangulate", path("bare.json"), "--out",
                                                path("road.ply"), "--json"};
  const auto networks = [&](std::vector<std::string> arguments,
                            const std::vector<std::string>& more) {
    arguments.insert(arguments.end(), more.begin(), more.end());
    const auto result = run(arguments);
    EXPECT_EQ(result.exit_code, 0) << result.error;
    const nlohmann::json run_json = nlohmann::json::parse(result.out);
    kept = run_json["points"]["kept"];
    return run_json.value("networks", nlohmann::json());
  };
  // The road alone: what it finds is kept out of it.
  nlohmann::json used = networks(triangulate, {"--no-masks"});
  ASSERT_TRUE(used.is_object());
  EXPECT_EQ(used["vehicle_masks"]["file"], "shipped");
  EXPECT_TRUE(used["detector"].is_null());
  const nlohmann::json with_masks = kept;
  EXPECT_TRUE(networks(reconstruct, {"--no-masks", "--detector", "none"}).is_null());
  EXPECT_NE(kept, with_masks) << "what was found is masked";
  EXPECT_TRUE(networks(triangulate, {}).is_null()) << "masks show vehicles";
  // The main job places it.
  const auto placed = [&] {
    std::size_t count = 0;
    const auto document = nlohmann::json::parse(test::read_text(path("result/vehicles.json")));
    for (const auto& frame : document["frames"]) {
      count += frame["vehicles"].size();
    }
    return count;
  };
  used = networks(reconstruct, {});
  ASSERT_TRUE(used.is_object());
  EXPECT_EQ(used["detector"]["file"], "shipped");
  EXPECT_TRUE(used["vehicle_masks"].is_null());
  EXPECT_GE(placed(), 9u);
  EXPECT_TRUE(networks(reconstruct, {"--detector", "none"}).is_null());
  EXPECT_EQ(placed(), 0u);
}

TEST_F(Detect, FillsASceneWithBoxesAndMasks) {
  const auto result =
      detect({"--detector", path("red.onnx"), "--segmenter", path("colors.onnx"), "--json"});
  ASSERT_EQ(result.exit_code, 0) << result.error;
  const Scene scene = read_scene(path("out"));
  EXPECT_THAT(scene.detections_source,
              StartsWith("network:" + hash_file(path("red.onnx")) + ", keypoints shipped:"));
  EXPECT_EQ(scene.segmentation_source, "network:" + hash_file(path("colors.onnx")));
  EXPECT_EQ(scene.box_sigma_px, 2.5);
  ASSERT_EQ(scene.frames.size(), 2u);
  for (int id = 0; id < 2; ++id) {
    const SceneFrame& frame = scene.frames[static_cast<std::size_t>(id)];
    ASSERT_EQ(frame.vehicles.size(), 1u) << "its own box is replaced";
    EXPECT_EQ(frame.vehicles[0].vehicle_class, "car");
    EXPECT_NEAR(frame.vehicles[0].box.x1, 19.5 + 16 * id, 1e-3);
    EXPECT_NEAR(frame.vehicles[0].box.y2, 51.5, 1e-3);
    EXPECT_EQ(frame.vehicles[0].track, -1);
    const Image labels = read_label_image(frame.segmentation, scene.camera);
    EXPECT_EQ(labels.data[128 * 44 + 28 + 16 * id], 1);
    EXPECT_EQ(labels.data[128 * 44 + 100], 2);
    EXPECT_EQ(labels.data[128 * 10 + 10], 0);
    EXPECT_TRUE(fs::equivalent(frame.image, path("scene/" + std::to_string(id) + ".png")));
  }
  const auto json = nlohmann::json::parse(result.out);
  EXPECT_EQ(json["networks"]["detector"]["layers"], "fused");
  EXPECT_EQ(json["networks"]["detector"]["computed"], 2);
  EXPECT_EQ(json["frames"][1]["vehicles"], 1);
}

TEST_F(Detect, TheNetworkThatShipsFindsTheKeypointsOfBoxes) {
  // Of the scene's own boxes; the detector's get them without being asked for.
  auto result = detect({"--keypoints", "shipped", "--json"});
  ASSERT_EQ(result.exit_code, 0) << result.error;
  Scene scene = read_scene(path("out"));
  EXPECT_THAT(scene.detections_source, StartsWith("keypoints shipped:"));
  const std::vector<KeypointObservation> own = scene.frames[0].vehicles.at(0).keypoints;
  ASSERT_EQ(own.size(), 36u);
  EXPECT_GT(own[0].sigma, 0.0);
  EXPECT_EQ(nlohmann::json::parse(result.out)["networks"]["keypoints"]["computed"], 2);
  EXPECT_THAT(result.error, HasSubstr("keypoints of 2 vehicles (shipped)"));

  result = detect({"--detector", path("red.onnx")});
  ASSERT_EQ(result.exit_code, 0) << result.error;
  scene = read_scene(path("out"));
  ASSERT_EQ(scene.frames[0].vehicles.at(0).keypoints.size(), 36u);
  EXPECT_NE(scene.frames[0].vehicles[0].keypoints[0].pixel, own[0].pixel) << "another box";

  result = detect({"--detector", path("red.onnx"), "--keypoints", "none"});
  ASSERT_EQ(result.exit_code, 0) << result.error;
  scene = read_scene(path("out"));
  EXPECT_TRUE(scene.frames[0].vehicles.at(0).keypoints.empty());
  EXPECT_EQ(scene.detections_source, "network:" + hash_file(path("red.onnx")));
}

TEST_F(Detect, ResultsComeFromTheCacheUntilSomethingChanges) {
  const std::vector<std::string> arguments = {"--detector", path("red.onnx"), "--segmenter",
                                              path("colors.onnx"), "--json"};
  const auto use = [&](const std::vector<std::string>& more) {
    std::vector<std::string> all = arguments;
    all.insert(all.end(), more.begin(), more.end());
    const auto result = detect(all);
    EXPECT_EQ(result.exit_code, 0) << result.error;
    return nlohmann::json::parse(result.out)["networks"];
  };
  EXPECT_EQ(use({})["detector"]["cached"], 0);
  const auto first = snapshot(path("out"));
  auto networks = use({});
  EXPECT_EQ(networks["detector"]["cached"], 2);
  EXPECT_EQ(networks["segmenter"]["cached"], 2);
  EXPECT_EQ(networks["segmenter"]["layers"], "fused");
  EXPECT_EQ(snapshot(path("out")), first);
  EXPECT_EQ(use({"--no-cache"})["detector"]["cached"], 0);
  EXPECT_EQ(use({"--cache", path("other")})["detector"]["cached"], 0);
  // A damaged entry is computed again.
  for (const auto& entry : fs::directory_iterator(path("cache/networks"))) {
    write_file(entry.path(), "damaged");
  }
  EXPECT_EQ(use({})["segmenter"]["cached"], 0);
  EXPECT_EQ(snapshot(path("out")), first);
  write_file(path("red.json"), std::string(kDetector) + "\n");
  networks = use({});
  EXPECT_EQ(networks["detector"]["cached"], 0) << "another description";
  EXPECT_EQ(networks["segmenter"]["cached"], 2);
}

TEST_F(Detect, ACacheThatCannotBeWrittenIsNoMatter) {
  write_file(path("file"), "");
  EXPECT_EQ(detect({"--detector", path("red.onnx"), "--cache", path("file/below")}).exit_code, 0);
}

TEST_F(Detect, OneSentenceForWhatIsWrong) {
  expect_refused({}, "expected --detector, --segmenter or --keypoints");
  expect_refused({"--keypoints-config", path("red.json")},
                 "expected --keypoints beside it, with a file");
  expect_refused({"--keypoints", path("none.onnx")}, "none.json: no such file");
  expect_refused({"--keypoints", path("red.onnx")}, "task: found \"detector\"");
  expect_refused({"--detector", path("none.onnx")}, "none.onnx: no such file");
  expect_refused({"--detector", path("red.onnx"), "--detector-config", path("none.json")},
                 "none.json: no such file");
  expect_refused({"--detector-config", path("red.json")}, "expected --detector beside it");
  expect_refused({"--detector", path("colors.onnx")}, "task: found \"segmenter\"");
  expect_refused({"--detector", path("colors.onnx"), "--detector-config", path("red.json")},
                 "colors.onnx: found output (1, 3, 64, 128), expected (1, 7, N, N) for head "
                 "fastestdet");
  expect_refused({"--segmenter", path("red.onnx"), "--segmenter-config", path("colors.json")},
                 "red.onnx: found output (1, 7, 8, 16), expected one (1, 3, rows, columns)");
  write_file(path("text.onnx"), "this is no network");
  write_file(path("text.json"), kDetector);
  expect_refused({"--detector", path("text.onnx")},
                 "text.onnx: found no network that OpenCV can load");
  write_file(path("red.json"), "{");
  expect_refused({"--detector", path("red.onnx")}, "red.json: line 1");
}

TEST_F(Detect, DoesNotWriteOverItsInput) {
  const auto before = snapshot(path("scene"));
  EXPECT_ONE_SENTENCE(
      run({"detect", path("scene"), "--out", path("scene"), "--detector", path("red.onnx")}), 2,
      "is the input");
  EXPECT_EQ(snapshot(path("scene")), before);
}

TEST_F(Detect, ReconstructTakesNetworksOnTheWay) {
  const fs::path sample = test::source_dir() / "samples/steep_hill";
  const auto result =
      run({"reconstruct", sample.string(), "--detector", path("red.onnx"), "--segmenter-config",
           path("colors.json"), "--out", path("result"), "--no-pictures"});
  EXPECT_ONE_SENTENCE(result, 2, "expected --segmenter beside it");
  // Of the sample's pixels none is as red.
  write_file(path("red.json"), std::string(kDetector).insert(1, "\"score\": 0.99, "));
  const auto good = run({"reconstruct", sample.string(), "--detector", path("red.onnx"), "--out",
                         path("result"), "--no-pictures"});
  ASSERT_EQ(good.exit_code, 0) << good.error;
  const auto vehicles = nlohmann::json::parse(test::read_text(path("result/vehicles.json")));
  EXPECT_EQ(vehicles["detections_source"], "network:" + hash_file(path("red.onnx")));
  const auto run_json = nlohmann::json::parse(test::read_text(path("result/run.json")));
  EXPECT_EQ(run_json["networks"]["detector"]["layers"], "fused");
  EXPECT_EQ(run_json["networks"]["segmenter"], nullptr);
}

}  // namespace
}  // namespace camber
