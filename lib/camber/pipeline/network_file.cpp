#include "camber/pipeline/network_file.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <stdexcept>

#include "camber/core/errors.h"
#include "camber/core/lower_case.h"
#include "camber/core/read_file.h"
#include "camber/import/formats/class_map.h"
#include "camber/import/formats/detections.h"
#include "camber/scene/json_reader.h"

namespace camber {
namespace {

using nlohmann::json;

constexpr const char* kFormat = "camber-network";
constexpr int kVersion = 1;

/// The word that stands here, one of a list.
std::size_t word_at(const JsonCursor& cursor, const std::vector<std::string>& words) {
  const std::string expectation = fmt::format("one of {}", fmt::join(words, ", "));
  const std::string& text = cursor.text(expectation.c_str());
  const auto at = std::find(words.begin(), words.end(), text);
  if (at == words.end()) cursor.fail(expectation);
  return static_cast<std::size_t>(at - words.begin());
}

NetworkInput read_input(const JsonCursor& cursor) {
  JsonObject object(cursor, "an object {\"width\", \"height\", ...}");
  NetworkInput out;
  const char* side = "a whole number of pixels from 8 to 8192";
  out.width = object.require("width", side).integer(8, 8192, side);
  out.height = object.require("height", side).integer(8, 8192, side);
  if (auto v = object.find("fit")) {
    out.fit = word_at(*v, {"letterbox", "stretch"}) == 0 ? NetworkInput::Fit::kLetterbox
                                                         : NetworkInput::Fit::kStretch;
  }
  if (auto v = object.find("align")) {
    out.align = word_at(*v, {"center", "top_left"}) == 0 ? NetworkInput::Align::kCenter
                                                         : NetworkInput::Align::kTopLeft;
  }
  if (auto v = object.find("padding")) {
    out.padding = v->integer(0, 255, "a whole number from 0 to 255");
  }
  if (auto v = object.find("colors")) out.bgr = word_at(*v, {"rgb", "bgr"}) == 1;
  if (auto v = object.find("range")) {
    const std::vector<double> range = v->numbers(2, "2 numbers, what 0 and 255 become");
    if (range[0] == range[1]) v->fail("2 numbers that differ, what 0 and 255 become");
    out.low = range[0];
    out.high = range[1];
  }
  const auto three = [&](const char* key, std::array<double, 3>* to) {
    const auto v = object.find(key);
    if (!v) return;
    const std::vector<double> values = v->numbers(3, "3 numbers, one a channel");
    std::copy(values.begin(), values.end(), to->begin());
    if (std::string(key) == "std" && std::count(values.begin(), values.end(), 0.0) > 0) {
      v->fail("3 numbers that are not 0, one a channel");
    }
  };
  three("mean", &out.mean);
  three("std", &out.std);
  object.note_unknown_keys();
  return out;
}

NetworkCheck read_check(const JsonCursor& cursor) {
  JsonObject object(cursor, "an object {\"values\", \"tolerance\"}");
  NetworkCheck out;
  constexpr int kMost = 2000000000;
  if (auto v = object.find("tolerance")) out.tolerance = v->positive();
  for (const JsonCursor& item :
       object.require("values", "an array").items("an array of {\"index\", \"value\"}")) {
    JsonObject value(item, "an object {\"output\", \"index\", \"value\"}");
    StoredOutput stored;
    const char* number = "a whole number of at least 0";
    if (auto v = value.find("output")) stored.output = v->text("the name of an output");
    for (const JsonCursor& index :
         value.require("index", "an array").items("an array of whole numbers")) {
      stored.index.push_back(index.integer(0, kMost, number));
    }
    stored.value = value.require("value", "a number").number();
    value.note_unknown_keys();
    out.values.push_back(std::move(stored));
  }
  object.note_unknown_keys();
  return out;
}

/// "coco", or names in the order of their numbers.
std::vector<std::string> read_classes(const JsonCursor& cursor) {
  const char* expectation = "\"coco\" or an array of names";
  if (cursor.value().is_string()) {
    if (cursor.text() != "coco") cursor.fail(expectation);
    return coco_class_names();
  }
  std::vector<std::string> out;
  for (const JsonCursor& name : cursor.items(expectation)) out.push_back(name.text("a name"));
  if (out.empty()) cursor.fail(expectation);
  return out;
}

int class_number(const JsonCursor& cursor, const std::string& name,
                 const std::vector<std::string>& classes) {
  const auto at = std::find(classes.begin(), classes.end(), name);
  if (at == classes.end()) {
    cursor.fail_because(
        fmt::format("found the class \"{}\", expected one of `classes`", printable(name)));
  }
  return static_cast<int>(at - classes.begin());
}

/// Those of `names` by numbers that Camber has a prior for under the same name.
std::map<int, std::string> vehicles_by_name(const std::vector<std::string>& names) {
  std::map<int, std::string> out;
  for (std::size_t i = 0; i < names.size(); ++i) {
    const std::string name = lower_case(names[i]);
    for (const char* known : {"car", "van", "truck", "bus"}) {
      if (name == known) out[static_cast<int>(i)] = known;
    }
  }
  return out;
}

std::map<int, std::string> read_vehicles(const JsonCursor& cursor,
                                         const std::vector<std::string>& classes) {
  JsonObject object(cursor, "an object {name of a class: vehicle class}");
  std::map<int, std::string> out;
  for (const auto& [name, value] : object.entries()) {
    out[class_number(value, name, classes)] = value.text("a vehicle class");
  }
  if (out.empty()) cursor.fail("at least one class");
  return out;
}

DetectionTiles read_tiles(const JsonCursor& cursor) {
  DetectionTiles out;
  if (cursor.value().is_boolean()) {
    out.enabled = cursor.boolean();
    return out;
  }
  JsonObject object(cursor, "true, false or an object {\"side\", \"overlap\", \"most\"}");
  if (auto v = object.find("side")) out.side = v->in_range(0.1, 4.0, "a number from 0.1 to 4");
  if (auto v = object.find("overlap")) {
    out.overlap = v->in_range(0.0, 0.9, "a number from 0 to 0.9");
  }
  if (auto v = object.find("most")) {
    out.most = v->integer(1, 1000, "a whole number from 1 to 1000");
  }
  object.note_unknown_keys();
  return out;
}

/// A number between 0 and 1, both excluded.
double read_share(const JsonCursor& cursor) {
  const char* expectation = "a number between 0 and 1";
  const double out = cursor.in_range(0.0, 1.0, expectation);
  if (out <= 0.0 || out >= 1.0) cursor.fail(expectation);
  return out;
}

/// A document of format "camber-network" whose task is `task`.
class SideFile {
 public:
  /// @param name  of the file, for messages.
  SideFile(const std::string& text, const std::string& name, const std::string& task)
      : context_{name, {}},
        document_(parse_json(text, name)),
        root_(JsonCursor(document_, context_)) {
    const auto fixed = [&](const char* key, const json& expected) {
      const std::string expectation = expected.dump();
      const JsonCursor found = root_.require(key, expectation.c_str());
      if (found.value() != expected) found.fail(expectation);
    };
    fixed("format", kFormat);
    fixed("version", kVersion);
    fixed("task", task);
  }
  SideFile(const std::filesystem::path& path, const std::string& task)
      : SideFile(text_of(path, task), path.string(), task) {}

  JsonObject& root() { return root_; }

  /// After the last key: unknown ones are reported, and the description is checked as a whole.
  template <typename Description>
  void finish(const Description& description, const LogSink& warn) {
    root_.note_unknown_keys();
    context_.report_unknown(warn);
    try {
      description.validate();
    } catch (const std::invalid_argument& error) {
      throw InputError(context_.file, error.what());
    }
  }

 private:
  static std::string text_of(const std::filesystem::path& path, const std::string& task) {
    std::error_code ignored;
    if (!std::filesystem::exists(path, ignored)) {
      throw InputError(path.string(),
                       fmt::format("no such file, expected the description of the {} (see "
                                   "docs/formats.md, side files of networks)",
                                   task));
    }
    return read_whole_file(path, std::size_t{1} << 24);
  }

  JsonContext context_;
  json document_;
  JsonObject root_;
};

DetectorDescription read_detector(SideFile& file, const LogSink& warn) {
  JsonObject& root = file.root();
  DetectorDescription out;
  if (auto v = root.find("name")) out.name = v->text();
  out.input = read_input(root.require("input", "an object"));
  if (auto v = root.find("check")) out.check = read_check(*v);
  const std::vector<std::string> heads = {"yolox", "yolov5", "yolov8", "fastestdet"};
  const JsonCursor head = root.require("head", "yolox, yolov5, yolov8 or fastestdet");
  out.head = *detector_head_from_string(heads[word_at(head, heads)]);
  if (auto v = root.find("strides")) {
    out.strides.clear();
    for (const JsonCursor& stride : v->items("an array of whole numbers")) {
      out.strides.push_back(stride.integer(1, 1024, "a whole number from 1 to 1024"));
    }
  }
  const JsonCursor classes = root.require("classes", "\"coco\" or an array of names");
  out.classes = read_classes(classes);
  if (auto v = root.find("vehicles")) {
    out.vehicles = read_vehicles(*v, out.classes);
  } else {
    out.vehicles = vehicles_by_name(out.classes);
    if (out.vehicles.empty()) {
      classes.fail_because(
          "found none of car, van, truck and bus, expected `vehicles` to say which classes are "
          "vehicles");
    }
  }
  if (auto v = root.find("score")) out.least_score = read_share(*v);
  if (auto v = root.find("overlap")) out.most_overlap = read_share(*v);
  if (auto v = root.find("tiles")) out.tiles = read_tiles(*v);
  if (auto v = root.find("box_sigma_px")) out.box_sigma_px = v->positive();
  file.finish(out, warn);
  return out;
}

KeypointsDescription read_keypoints(SideFile& file, const LogSink& warn) {
  JsonObject& root = file.root();
  KeypointsDescription out;
  if (auto v = root.find("name")) out.name = v->text();
  out.input = read_input(root.require("input", "an object"));
  if (auto v = root.find("check")) out.check = read_check(*v);
  word_at(root.require("head", "hourglass"), {"hourglass"});
  if (auto v = root.find("spread_weight")) out.spread_weight = v->number();
  if (auto v = root.find("sigma_scale")) {
    JsonObject scale(*v, "an object {\"visible\", \"hidden\"}");
    out.visible_sigma_scale = scale.require("visible", "a positive number").positive();
    out.hidden_sigma_scale = scale.require("hidden", "a positive number").positive();
    scale.note_unknown_keys();
  }
  if (auto v = root.find("visibility")) {
    JsonObject logit(*v, "an object {\"scale\", \"offset\"}");
    out.visibility_scale = logit.require("scale", "a number").number();
    out.visibility_offset = logit.require("offset", "a number").number();
    logit.note_unknown_keys();
  }
  if (auto v = root.find("mirrored")) out.mirrored = v->boolean();
  file.finish(out, warn);
  return out;
}

}  // namespace

std::filesystem::path side_file_of(const std::filesystem::path& network,
                                   const std::filesystem::path& given) {
  if (!given.empty()) return given;
  std::filesystem::path out = network;
  return out.replace_extension(".json");
}

DetectorDescription read_detector_description(const std::filesystem::path& path,
                                              const LogSink& warn) {
  SideFile file(path, "detector");
  return read_detector(file, warn);
}

DetectorDescription parse_detector_description(const std::string& text, const std::string& name) {
  SideFile file(text, name, "detector");
  return read_detector(file, {});
}

SegmenterDescription read_segmenter_description(const std::filesystem::path& path,
                                                const LogSink& warn) {
  SideFile file(path, "segmenter");
  JsonObject& root = file.root();
  SegmenterDescription out;
  if (auto v = root.find("name")) out.name = v->text();
  out.input = read_input(root.require("input", "an object"));
  if (auto v = root.find("check")) out.check = read_check(*v);
  const std::vector<std::string> heads = {"argmax", "pairs"};
  out.head =
      *segmenter_head_from_string(heads[word_at(root.require("head", "argmax or pairs"), heads)]);
  const JsonCursor list = root.require("classes", "an array of names");
  out.names = read_classes(list);
  const std::vector<std::string>& classes = out.names;
  bool by_keys = false;
  const auto role = [&](const char* key, std::vector<int>* to) {
    const auto v = root.find(key);
    if (!v) return;
    by_keys = true;
    for (const JsonCursor& name : v->items("an array of names of `classes`")) {
      to->push_back(class_number(name, name.text("a name"), classes));
    }
  };
  role("road", &out.classes.road);
  role("pavement", &out.classes.pavement);
  role("vehicle", &out.classes.vehicle);
  for (int i = 0; i < static_cast<int>(classes.size()) && !by_keys; ++i) {
    switch (role_of_class(classes[static_cast<std::size_t>(i)])) {
      case MaskRole::kRoad:
        out.classes.road.push_back(i);
        break;
      case MaskRole::kPavement:
        out.classes.pavement.push_back(i);
        break;
      case MaskRole::kVehicle:
        out.classes.vehicle.push_back(i);
        break;
      case MaskRole::kOther:
        break;
    }
  }
  if (out.classes.road.empty()) {
    list.fail_because("found no class of the road, expected `road` to say which classes are road");
  }
  file.finish(out, warn);
  return out;
}

KeypointsDescription read_keypoints_description(const std::filesystem::path& path,
                                                const LogSink& warn) {
  SideFile file(path, "keypoints");
  return read_keypoints(file, warn);
}

KeypointsDescription parse_keypoints_description(const std::string& text, const std::string& name) {
  SideFile file(text, name, "keypoints");
  return read_keypoints(file, {});
}

}  // namespace camber
