#include "camber/scene/scene.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "camber/core/errors.h"
#include "camber/image/video.h"
#include "support/test_data.h"

namespace camber {
namespace {

using nlohmann::json;
using ::testing::HasSubstr;
namespace fs = std::filesystem;

/// A manifest that uses every key.
json full_manifest() {
  json keypoints = json::array(), truth_keypoints = json::array();
  for (int i = 0; i < 36; ++i) {
    keypoints.push_back({100.0 + i, 50.0, i % 2 ? json(0.5) : json(nullptr)});
    truth_keypoints.push_back({0.1 * i, 1.0, 10.0});
  }
  const json plane = {{"normal", {0.0, -0.6, -0.8}}, {"offset", 1.5}};
  const json pose = {1, 0, 0, 0.5, 0, 1, 0, 0, 0, 0, 1, 2, 0, 0, 0, 1};
  json manifest = {{"format", "camber-scene"},
                   {"version", 1},
                   {"name", "test"},
                   {"camera",
                    {{"width", 640},
                     {"height", 480},
                     {"fx", 500.5},
                     {"fy", 501},
                     {"cx", 320},
                     {"cy", 240},
                     {"height_above_road", 1.65}}},
                   {"frame_rate", 10},
                   {"reference_frame", 4},
                   {"detections_source", "network"},
                   {"segmentation_classes", {{"road", {1, 7}}, {"pavement", {2}}}},
                   {"segmentation_source", "network"},
                   {"markings_m", {{"dash_length", 3.0}}},
                   {"frames",
                    {{{"id", 4},
                      {"time_s", 0.4},
                      {"image", "image/4.png"},
                      {"segmentation", "seg/4.png"},
                      {"ego_plane", plane},
                      {"world_from_camera", pose},
                      {"vehicles",
                       {{{"id", 1},
                         {"class", "van"},
                         {"track", 7},
                         {"box", {1, 2, 3, 4}},
                         {"score", 0.97},
                         {"keypoints", keypoints},
                         {"plane", plane}}}}},
                     {{"id", 3}, {"image", "/data/3.png"}, {"road_mask", "mask/3.png"}}}},
                   {"truth",
                    {{"frames",
                      {{{"id", 4},
                        {"world_from_camera", pose},
                        {"ego_plane", plane},
                        {"depth", "depth/4.png"},
                        {"depth_encoding", "kitti"},
                        {"label", "label/4.png"},
                        {"vehicles",
                         {{{"id", 1},
                           {"class", "car"},
                           {"box", {1, 2, 3, 4}},
                           {"bottom_center", {1, 2, 10}},
                           {"rotation", {0, 0, -1, 0, -1, 0, -1, 0, 0}},
                           {"dimensions", {{"length", 4}, {"width", 1.8}, {"height", 1.5}}},
                           {"moving", true},
                           {"plane", plane},
                           {"keypoints", truth_keypoints},
                           {"occlusion", 0.25},
                           {"truncation", 0.5}}}}}}},
                     {"cloud", "truth/road.ply"},
                     {"cloud_frame", 4}}}};
  return manifest;
}

json minimal_manifest() {
  return {
      {"format", "camber-scene"},
      {"version", 1},
      {"camera", {{"width", 64}, {"height", 48}, {"fx", 50}, {"fy", 50}, {"cx", 32}, {"cy", 24}}},
      {"frames", {{{"id", 0}, {"image", "0.png"}}}}};
}

class SceneFile : public ::testing::Test {
 protected:
  fs::path put(const std::string& text) {
    const fs::path path = folder_.path() / "scene.json";
    std::ofstream(path, std::ios::binary) << text;
    return path;
  }
  fs::path put(const json& manifest) { return put(manifest.dump()); }

  /// The message of the error that reading gives, after the file's name and ": ".
  std::string error_of(const std::string& text) {
    const fs::path path = put(text);
    try {
      read_scene(path);
    } catch (const InputError& error) {
      EXPECT_EQ(error.exit_code(), 2);
      const std::string message = error.what();
      EXPECT_EQ(message.rfind(path.string() + ": ", 0), 0u) << message;
      EXPECT_EQ(message.find('\n'), std::string::npos) << message;
      return message.substr(path.string().size() + 2);
    }
    ADD_FAILURE() << "no error for " << text.substr(0, 200);
    return {};
  }
  std::string error_of(const json& manifest) { return error_of(manifest.dump()); }

  /// The error after one change of the full manifest.
  std::string error_with(const std::string& pointer, const json& value) {
    json manifest = full_manifest();
    manifest[json::json_pointer(pointer)] = value;
    return error_of(manifest);
  }
  std::string error_without(const std::string& pointer, const std::string& key) {
    json manifest = full_manifest();
    manifest[json::json_pointer(pointer)].erase(key);
    return error_of(manifest);
  }

  test::TemporaryFolder folder_;
};

TEST_F(SceneFile, ReadsEveryKey) {
  std::vector<std::string> warnings;
  const Scene scene =
      read_scene(put(full_manifest()), [&](const std::string& s) { warnings.push_back(s); });
  EXPECT_THAT(warnings, ::testing::IsEmpty());
  EXPECT_EQ(scene.name, "test");
  EXPECT_EQ(scene.camera.width, 640);
  EXPECT_EQ(scene.camera.height, 480);
  EXPECT_EQ(scene.camera.fx, 500.5);
  EXPECT_EQ(scene.camera.cy, 240);
  EXPECT_EQ(scene.height_above_road, 1.65);
  EXPECT_EQ(scene.frame_rate, 10);
  EXPECT_EQ(scene.reference_frame, 4);
  EXPECT_EQ(scene.detections_source, "network");
  EXPECT_THAT(scene.segmentation_classes.at("road"), ::testing::ElementsAre(1, 7));
  EXPECT_EQ(scene.segmentation_source, "network");
  EXPECT_EQ(scene.markings_m.at("dash_length"), 3.0);

  ASSERT_EQ(scene.frames.size(), 2u);
  EXPECT_EQ(scene.frames[0].id, 3);  // sorted
  EXPECT_EQ(scene.frames[0].image, "/data/3.png");
  EXPECT_EQ(scene.frames[0].road_mask, folder_.path() / "mask/3.png");
  const SceneFrame* frame = scene.find_frame(4);
  ASSERT_NE(frame, nullptr);
  EXPECT_EQ(scene.find_frame(5), nullptr);
  EXPECT_EQ(frame->image, folder_.path() / "image/4.png");
  EXPECT_EQ(frame->segmentation, folder_.path() / "seg/4.png");
  EXPECT_EQ(frame->time_s, 0.4);
  ASSERT_TRUE(frame->ego_plane);
  EXPECT_NEAR(frame->ego_plane->normal.z(), -0.8, 1e-15);
  EXPECT_EQ(frame->ego_plane->offset, 1.5);
  ASSERT_TRUE(frame->world_from_camera);
  EXPECT_EQ(frame->world_from_camera->translation(), Eigen::Vector3d(0.5, 0, 2));
  ASSERT_EQ(frame->vehicles.size(), 1u);
  const VehicleDetection& detection = frame->vehicles[0];
  EXPECT_EQ(detection.vehicle_class, "van");
  EXPECT_EQ(detection.track, 7);
  EXPECT_EQ(detection.box.y2, 4);
  EXPECT_EQ(detection.score, 0.97);
  ASSERT_EQ(detection.keypoints.size(), 36u);
  EXPECT_EQ(detection.keypoints[35].pixel, Eigen::Vector2d(135, 50));
  EXPECT_TRUE(std::isnan(detection.keypoints[0].confidence));
  EXPECT_EQ(detection.keypoints[1].confidence, 0.5);
  EXPECT_TRUE(detection.has_plane);

  ASSERT_TRUE(scene.truth);
  EXPECT_EQ(scene.truth->cloud, folder_.path() / "truth/road.ply");
  EXPECT_EQ(scene.truth->cloud_frame, 4);
  ASSERT_EQ(scene.truth->frames.size(), 1u);
  const TruthFrame& truth = scene.truth->frames[0];
  EXPECT_EQ(truth.depth_encoding, "kitti");
  EXPECT_EQ(truth.label, folder_.path() / "label/4.png");
  ASSERT_EQ(truth.vehicles.size(), 1u);
  const TruthVehicle& vehicle = truth.vehicles[0];
  // Columns front, up, right: the car drives away from the camera.
  EXPECT_NEAR((vehicle.pose.camera_from_vehicle.rotation() * Eigen::Vector3d(1, 0, 0) -
               Eigen::Vector3d(0, 0, -1))
                  .norm(),
              0, 1e-15);
  EXPECT_EQ(vehicle.pose.bottom_center(), Eigen::Vector3d(1, 2, 10));
  EXPECT_EQ(vehicle.pose.dimensions.width, 1.8);
  EXPECT_TRUE(vehicle.moving);
  EXPECT_EQ(vehicle.occlusion, 0.25);
  EXPECT_EQ(vehicle.truncation, 0.5);
  EXPECT_EQ(vehicle.keypoints.size(), 36u);
}

TEST_F(SceneFile, OptionalKeysMayBeAbsentOrNull) {
  json manifest = minimal_manifest();
  manifest["camera"]["height_above_road"] = nullptr;
  manifest["truth"] = nullptr;
  manifest["frames"][0]["vehicles"] = nullptr;
  const Scene scene = read_scene(put(manifest));
  EXPECT_FALSE(scene.height_above_road);
  EXPECT_FALSE(scene.truth);
  EXPECT_FALSE(scene.frame_rate);
  EXPECT_FALSE(scene.reference_frame);
  EXPECT_TRUE(scene.frames[0].vehicles.empty());
  EXPECT_TRUE(scene.frames[0].segmentation.empty());
}

TEST_F(SceneFile, HasAtMostTwoThousandVehiclesAFrame) {
  json manifest = full_manifest();
  json& vehicles = manifest["frames"][0]["vehicles"];
  const json one = vehicles[0];
  vehicles = json::array();
  for (int id = 0; id < 2000; ++id) {
    vehicles.push_back(one);
    vehicles.back()["id"] = id;
  }
  EXPECT_EQ(read_scene(put(manifest)).frames[1].vehicles.size(), kMostVehiclesPerFrame);
  vehicles.push_back(one);
  vehicles.back()["id"] = 2000;
  try {
    read_scene(put(manifest));
    ADD_FAILURE();
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), testing::HasSubstr("vehicles: found an array"));
    EXPECT_THAT(error.what(), testing::HasSubstr("expected at most 2000 vehicles a frame"));
  }
}

TEST_F(SceneFile, TakesTheFolderForItsManifest) {
  put(minimal_manifest());
  EXPECT_EQ(read_scene(folder_.path()).camera.width, 64);
}

TEST_F(SceneFile, RotationYStandsForARotation) {
  json manifest = full_manifest();
  json& vehicle = manifest["truth"]["frames"][0]["vehicles"][0];
  vehicle.erase("rotation");
  vehicle["rotation_y"] = 0.3;
  const Scene scene = read_scene(put(manifest));
  const SE3 pose = scene.truth->frames[0].vehicles[0].pose.camera_from_vehicle;
  EXPECT_NEAR(rotation_y(pose.rotation_matrix()), 0.3, 1e-12);
  EXPECT_NEAR(pose.rotation_matrix()(1, 1), -1.0, 1e-12);
}

TEST_F(SceneFile, RoundedNormalsAreMadeUnitTogetherWithTheOffset) {
  json manifest = full_manifest();
  manifest["frames"][0]["ego_plane"] = {{"normal", {0.0, -1.0004, 0.0}}, {"offset", 1.65066}};
  const Plane plane = *read_scene(put(manifest)).find_frame(4)->ego_plane;
  EXPECT_EQ(plane.normal, Eigen::Vector3d(0, -1, 0));
  EXPECT_NEAR(plane.offset, 1.65, 1e-12);
}

TEST_F(SceneFile, WarnsOnceAboutEachUnknownKey) {
  json manifest = full_manifest();
  manifest["colour"] = "red";
  manifest["frames"][0]["shutter"] = 1;
  manifest["frames"][1]["shutter"] = 1;
  manifest["truth"]["frames"][0]["vehicles"][0]["plane"]["rms"] = 1;
  std::vector<std::string> warnings;
  const fs::path path = put(manifest);
  read_scene(path, [&](const std::string& s) { warnings.push_back(s); });
  EXPECT_THAT(warnings,
              ::testing::UnorderedElementsAre(
                  path.string() + ": colour: unknown key, ignored",
                  path.string() + ": frames[0].shutter: unknown key, ignored (and in 1 more place)",
                  path.string() + ": truth.frames[0].vehicles[0].plane.rms: unknown key, ignored"));
}

TEST_F(SceneFile, WarnsWhereSegmentationCannotShowTheRoad) {
  json manifest = full_manifest();
  manifest.erase("segmentation_classes");
  std::vector<std::string> warnings;
  read_scene(put(manifest), [&](const std::string& s) { warnings.push_back(s); });
  ASSERT_EQ(warnings.size(), 1u);
  EXPECT_THAT(warnings[0], HasSubstr("no \"road\" is named"));
}

TEST_F(SceneFile, SizesOfUnknownMarkingsAreNamedAndLeftOut) {
  json manifest = minimal_manifest();
  manifest["markings_m"] = {{"dash_lenght", 3.0}, {"dash_gap", 6.0}};
  std::vector<std::string> warnings;
  const Scene scene =
      read_scene(put(manifest), [&](const std::string& s) { warnings.push_back(s); });
  ASSERT_EQ(warnings.size(), 1u);
  EXPECT_THAT(warnings[0], HasSubstr("markings_m.dash_lenght"));
  EXPECT_EQ(scene.markings_m, (std::map<std::string, double>{{"dash_gap", 6.0}}));
}

TEST_F(SceneFile, SaysWhatIsMissing) {
  EXPECT_EQ(error_without("", "format"), "format: missing, expected \"camber-scene\"");
  EXPECT_EQ(error_without("", "version"), "version: missing, expected 1");
  EXPECT_EQ(error_without("", "camera"),
            "camera: missing, expected an object with the camera's intrinsics");
  EXPECT_EQ(error_without("/camera", "fx"),
            "camera.fx: missing, expected a positive number of pixels up to 1e7");
  EXPECT_EQ(error_without("/camera", "height"),
            "camera.height: missing, expected a whole number of pixels from 1 to 65535");
  EXPECT_EQ(error_without("", "frames"), "frames: missing, expected an array of frames");
  EXPECT_EQ(error_without("/frames/0", "id"),
            "frames[0].id: missing, expected an integer from 0 to 2000000000");
  EXPECT_EQ(error_without("/frames/0/vehicles/0", "box"),
            "frames[0].vehicles[0].box: missing, expected 4 numbers [x1, y1, x2, y2]");
  EXPECT_EQ(error_without("/frames/0/ego_plane", "offset"),
            "frames[0].ego_plane.offset: missing, expected a number of metres");
  EXPECT_EQ(error_without("/truth/frames/0", "depth_encoding"),
            "truth.frames[0].depth_encoding: missing, expected \"kitti\" or \"synthia\" beside a "
            "depth image");
  EXPECT_EQ(error_without("/truth/frames/0/vehicles/0", "rotation"),
            "truth.frames[0].vehicles[0].rotation: missing, expected 9 numbers "
            "(camera_from_vehicle row by row), or a rotation_y");
  EXPECT_EQ(error_without("/truth/frames/0/vehicles/0/dimensions", "width"),
            "truth.frames[0].vehicles[0].dimensions.width: missing, expected a positive number of "
            "metres");
}

TEST_F(SceneFile, SaysWhatIsWrong) {
  EXPECT_EQ(error_with("/format", "kitti"), "format: found \"kitti\", expected \"camber-scene\"");
  EXPECT_EQ(error_with("/version", 2),
            "version: found 2, expected 1, the version that this program reads");
  EXPECT_EQ(error_with("/camera/fx", -721.5),
            "camera.fx: found -721.5, expected a positive number of pixels up to 1e7");
  EXPECT_EQ(error_with("/camera/fy", 0),
            "camera.fy: found 0, expected a positive number of pixels up to 1e7");
  EXPECT_EQ(error_with("/camera/cx", nullptr),
            "camera.cx: found null, expected a number of pixels within 1e7 of 0");
  EXPECT_EQ(error_with("/camera/width", 640.5),
            "camera.width: found 640.5, expected a whole number of pixels from 1 to 65535");
  EXPECT_EQ(error_with("/camera/width", "640"),
            "camera.width: found \"640\", expected a whole number of pixels from 1 to 65535");
  EXPECT_EQ(error_with("/camera/width", 0),
            "camera.width: found 0, expected a whole number of pixels from 1 to 65535");
  EXPECT_EQ(error_with("/camera/height_above_road", 0),
            "camera.height_above_road: found 0, expected a positive number of metres up to 1000");
  EXPECT_EQ(error_with("/camera/height_above_road", 1e200),
            "camera.height_above_road: found 1e+200, expected a positive number of metres up to "
            "1000");
  EXPECT_EQ(error_with("/camera/height_sigma", -0.1),
            "camera.height_sigma: found -0.1, expected a positive number of metres");
  EXPECT_EQ(error_with("/frames", json::array()),
            "frames: found an empty array, expected an array of at least one frame");
  EXPECT_EQ(error_with("/frames", 3), "frames: found 3, expected an array of at least one frame");
  EXPECT_EQ(error_with("/frames/0", true),
            "frames[0]: found true, expected a frame {\"id\", \"image\", ...}");
  EXPECT_EQ(error_with("/frames/1/id", 4),
            "frames[1].id: found 4 a second time, expected ids that differ among the frames");
  EXPECT_EQ(error_with("/frames/1/id", -1),
            "frames[1].id: found -1, expected an integer from 0 to 2000000000");
  EXPECT_EQ(error_with("/frames/1/image", ""), "frames[1].image: found \"\", expected a path");
  EXPECT_EQ(error_with("/frames/0/vehicles/0/box", {1, 2, 3}),
            "frames[0].vehicles[0].box: found 3 numbers, expected 4 [x1, y1, x2, y2]");
  EXPECT_EQ(error_with("/frames/0/vehicles/0/box", {1, 2, "3", 4}),
            "frames[0].vehicles[0].box[2]: found \"3\", expected a number");
  EXPECT_EQ(error_with("/frames/0/vehicles/0/box", {5, 2, 3, 4}),
            "frames[0].vehicles[0].box: found x1 = 5 beyond x2 = 3, expected x1 <= x2");
  EXPECT_EQ(error_with("/frames/0/vehicles/0/keypoints", json::array({{1, 2, 3}})),
            "frames[0].vehicles[0].keypoints: found 1 rows, expected 36 rows [u, v, confidence]");
  EXPECT_EQ(error_with("/frames/0/vehicles/0/keypoints/7", {1, 2}),
            "frames[0].vehicles[0].keypoints[7]: found 2 numbers, expected 3 [u, v, confidence], "
            "the confidence a number or null");
  EXPECT_EQ(error_with("/frames/0/vehicles/0/keypoints/7", {1, nullptr, 0}),
            "frames[0].vehicles[0].keypoints[7]: found null for a pixel coordinate, expected a "
            "number (only the confidence may be null)");
  EXPECT_EQ(
      error_with("/frames/0/vehicles/0/plane/normal", {0, -2, 0}),
      "frames[0].vehicles[0].plane.normal: found a vector of length 2, expected a unit vector "
      "(within 0.001)");
  EXPECT_EQ(error_with("/frames/0/ego_plane/normal", {0, 1, 0}),
            "frames[0].ego_plane.normal: found a normal that points down (y = 1), expected it up, "
            "out of the road: y < 0 in the camera frame");
  EXPECT_EQ(error_with("/frames/0/up", {0, 1, 0}),
            "frames[0].up: found 0 1 0, which points down, expected a direction away from the "
            "ground in the camera frame (x right, y down, z forward), about 0 -1 0 for a level "
            "camera");
  EXPECT_THAT(error_with("/frames/1/up", {0, 0, 1}),
              HasSubstr("frames[1].up: found 0 0 1, which points forward, expected"));
  EXPECT_EQ(error_with("/frames/0/world_from_camera", {1, 2, 3}),
            "frames[0].world_from_camera: found 3 numbers, expected 16 numbers, a rigid transform "
            "row by row");
  EXPECT_EQ(
      error_with("/frames/0/world_from_camera", {2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 1}),
      "frames[0].world_from_camera: found a matrix whose 3 x 3 part is no rotation (its columns "
      "are "
      "off orthonormal by 3), expected 16 numbers, a rigid transform row by row");
  EXPECT_EQ(
      error_with("/frames/0/world_from_camera", {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1}),
      "frames[0].world_from_camera: found a matrix whose 3 x 3 part is no rotation (its "
      "determinant "
      "is -1), expected 16 numbers, a rigid transform row by row");
  EXPECT_EQ(
      error_with("/frames/0/world_from_camera", {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 1, 0, 0, 1}),
      "frames[0].world_from_camera: found the last row 1 0 0 1, expected 0 0 0 1");
  EXPECT_EQ(error_with("/reference_frame", 9),
            "reference_frame: found 9, expected the id of one of the frames");
  EXPECT_EQ(error_with("/segmentation_classes/pavement", {7}),
            "segmentation_classes.road[1]: found 7, which stands under \"pavement\" too, expected "
            "each label value under one class");
  EXPECT_EQ(error_with("/segmentation_classes/road", {256}),
            "segmentation_classes.road[0]: found 256, expected a label value from 0 to 255");
  EXPECT_EQ(error_with("/markings_m/dash_length", -3),
            "markings_m.dash_length: found -3, expected a positive number of metres");
  EXPECT_EQ(error_with("/markings_m", "de-autobann"),
            "markings_m: found \"de-autobann\", expected lengths in metres, or one of de-autobahn, "
            "de-landstrasse, de-innerorts, at-autobahn, fr-autoroute, fr-route, us-4in, us-6in");
  EXPECT_EQ(error_with("/truth/cloud_frame", 8),
            "truth.cloud_frame: found 8, expected the id of one of the frames");
  EXPECT_EQ(error_with("/truth/frames/0/depth_encoding", "png"),
            "truth.frames[0].depth_encoding: found \"png\", expected \"kitti\" or \"synthia\"");
  EXPECT_EQ(error_with("/truth/frames/0/vehicles/0/occlusion", 2),
            "truth.frames[0].vehicles[0].occlusion: found 2, expected a share from 0 to 1");
}

TEST_F(SceneFile, TwoVehiclesOfAFrameMustDiffer) {
  json manifest = full_manifest();
  manifest["frames"][0]["vehicles"].push_back({{"id", 1}, {"box", {1, 2, 3, 4}}});
  EXPECT_EQ(error_of(manifest),
            "frames[0].vehicles[1].id: found 1 a second time, expected ids that differ among the "
            "vehicles of a frame");
}

TEST_F(SceneFile, SyntaxErrorsNameLineColumnAndByte) {
  EXPECT_THAT(error_of(std::string("{\n  \"format\": \"camber-scene\",\n  \"version\": }\n")),
              HasSubstr("line 3, column 14 (byte 44): found '}', expected"));
  EXPECT_THAT(error_of(std::string("")), HasSubstr("found the end of the file, expected"));
  EXPECT_THAT(error_of(std::string("{\"a\": [1, 2")),
              HasSubstr("line 1, column 12 (byte 12): found the end of the file"));
  EXPECT_EQ(error_of(std::string("{\"camera\": {\"fx\": NaN}}")),
            "line 1, column 19 (byte 19): found 'NaN', expected a finite number");
  EXPECT_EQ(error_of(std::string("{\"camera\": {\"fx\": -Infinity}}")),
            "line 1, column 19 (byte 19): found '-Infinity', expected a finite number");
  EXPECT_EQ(error_of(std::string("{\"camera\": {\"fx\": 1e999}}")),
            "line 1, column 19 (byte 19): found '1e999', expected a finite number");
  EXPECT_EQ(error_of(std::string("[1, 2]")),
            "top level: found 2 numbers, expected an object with a camera and frames");
  EXPECT_THAT(error_of(std::string("\"\xff\xfe\"")), HasSubstr("ill-formed UTF-8"));
  EXPECT_THAT(error_of(std::string("\x89PNG\r\n\x1a\n")), HasSubstr("line 1, column 1 (byte 1)"));
}

TEST_F(SceneFile, SigmasOfKeypointsAreReadAndWritten) {
  json manifest = full_manifest();
  json& vehicle = manifest[json::json_pointer("/frames/0/vehicles/0")];
  const bool first = vehicle.contains("keypoints");
  const std::string at = first ? "/frames/0/vehicles/0" : "/frames/1/vehicles/0";
  json sigmas = json::array();
  for (int i = 0; i < 36; ++i) sigmas.push_back(i == 7 ? json() : json(0.5 + i));
  manifest[json::json_pointer(at + "/keypoint_sigmas_px")] = sigmas;
  const auto keypoints = [](const Scene& scene) {
    for (const SceneFrame& frame : scene.frames) {
      if (!frame.vehicles.empty()) return frame.vehicles[0].keypoints;
    }
    return std::vector<KeypointObservation>();
  };
  Scene scene = read_scene(put(manifest));
  ASSERT_EQ(keypoints(scene).size(), 36u);
  EXPECT_EQ(keypoints(scene)[35].sigma, 35.5);
  EXPECT_TRUE(std::isnan(keypoints(scene)[7].sigma));
  write_scene(scene, folder_.path() / "again.json");
  scene = read_scene(folder_.path() / "again.json");
  EXPECT_EQ(keypoints(scene)[35].sigma, 35.5);
  EXPECT_TRUE(std::isnan(keypoints(scene)[7].sigma));

  sigmas[3] = 0.0;
  EXPECT_THAT(error_with(at + "/keypoint_sigmas_px", sigmas),
              HasSubstr("36 numbers of px above 0"));
  sigmas.erase(3);
  EXPECT_THAT(error_with(at + "/keypoint_sigmas_px", sigmas),
              HasSubstr("keypoint_sigmas_px: found"));
  manifest[json::json_pointer(at)].erase("keypoints");
  EXPECT_THAT(error_of(manifest), HasSubstr("keypoint_sigmas_px: found no keypoints"));
}

TEST_F(SceneFile, DuplicateKeysAreRefused) {
  EXPECT_EQ(error_of(std::string("{\"frames\": [{\"id\": 1}, {\"id\": 1, \"id\": 2}]}")),
            "frames[1].id: the key stands twice, expected once");
}

TEST_F(SceneFile, DeepNestingIsRefusedWithoutDeepRecursion) {
  const std::string deep(5000000, '[');
  EXPECT_THAT(error_of(deep), HasSubstr("nested deeper than 64 levels"));
  std::string objects;
  for (int i = 0; i < 100000; ++i) objects += "{\"a\":";
  EXPECT_THAT(error_of(objects), HasSubstr("nested deeper than 64 levels"));
}

TEST_F(SceneFile, MissingFilesAndFolders) {
  EXPECT_THROW(read_scene(folder_.path() / "nothing.json"), InputError);
  try {
    read_scene(folder_.path());  // no scene.json inside
    FAIL();
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), HasSubstr("scene.json: no such file"));
  }
}

TEST_F(SceneFile, AnyCutOrFlippedByteIsReadOrRefused) {
  const std::string text = full_manifest().dump();
  const auto attempt = [&](const std::string& damaged) {
    try {
      read_scene(put(damaged));
    } catch (const InputError&) {
    }
  };
  for (std::size_t length = 0; length < text.size(); length += 11) attempt(text.substr(0, length));
  for (std::size_t i = 0; i < text.size(); i += 7) {
    for (const int bit : {0, 3, 6}) {
      std::string damaged = text;
      damaged[i] = static_cast<char>(damaged[i] ^ (1 << bit));
      attempt(damaged);
    }
  }
}

TEST_F(SceneFile, WritingAndReadingGivesTheSameScene) {
  const Scene scene = read_scene(put(full_manifest()));
  fs::create_directories(folder_.path() / "again");
  const fs::path first = folder_.path() / "first.json", second = folder_.path() / "second.json";
  const fs::path elsewhere = folder_.path() / "again" / "scene.json";
  write_scene(scene, first);
  write_scene(read_scene(first), second);
  write_scene(read_scene(first), elsewhere);
  const auto slurp = [](const fs::path& path) {
    std::ostringstream out;
    out << std::ifstream(path, std::ios::binary).rdbuf();
    return out.str();
  };
  EXPECT_EQ(slurp(first), slurp(second));
  const json manifest = json::parse(slurp(first));
  EXPECT_EQ(manifest["frames"][1]["image"], "image/4.png");  // below the folder: relative
  EXPECT_EQ(folder_.path() / manifest["frames"][0]["image"].get<std::string>(),
            folder_.path() / fs::path("/data/3.png").lexically_relative(folder_.path()));
  EXPECT_EQ(manifest["frames"][1]["vehicles"], full_manifest()["frames"][0]["vehicles"]);
  EXPECT_EQ(manifest["camera"], full_manifest()["camera"]);
  // From another folder the paths lead to the same files.
  EXPECT_EQ(read_scene(elsewhere).find_frame(4)->image.lexically_normal(),
            scene.find_frame(4)->image);
}

TEST_F(SceneFile, CanBeMovedTogetherWithWhatItNames) {
  const fs::path before = folder_.path() / "before", after = folder_.path() / "after";
  fs::create_directories(before / "film");
  fs::create_directories(before / "made" / "scene");
  std::ofstream(before / "film" / "drive.mp4") << "x";
  // Through a link the manifest lies deeper than it looks.
  fs::create_directory_symlink(before / "made" / "scene", folder_.path() / "link");
  Scene scene = read_scene(put(full_manifest()));
  for (SceneFrame& frame : scene.frames) {
    frame.image = (before / "film" / "drive.mp4").string() + "#" + std::to_string(frame.id);
  }
  write_scene(scene, folder_.path() / "link" / "scene.json");
  fs::rename(before, after);
  const Scene moved = read_scene(after / "made" / "scene");
  EXPECT_TRUE(fs::equivalent(image_file_of(moved.frames[0].image), after / "film" / "drive.mp4"));
}

TEST_F(SceneFile, SigmasOfTheCameraAreReadAndWritten) {
  json manifest = full_manifest();
  EXPECT_TRUE(read_scene(put(manifest)).camera_sigma.exact());
  manifest["camera"]["focal_sigma"] = 0.09;
  manifest["camera"]["principal_sigma"] = 3.0;
  manifest["camera"]["distortion_sigma"] = 0.05;
  const fs::path again = folder_.path() / "again.json";
  write_scene(read_scene(put(manifest)), again);
  const Scene scene = read_scene(again);
  EXPECT_EQ(scene.camera_sigma.focal, 0.09);
  EXPECT_EQ(scene.camera_sigma.principal, 3.0);
  EXPECT_EQ(scene.camera_sigma.distortion, 0.05);
  manifest["camera"]["focal_sigma"] = -0.1;
  EXPECT_THROW(read_scene(put(manifest)), InputError);
  manifest["camera"]["focal_sigma"] = 1.5;
  EXPECT_THROW(read_scene(put(manifest)), InputError);
}

TEST_F(SceneFile, LensUpAndSpeedAreReadAndWritten) {
  json manifest = full_manifest();
  json raw = {{"width", 700}, {"height", 500}, {"fx", 510}, {"fy", 511}, {"cx", 350}, {"cy", 250}};
  manifest["camera"]["distortion"] = {
      {"model", "brown"}, {"coefficients", {-0.3, 0.1, 0.001, 0.002}}, {"raw", raw}};
  manifest["frames"][0]["up"] = {0, -0.6, -0.8};
  manifest["frames"][0]["speed"] = 12.0;
  manifest["frames"][1]["speed"] = 1.0;
  manifest["frames"][1]["speed_sigma"] = 0.5;
  std::vector<std::string> warnings;
  const Scene read =
      read_scene(put(manifest), [&](const std::string& text) { warnings.push_back(text); });
  EXPECT_TRUE(warnings.empty());
  const fs::path again = folder_.path() / "again.json";
  write_scene(read, again);
  const Scene scene = read_scene(again);
  EXPECT_EQ(scene.distortion.model, LensModel::kBrown);
  EXPECT_EQ(scene.distortion.coefficients, (std::vector<double>{-0.3, 0.1, 0.001, 0.002}));
  EXPECT_EQ(scene.distortion.raw.width, 700);
  EXPECT_EQ(scene.distortion.raw.fy, 511.0);
  const SceneFrame& frame = *scene.find_frame(manifest["frames"][0]["id"].get<int>());
  EXPECT_EQ(frame.up, Eigen::Vector3d(0, -0.6, -0.8));
  EXPECT_NEAR(frame.up_sigma, 0.2 * 3.14159265 / 180.0, 1e-5);
  EXPECT_EQ(frame.speed, 12.0);
  EXPECT_EQ(frame.speed_sigma, 0.24);
  EXPECT_EQ(scene.find_frame(manifest["frames"][1]["id"].get<int>())->speed_sigma, 0.5);
  manifest["camera"]["distortion"]["coefficients"] = {1, 2, 3};
  EXPECT_THAT(error_of(manifest), ::testing::HasSubstr("camera.distortion.coefficients: found 3 "
                                                       "coefficients, expected 4, 5 or 8"));
  manifest["camera"]["distortion"]["model"] = "double sphere";
  EXPECT_THAT(error_of(manifest), ::testing::HasSubstr("expected \"none\", \"brown\" or"));
}

TEST_F(SceneFile, WritingToAMissingFolderIsAnOutputError) {
  const Scene scene = read_scene(put(minimal_manifest()));
  EXPECT_THROW(write_scene(scene, folder_.path() / "none" / "scene.json"), OutputError);
}

Scene scene_with_ids(const std::vector<int>& ids) {
  Scene scene;
  for (const int id : ids) {
    scene.frames.emplace_back();
    scene.frames.back().id = id;
  }
  return scene;
}

TEST(SelectFrames, Lists) {
  const Scene scene = scene_with_ids({48, 49, 50, 51, 52, 60});
  using ::testing::ElementsAre;
  EXPECT_THAT(select_frames(scene, ""), ElementsAre(48, 49, 50, 51, 52, 60));
  EXPECT_THAT(select_frames(scene, "all"), ElementsAre(48, 49, 50, 51, 52, 60));
  EXPECT_THAT(select_frames(scene, "50,48,49"), ElementsAre(48, 49, 50));
  EXPECT_THAT(select_frames(scene, "48:52"), ElementsAre(48, 49, 50, 51, 52));
  EXPECT_THAT(select_frames(scene, "48:52:2"), ElementsAre(48, 50, 52));
  EXPECT_THAT(select_frames(scene, "48:51:2,60"), ElementsAre(48, 50, 60));
  EXPECT_THAT(select_frames(scene, "48,48"), ElementsAre(48));
}

TEST(SelectFrames, Errors) {
  const Scene scene = scene_with_ids({0, 1, 2});
  for (const char* list : {"3", "0:3", "a", "1,", ",", "0:", ":2", "2:0", "0:2:0", "0:2:-1",
                           "0:2:1:1", "1 ,2", "0x1", "99999999999", "0:2000000000"}) {
    EXPECT_THROW(select_frames(scene, list), UsageError) << list;
  }
}

TEST(ChooseReferenceFrame, TheManifestsOrTheMiddle) {
  Scene scene = scene_with_ids({1, 2, 3, 4, 5});
  EXPECT_EQ(choose_reference_frame(scene, {1, 2, 3}), 2);
  EXPECT_EQ(choose_reference_frame(scene, {1, 2, 3, 4}), 3);
  scene.reference_frame = 4;
  EXPECT_EQ(choose_reference_frame(scene, {1, 2, 3, 4}), 4);
  EXPECT_EQ(choose_reference_frame(scene, {1, 2, 3}), 2);
  EXPECT_THROW(choose_reference_frame(scene, {}), std::invalid_argument);
}

TEST(SharedScenes, SteepScenesReadWithoutAWarning) {
  CAMBER_REQUIRE_DATA("steep-scenes");
  int scenes = 0;
  for (const auto& entry : fs::directory_iterator(test::data_dir() / "steep-scenes")) {
    if (!entry.is_directory()) continue;
    ++scenes;
    std::vector<std::string> warnings;
    const Scene scene =
        read_scene(entry.path(), [&](const std::string& s) { warnings.push_back(s); });
    EXPECT_THAT(warnings, ::testing::IsEmpty()) << entry.path();
    EXPECT_EQ(scene.frames.size(), 5u);
    for (const SceneFrame& frame : scene.frames) {
      EXPECT_TRUE(fs::exists(frame.image)) << frame.image;
      EXPECT_TRUE(fs::exists(frame.segmentation)) << frame.segmentation;
    }
    ASSERT_TRUE(scene.truth);
    EXPECT_TRUE(fs::exists(scene.truth->cloud));
    for (const TruthFrame& frame : scene.truth->frames) {
      for (const TruthVehicle& vehicle : frame.vehicles) {
        // The manifest's planes go through the boxes' bottoms: frames and signs are right.
        EXPECT_NEAR(vehicle.plane->signed_distance(vehicle.pose.bottom_center()), 0.0, 0.05);
      }
    }
  }
  EXPECT_EQ(scenes, 10);
}

}  // namespace
}  // namespace camber
