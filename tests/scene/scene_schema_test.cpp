// docs/schema/scene.schema.json and the reader of scene.json know the same keys, need the same ones
// and refuse the same types.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>
#include <nlohmann/json.hpp>
#include <regex>
#include <set>
#include <sstream>

#include "camber/core/errors.h"
#include "camber/scene/scene.h"
#include "support/test_data.h"

namespace camber {
namespace {

using nlohmann::json;
using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
namespace fs = std::filesystem;
using test::read_text;

const json& schema() {
  static const json document =
      json::parse(read_text(test::source_dir() / "docs/schema/scene.schema.json"));
  return document;
}

/// A manifest that has every key of the schema.
json whole_manifest() {
  json keypoints = json::array(), keypoint_sigmas = json::array(), truth_keypoints = json::array();
  for (int i = 0; i < 36; ++i) {
    keypoints.push_back({10.0, 20.0, 0.5});
    keypoint_sigmas.push_back(1.5);
    truth_keypoints.push_back({0.1, 1.0, 10.0});
  }
  const json pose = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
  const json rotation = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  const json plane = {{"normal", {0, -1, 0}}, {"offset", 1.5}};
  const json size = {{"length", 4}, {"width", 2}, {"height", 1.5}};
  json out = {{"format", "camber-scene"}, {"version", 1}};
  out["name"] = "all keys";
  out["camera"] = {{"width", 64}, {"height", 48}, {"fx", 50}, {"fy", 50}, {"cx", 32}, {"cy", 24}};
  out["camera"]["height_above_road"] = 1.5;
  out["camera"]["height_sigma"] = 0.02;
  out["camera"]["focal_sigma"] = 0.01;
  out["camera"]["principal_sigma"] = 1.5;
  out["camera"]["distortion_sigma"] = 0.02;
  out["camera"]["distortion"] = {{"model", "none"}, {"coefficients", json::array()}};
  out["camera"]["distortion"]["raw"] = {{"width", 64}, {"height", 48}, {"fx", 50},
                                        {"fy", 50},    {"cx", 32},     {"cy", 24}};
  out["frame_rate"] = 10;
  out["reference_frame"] = 3;
  out["detections_source"] = "network";
  out["box_sigma_px"] = 2.5;
  out["segmentation_classes"] = {{"road", {1}}};
  out["segmentation_source"] = "network";
  out["markings_m"] = {{"dash_length", 3}};
  out["gnss"] = {{"crs", "EPSG:32632"}, {"antenna", {0.1, 0.2, -1.0}}};
  out["frames"] = {{{"id", 3},
                    {"time_s", 0.1},
                    {"image", "a.png"},
                    {"segmentation", "b.png"},
                    {"road_mask", "c.png"},
                    {"ego_plane", plane},
                    {"world_from_camera", pose},
                    {"up", {0, -1, 0}},
                    {"up_sigma_deg", 0.5},
                    {"speed", 12.5},
                    {"speed_sigma", 0.25},
                    {"gnss",
                     {{"position", {456000.5, 5428000.25, 110.5}},
                      {"sigma", 0.5},
                      {"height_sigma", 1.0},
                      {"heading_deg", 30.0},
                      {"heading_sigma_deg", 2.0}}},
                    {"vehicles",
                     {{{"id", 1},
                       {"box", {1, 2, 3, 4}},
                       {"class", "car"},
                       {"track", 2},
                       {"score", 0.5},
                       {"keypoints", keypoints},
                       {"keypoint_sigmas_px", keypoint_sigmas},
                       {"plane", plane}}}}}};
  out["truth"] = {{"cloud", "d.ply"},
                  {"vehicles_source", "depth_fit"},
                  {"cloud_frame", 3},
                  {"frames",
                   {{{"id", 3},
                     {"world_from_camera", pose},
                     {"ego_plane", plane},
                     {"depth", "e.png"},
                     {"depth_encoding", "kitti"},
                     {"label", "f.png"},
                     {"vehicles",
                      {{{"id", 1},
                        {"class", "car"},
                        {"box", {1, 2, 3, 4}},
                        {"bottom_center", {1, 2, 10}},
                        {"rotation", rotation},
                        {"rotation_y", 0.1},
                        {"dimensions", size},
                        {"moving", true},
                        {"occlusion", 0.1},
                        {"truncation", 0.2},
                        {"uncertain", "one_side"},
                        {"plane", plane},
                        {"keypoints", truth_keypoints}}}}}}}};
  return out;
}

/// The schema at a reference, or the value itself.
const json& resolved(const json& value) {
  const auto reference = value.find("$ref");
  if (reference == value.end()) return value;
  return schema().at(json::json_pointer(reference->get<std::string>().substr(1)));
}

/// A key of the schema and where the whole manifest has it.
struct Key {
  json::json_pointer place;
  std::string name;
  bool required = false;
  json type;  ///< of the schema; null: const or enum
};

void collect(const json& of_object, const json::json_pointer& place, std::vector<Key>* out) {
  const json& object = resolved(of_object);
  if (object.contains("properties")) {
    for (const auto& [name, value] : object["properties"].items()) {
      Key key{place / name, name, false, resolved(value).value("type", json())};
      for (const json& needed : object.value("required", json::array())) {
        key.required |= needed == name;
      }
      out->push_back(key);
      collect(value, key.place, out);
    }
  } else if (object.contains("items")) {
    collect(object["items"], place / 0, out);
  }
}

std::vector<Key> keys_of_schema() {
  std::vector<Key> out;
  collect(schema(), json::json_pointer(), &out);
  return out;
}

/// The reader's sentence about a manifest, empty if it takes it.
std::string refusal(const json& manifest, std::vector<std::string>* warnings = nullptr) {
  const test::TemporaryFolder folder;
  const fs::path path = folder.path() / "scene.json";
  std::ofstream(path) << manifest;
  try {
    read_scene(path, [&](const std::string& sentence) {
      if (warnings) warnings->push_back(sentence);
    });
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

/// The keys of all objects in a document.
void collect_names(const json& value, std::set<std::string>* names) {
  for (const auto& [name, child] : value.items()) {
    if (value.is_object()) names->insert(name);
    if (child.is_structured()) collect_names(child, names);
  }
}

TEST(SceneSchema, HasTheKeysOfTheReaderAndNoOther) {
  std::set<std::string> in_schema, in_reader;
  for (const Key& key : keys_of_schema()) in_schema.insert(key.name);
  const fs::path folder = test::source_dir() / "lib/camber/scene";
  const std::string reader = read_text(folder / "scene.cpp");
  const std::string shared = read_text(folder / "json_reader.cpp");
  const std::string map = read_text(folder / "map_position.cpp");
  static const std::regex taken(R"re((?:find|require|read_focal)\("([a-z_]+)")re");
  for (const std::string& source : {reader, shared, map}) {
    for (std::sregex_iterator at(source.begin(), source.end(), taken), end; at != end; ++at) {
      in_reader.insert((*at)[1]);
    }
  }
  // Of the map of classes, whose names are free.
  EXPECT_EQ(in_reader, in_schema);
}

TEST(SceneSchema, DescribesAManifestWithAllItsKeysThatTheReaderTakesWithoutAWarning) {
  const json manifest = whole_manifest();
  for (const Key& key : keys_of_schema()) EXPECT_TRUE(manifest.contains(key.place)) << key.place;
  std::vector<std::string> warnings;
  EXPECT_EQ(refusal(manifest, &warnings), "");
  EXPECT_THAT(warnings, IsEmpty());
}

TEST(SceneSchema, RequiresTheKeysThatTheReaderRequires) {
  for (const Key& key : keys_of_schema()) {
    SCOPED_TRACE(key.place.to_string());
    json manifest = whole_manifest();
    manifest.at(key.place.parent_pointer()).erase(key.name);
    // The depth image alone needs its encoding.
    if (key.name == "depth_encoding") manifest.at(key.place.parent_pointer()).erase("depth");
    // Sigmas alone need keypoints.
    if (key.place.to_string() == "/frames/0/vehicles/0/keypoints") {
      manifest.at(key.place.parent_pointer()).erase("keypoint_sigmas_px");
    }
    // Positions alone need a map.
    if (key.place.to_string() == "/gnss") manifest["frames"][0].erase("gnss");
    const std::string sentence = refusal(manifest);
    if (key.required) {
      EXPECT_THAT(sentence, HasSubstr(key.name + ": missing"));
    } else {
      EXPECT_EQ(sentence, "");
    }
  }
}

TEST(SceneSchema, RequiresWhatOtherKeysNeedAsTheReaderDoes) {
  json manifest = whole_manifest();
  manifest["truth"]["frames"][0].erase("depth_encoding");
  EXPECT_THAT(refusal(manifest), HasSubstr("depth_encoding: missing"));
  EXPECT_EQ(schema()["$defs"]["truth_frame"]["dependentRequired"]["depth"][0], "depth_encoding");
  manifest = whole_manifest();
  manifest.erase("gnss");
  EXPECT_THAT(refusal(manifest), HasSubstr("gnss: missing"));
  manifest = whole_manifest();
  json& vehicle = manifest["truth"]["frames"][0]["vehicles"][0];
  vehicle.erase("rotation");
  vehicle.erase("rotation_y");
  EXPECT_THAT(refusal(manifest), HasSubstr("rotation: missing"));
  EXPECT_EQ(schema()["$defs"]["truth_vehicle"]["anyOf"].size(), 2u);
}

TEST(SceneSchema, HasTheTypesThatTheReaderTakes) {
  for (const Key& key : keys_of_schema()) {
    SCOPED_TRACE(key.place.to_string());
    const std::vector<std::pair<const char*, json>> values = {{"string", "text"},
                                                              {"number", 1.5},
                                                              {"boolean", true},
                                                              {"array", json::array()},
                                                              {"object", json::object()}};
    for (const auto& [type, value] : values) {
      const json types = key.type.is_array() ? key.type : json::array({key.type});
      if (std::find(types.begin(), types.end(), type) != types.end()) continue;
      json manifest = whole_manifest();
      manifest[key.place] = value;
      // Beside a rotation it is not read.
      if (key.name == "rotation_y") manifest[key.place.parent_pointer()].erase("rotation");
      EXPECT_THAT(refusal(manifest), HasSubstr(key.name)) << "takes a " << type;
    }
  }
}

TEST(SceneSchema, HasTheLengthsAndBoundsThatTheReaderChecks) {
  int checked = 0;
  for (const Key& key : keys_of_schema()) {
    SCOPED_TRACE(key.place.to_string());
    // The schema of the key itself, by way of the references.
    const json* at = &schema();
    std::istringstream parts(key.place.to_string().substr(1));
    for (std::string part; std::getline(parts, part, '/');) {
      const json& object = resolved(*at);
      at = object.contains("properties") ? &object["properties"][part] : &object["items"];
    }
    const json& own = resolved(*at);
    const bool is_id = at->contains("$ref");  // others refer to it
    const auto refused_with = [&](const json& value) {
      json manifest = whole_manifest();
      manifest[key.place] = value;
      ++checked;
      return !refusal(manifest).empty();
    };
    if (own.contains("exclusiveMinimum")) {
      EXPECT_TRUE(refused_with(own["exclusiveMinimum"]));
    }
    if (own.contains("minimum")) {
      EXPECT_TRUE(refused_with(own["minimum"].get<double>() - 1.0));
      EXPECT_TRUE(is_id || !refused_with(own["minimum"]));
    }
    if (own.contains("maximum")) {
      EXPECT_TRUE(refused_with(own["maximum"].get<double>() + 1.0));
      EXPECT_TRUE(is_id || !refused_with(own["maximum"]));
    }
    if (own.contains("minLength")) {
      EXPECT_TRUE(refused_with(""));
    }
    if (own.contains("minItems")) {
      json shorter = whole_manifest().at(key.place);
      shorter.erase(shorter.size() - 1);
      EXPECT_TRUE(refused_with(shorter));
    }
    if (own.contains("maxItems")) {
      json longer = whole_manifest().at(key.place);
      longer.push_back(longer.back());
      EXPECT_TRUE(refused_with(longer));
    }
    if (own.contains("const") || own.contains("enum")) {
      EXPECT_TRUE(refused_with("other"));
    }
  }
  EXPECT_GT(checked, 50);
}

TEST(SceneSchema, HasTheKeysThatAreWritten) {
  const test::TemporaryFolder folder;
  const fs::path path = folder.path() / "scene.json";
  std::ofstream(path) << whole_manifest();
  const fs::path written = folder.path() / "written.json";
  write_scene(read_scene(path), written);
  std::set<std::string> names, known = {"road", "dash_length"};
  collect_names(json::parse(read_text(written)), &names);
  for (const Key& key : keys_of_schema()) known.insert(key.name);
  for (const std::string& name : names) EXPECT_THAT(known, Contains(name));
}

}  // namespace
}  // namespace camber
