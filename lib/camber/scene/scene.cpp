#include "camber/scene/scene.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <set>

#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "camber/core/folder_files.h"
#include "camber/core/referred_file.h"
#include "camber/image/video.h"
#include "camber/scene/camera_up.h"
#include "camber/scene/detail/map_position.h"
#include "camber/scene/input_kind.h"
#include "camber/scene/json_reader.h"
#include "camber/scene/marking_presets.h"
#include "camber/scene/validate_scene.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

using nlohmann::json;

constexpr const char* kFormat = "camber-scene";
constexpr int kFormatVersion = 1;
constexpr int kMaxId = 2000000000;
constexpr int kMaxImageSide = 65535;
constexpr double kMaxIntrinsic = 1e7;              // pixels
constexpr double kMostDistortionSigma = 10.0;      // of k1
constexpr double kMaxSpeed = 1000.0;               // m/s
constexpr double kRadians = 0.017453292519943295;  // of a degree

Box2 read_box(const JsonCursor& cursor) {
  const std::vector<double> v = cursor.numbers(4, "4 [x1, y1, x2, y2]");
  if (v[0] > v[2]) {
    cursor.fail_because(fmt::format("found x1 = {} beyond x2 = {}, expected x1 <= x2", v[0], v[2]));
  }
  if (v[1] > v[3]) {
    cursor.fail_because(fmt::format("found y1 = {} beyond y2 = {}, expected y1 <= y2", v[1], v[3]));
  }
  return {v[0], v[1], v[2], v[3]};
}

int read_id(JsonObject& object) {
  const char* expectation = "an integer from 0 to 2000000000";
  return object.require("id", expectation).integer(0, kMaxId, expectation);
}

/// Refuses an id that was seen before among `what`.
void claim_id(std::set<int>& seen, int id, const JsonCursor& cursor, const char* what) {
  if (seen.insert(id).second) return;
  throw InputError(
      cursor.context().file, cursor.path() + ".id",
      fmt::format("found {} a second time, expected ids that differ among the {}", id, what));
}

std::vector<KeypointObservation> read_observations(const JsonCursor& cursor) {
  const std::string expectation = fmt::format("{} rows [u, v, confidence]", kNumKeypoints);
  const std::vector<JsonCursor> rows = cursor.items(expectation.c_str());
  if (rows.size() != kNumKeypoints) {
    cursor.fail_because(fmt::format("found {} rows, expected {}", rows.size(), expectation));
  }
  std::vector<KeypointObservation> out;
  out.reserve(rows.size());
  for (const JsonCursor& row : rows) {
    const char* row_expectation = "3 [u, v, confidence], the confidence a number or null";
    const json& value = row.value();
    if (!value.is_array() || value.size() != 3) row.fail(row_expectation);
    const std::vector<double> v = row.numbers(3, row_expectation, true);
    if (value[0].is_null() || value[1].is_null())
      row.fail_because(
          "found null for a pixel coordinate, expected a number (only the confidence may be null)");
    out.push_back({Eigen::Vector2d(v[0], v[1]), v[2]});
  }
  return out;
}

/// Standard deviations of the keypoints' pixels, which must be there.
void read_keypoint_sigmas(const JsonCursor& cursor, std::vector<KeypointObservation>* keypoints) {
  const std::string expectation =
      fmt::format("{} numbers of px above 0 or null, beside the keypoints", kNumKeypoints);
  if (keypoints->empty()) cursor.fail_because("found no keypoints, expected " + expectation);
  const std::vector<double> sigmas = cursor.numbers(kNumKeypoints, expectation.c_str(), true);
  for (std::size_t i = 0; i < sigmas.size(); ++i) {
    if (sigmas[i] <= 0.0) cursor.fail(expectation);
    (*keypoints)[i].sigma = sigmas[i];
  }
}

VehicleDetection read_detection(const JsonCursor& cursor, std::set<int>& seen) {
  JsonObject object(cursor, "a vehicle {\"id\", \"box\", ...}");
  VehicleDetection out;
  out.id = read_id(object);
  claim_id(seen, out.id, cursor, "vehicles of a frame");
  out.box = read_box(object.require("box", "4 numbers [x1, y1, x2, y2]"));
  if (auto v = object.find("class")) out.vehicle_class = v->text("a class name");
  if (auto v = object.find("track"))
    out.track = v->integer(-1, kMaxId, "an integer of at least -1");
  if (auto v = object.find("score")) out.score = v->number();
  if (auto v = object.find("keypoints")) out.keypoints = read_observations(*v);
  if (auto v = object.find("keypoint_sigmas_px")) read_keypoint_sigmas(*v, &out.keypoints);
  if (auto v = object.find("plane")) {
    out.given_plane = read_plane(*v, true);
    out.has_plane = true;
  }
  object.note_unknown_keys();
  return out;
}

/// The six keys of a pinhole camera.
PinholeCamera read_intrinsics(JsonObject& object) {
  PinholeCamera out;
  const char* pixels = "a whole number of pixels from 1 to 65535";
  const char* focal = "a positive number of pixels up to 1e7";
  const char* center = "a number of pixels within 1e7 of 0";
  out.width = object.require("width", pixels).integer(1, kMaxImageSide, pixels);
  out.height = object.require("height", pixels).integer(1, kMaxImageSide, pixels);
  const auto read_focal = [&](const char* key) {
    const JsonCursor value = object.require(key, focal);
    if (!(value.positive(focal) <= kMaxIntrinsic)) value.fail(focal);
    return value.number();
  };
  out.fx = read_focal("fx");
  out.fy = read_focal("fy");
  out.cx = object.require("cx", center).in_range(-kMaxIntrinsic, kMaxIntrinsic, center);
  out.cy = object.require("cy", center).in_range(-kMaxIntrinsic, kMaxIntrinsic, center);
  return out;
}

LensDistortion read_distortion(const JsonCursor& cursor, const PinholeCamera& camera) {
  JsonObject object(cursor, "a distortion {\"model\", \"coefficients\"}");
  const JsonCursor model = object.require("model", "\"none\", \"brown\" or \"fisheye\"");
  LensDistortion out;
  const std::string& name = model.text();
  if (name == "brown") {
    out.model = LensModel::kBrown;
  } else if (name == "fisheye") {
    out.model = LensModel::kFisheye;
  } else if (name != "none") {
    model.fail("\"none\", \"brown\" or \"fisheye\"");
  }
  const auto coefficients = object.find("coefficients");
  if (coefficients) {
    for (const JsonCursor& c : coefficients->items("an array of numbers")) {
      out.coefficients.push_back(c.number());
    }
  }
  out.raw = camera;
  if (auto v = object.find("raw")) {
    JsonObject raw(*v, "a camera {\"width\", \"height\", \"fx\", \"fy\", \"cx\", \"cy\"}");
    out.raw = read_intrinsics(raw);
    raw.note_unknown_keys();
  }
  try {
    out.validate();
  } catch (const std::invalid_argument& error) {
    (coefficients ? *coefficients : cursor).fail_because(error.what());
  }
  object.note_unknown_keys();
  return out;
}

PinholeCamera read_camera(const JsonCursor& cursor, Scene* scene) {
  JsonObject object(cursor, "a camera {\"width\", \"height\", \"fx\", \"fy\", \"cx\", \"cy\"}");
  const PinholeCamera out = read_intrinsics(object);
  if (auto v = object.find("distortion")) scene->distortion = read_distortion(*v, out);
  if (auto v = object.find("height_above_road")) {
    const char* metres = "a positive number of metres up to 1000";
    if (!(v->positive(metres) <= kMostCameraHeight)) v->fail(metres);
    scene->height_above_road = v->number();
  }
  if (auto v = object.find("height_sigma")) {
    scene->height_sigma = v->positive("a positive number of metres");
  }
  CameraSigma& sigma = scene->camera_sigma;
  if (auto v = object.find("focal_sigma")) {
    sigma.focal = v->in_range(0.0, 1.0, "a share of the focal length from 0 to 1");
  }
  if (auto v = object.find("principal_sigma")) {
    sigma.principal = v->in_range(0.0, kMaxImageSide, "a number of pixels from 0 to 65535");
  }
  if (auto v = object.find("distortion_sigma")) {
    sigma.distortion = v->in_range(0.0, kMostDistortionSigma, "a number from 0 to 10");
  }
  object.note_unknown_keys();
  return out;
}

TruthVehicle read_truth_vehicle(const JsonCursor& cursor, std::set<int>& seen) {
  JsonObject object(cursor, "a true vehicle {\"id\", \"box\", ...}");
  TruthVehicle out;
  out.id = read_id(object);
  claim_id(seen, out.id, cursor, "true vehicles of a frame");
  if (auto v = object.find("class")) out.vehicle_class = v->text("a class name");
  out.box = read_box(object.require("box", "4 numbers [x1, y1, x2, y2]"));
  const Eigen::Vector3d bottom =
      object.require("bottom_center", "3 numbers [x, y, z] in metres").vector3();
  const auto rotation = object.find("rotation");
  const auto yaw = object.find("rotation_y");
  if (!rotation && !yaw) {
    object.require("rotation", "9 numbers (camera_from_vehicle row by row), or a rotation_y");
  }
  out.pose.camera_from_vehicle =
      SE3(rotation ? rotation->rotation() : rotation_from_rotation_y(yaw->number()), bottom);
  JsonObject size(object.require("dimensions", "{\"length\", \"width\", \"height\"} in metres"));
  const char* metres = "a positive number of metres";
  out.pose.dimensions.length = size.require("length", metres).positive(metres);
  out.pose.dimensions.width = size.require("width", metres).positive(metres);
  out.pose.dimensions.height = size.require("height", metres).positive(metres);
  size.note_unknown_keys();
  if (auto v = object.find("moving")) out.moving = v->boolean();
  if (auto v = object.find("occlusion")) out.occlusion = v->in_range(0, 1, "a share from 0 to 1");
  if (auto v = object.find("truncation")) out.truncation = v->in_range(0, 1, "a share from 0 to 1");
  if (auto v = object.find("uncertain")) out.uncertain = v->text("a reason");
  if (auto v = object.find("plane")) out.plane = read_plane(*v, true);
  if (auto v = object.find("keypoints")) {
    const std::string expectation = fmt::format("{} rows [x, y, z]", kNumKeypoints);
    const std::vector<JsonCursor> rows = v->items(expectation.c_str());
    if (rows.size() != kNumKeypoints) {
      v->fail_because(fmt::format("found {} rows, expected {}", rows.size(), expectation));
    }
    for (const JsonCursor& row : rows) out.keypoints.push_back(row.vector3());
  }
  object.note_unknown_keys();
  return out;
}

std::map<std::string, double> read_markings(const JsonCursor& cursor) {
  if (cursor.value().is_string()) {
    if (auto sizes = marking_preset(cursor.text())) return *sizes;
    cursor.fail(
        fmt::format("lengths in metres, or one of {}", fmt::join(marking_preset_names(), ", ")));
  }
  JsonObject markings(cursor, "an object of lengths in metres, or the name of a preset");
  std::map<std::string, double> out;
  for (const std::string& name : marking_size_names()) {
    if (auto v = markings.find(name.c_str())) {
      out[name] = v->positive("a positive number of metres");
    }
  }
  markings.note_unknown_keys();
  return out;
}

class ManifestReader {
 public:
  ManifestReader(const fs::path& path, const json& document, const LogSink& warn, ScenePaths paths)
      : folder_(path.parent_path()), document_(document), warn_(warn), paths_(paths) {
    std::error_code error;
    const fs::path here = folder_.empty() ? fs::path(".") : folder_;
    real_folder_ = fs::weakly_canonical(here, error);
    if (error) real_folder_ = fs::absolute(here);
    context_.file = path.string();
  }

  Scene read() {
    JsonObject root(JsonCursor(document_, context_), "an object with a camera and frames");
    const JsonCursor format = root.require("format", "\"camber-scene\"");
    if (!format.value().is_string() || format.text() != kFormat) format.fail("\"camber-scene\"");
    const JsonCursor version = root.require("version", "1");
    if (!version.value().is_number() || version.number() != kFormatVersion) {
      version.fail(fmt::format("{}, the version that this program reads", kFormatVersion));
    }

    Scene scene;
    if (auto v = root.find("name")) scene.name = v->text();
    scene.camera =
        read_camera(root.require("camera", "an object with the camera's intrinsics"), &scene);
    if (auto v = root.find("frame_rate")) {
      scene.frame_rate = v->positive("a positive number of frames a second");
    }
    if (auto v = root.find("detections_source")) scene.detections_source = v->text();
    if (auto v = root.find("box_sigma_px")) {
      scene.box_sigma_px = v->positive("a positive number of pixels");
    }
    if (auto v = root.find("segmentation_classes")) read_classes(*v, scene);
    if (auto v = root.find("segmentation_source")) scene.segmentation_source = v->text();
    if (auto v = root.find("markings_m")) {
      scene.markings_m = read_markings(*v);
    }
    if (auto v = root.find("gnss")) read_map(*v, &scene);

    const JsonCursor frames = root.require("frames", "an array of frames");
    const char* frames_expectation = "an array of at least one frame";
    for (const JsonCursor& cursor : frames.items(frames_expectation)) {
      scene.frames.push_back(read_frame(cursor));
    }
    if (scene.frames.empty()) frames.fail(frames_expectation);
    const bool placed = std::any_of(scene.frames.begin(), scene.frames.end(),
                                    [](const SceneFrame& f) { return f.map_position.has_value(); });
    if (placed && scene.map_crs.empty()) root.require("gnss", "the crs of the frames' positions");
    std::sort(scene.frames.begin(), scene.frames.end(),
              [](const SceneFrame& a, const SceneFrame& b) { return a.id < b.id; });

    if (auto v = root.find("reference_frame")) {
      scene.reference_frame = v->integer(0, kMaxId, "a frame id");
      if (!scene.find_frame(*scene.reference_frame)) {
        v->fail("the id of one of the frames");
      }
    }
    if (auto v = root.find("truth")) scene.truth = read_truth(*v, scene);
    root.note_unknown_keys();
    context_.report_unknown(warn_);
    warn_about_segmentation(scene);
    return scene;
  }

 private:
  fs::path resolve(const JsonCursor& cursor) const {
    const fs::path named = cursor.file_path();
    // Above the folder: from where it really is, without the way down and up again.
    const bool above = !named.empty() && *named.begin() == "..";
    fs::path path = above ? (real_folder_ / named).lexically_normal() : folder_ / named;
    if (paths_ == ScenePaths::kConfined && !stays_below(image_file_of(path))) {
      cursor.fail("a path that stays in the manifest's folder (--confine)");
    }
    if (is_special_file(image_file_of(path))) {
      cursor.fail("a file that is neither a pipe nor a device");
    }
    return path;
  }

  /// Of a folder, such as a COLMAP model, also the files in it.
  bool stays_below(const fs::path& path) const {
    if (!lies_below(path, folder_)) return false;
    std::error_code error;
    for (fs::directory_iterator at(path, error), end; !error && at != end; at.increment(error)) {
      if (!lies_below(at->path(), folder_)) return false;
    }
    return true;
  }

  void read_classes(const JsonCursor& cursor, Scene& scene) {
    JsonObject classes(cursor, "an object like {\"road\": [1], \"pavement\": [2]}");
    std::map<int, std::string> owner;
    for (const auto& [name, values] : classes.entries()) {
      std::vector<int>& labels = scene.segmentation_classes[name];
      for (const JsonCursor& value : values.items("an array of label values from 0 to 255")) {
        const int label = value.integer(0, 255, "a label value from 0 to 255");
        const auto [at, fresh] = owner.emplace(label, name);
        if (!fresh && at->second != name) {
          value.fail_because(
              fmt::format("found {}, which stands under \"{}\" too, expected each "
                          "label value under one class",
                          label, printable(at->second)));
        }
        labels.push_back(label);
      }
    }
  }

  static Eigen::Vector3d read_up(const JsonCursor& cursor) {
    const Eigen::Vector3d up = cursor.unit_vector();
    if (const char* wrong = why_not_up(up)) {
      cursor.fail_because(fmt::format(
          "found {:.4g} {:.4g} {:.4g}, which points {}, expected a direction away from the ground "
          "in the camera frame (x right, y down, z forward), about 0 -1 0 for a level camera",
          up.x(), up.y(), up.z(), wrong));
    }
    return up;
  }

  SceneFrame read_frame(const JsonCursor& cursor) {
    JsonObject object(cursor, "a frame {\"id\", \"image\", ...}");
    SceneFrame out;
    out.id = read_id(object);
    claim_id(frame_ids_, out.id, cursor, "frames");
    if (auto v = object.find("time_s")) out.time_s = v->number("a number of seconds");
    if (auto v = object.find("image")) out.image = resolve(*v);
    if (auto v = object.find("segmentation")) out.segmentation = resolve(*v);
    if (auto v = object.find("road_mask")) out.road_mask = resolve(*v);
    if (auto v = object.find("ego_plane")) out.ego_plane = read_plane(*v, true);
    if (auto v = object.find("world_from_camera")) out.world_from_camera = v->pose();
    if (auto v = object.find("up")) out.up = read_up(*v);
    if (auto v = object.find("up_sigma_deg")) {
      out.up_sigma = v->positive("a positive number of degrees") * kRadians;
    }
    if (auto v = object.find("speed")) {
      out.speed = v->in_range(0.0, kMaxSpeed, "a speed from 0 to 1000 m/s");
      out.speed_sigma = default_speed_sigma(*out.speed);
    }
    if (auto v = object.find("speed_sigma")) {
      out.speed_sigma = v->positive("a positive number of m/s");
    }
    if (auto v = object.find("gnss")) out.map_position = read_map_position(*v);
    if (auto v = object.find("vehicles")) {
      std::set<int> seen;
      const auto vehicles = v->items("an array of vehicles");
      if (vehicles.size() > kMostVehiclesPerFrame) {
        v->fail(fmt::format("at most {} vehicles a frame", kMostVehiclesPerFrame));
      }
      for (const JsonCursor& vehicle : vehicles) {
        out.vehicles.push_back(read_detection(vehicle, seen));
      }
    }
    object.note_unknown_keys();
    return out;
  }

  SceneTruth read_truth(const JsonCursor& cursor, const Scene& scene) {
    JsonObject object(cursor, "an object with the ground truth");
    SceneTruth out;
    if (auto v = object.find("frames")) {
      std::set<int> seen;
      for (const JsonCursor& frame : v->items("an array of frames")) {
        out.frames.push_back(read_truth_frame(frame, scene, seen));
      }
      std::sort(out.frames.begin(), out.frames.end(),
                [](const TruthFrame& a, const TruthFrame& b) { return a.id < b.id; });
    }
    if (auto v = object.find("vehicles_source")) out.vehicles_source = v->text();
    if (auto v = object.find("cloud")) out.cloud = resolve(*v);
    if (auto v = object.find("cloud_frame")) {
      out.cloud_frame = v->integer(0, kMaxId, "a frame id");
      if (!scene.find_frame(*out.cloud_frame)) v->fail("the id of one of the frames");
    }
    object.note_unknown_keys();
    return out;
  }

  TruthFrame read_truth_frame(const JsonCursor& cursor, const Scene& scene, std::set<int>& seen) {
    JsonObject object(cursor, "a frame of the truth {\"id\", ...}");
    TruthFrame out;
    out.id = read_id(object);
    claim_id(seen, out.id, cursor, "frames of the truth");
    if (warn_ && !scene.find_frame(out.id)) {
      warn_(fmt::format("{}: {}: frame {} is not among the scene's frames", context_.file,
                        cursor.path(), out.id));
    }
    if (auto v = object.find("world_from_camera")) out.world_from_camera = v->pose();
    if (auto v = object.find("ego_plane")) out.ego_plane = read_plane(*v, true);
    if (auto v = object.find("depth")) out.depth = resolve(*v);
    if (auto v = object.find("depth_encoding")) {
      out.depth_encoding = v->text();
      if (out.depth_encoding != "kitti" && out.depth_encoding != "synthia") {
        v->fail("\"kitti\" or \"synthia\"");
      }
    }
    if (!out.depth.empty() && out.depth_encoding.empty()) {
      object.require("depth_encoding", "\"kitti\" or \"synthia\" beside a depth image");
    }
    if (auto v = object.find("label")) out.label = resolve(*v);
    if (auto v = object.find("vehicles")) {
      std::set<int> vehicle_ids;
      for (const JsonCursor& vehicle : v->items("an array of vehicles")) {
        out.vehicles.push_back(read_truth_vehicle(vehicle, vehicle_ids));
      }
    }
    object.note_unknown_keys();
    return out;
  }

  void warn_about_segmentation(const Scene& scene) const {
    if (!warn_ || scene.segmentation_classes.count("road")) return;
    for (const SceneFrame& frame : scene.frames) {
      if (frame.segmentation.empty()) continue;
      warn_(
          fmt::format("{}: segmentation_classes: no \"road\" is named, so the segmentation images "
                      "cannot show the road",
                      context_.file));
      return;
    }
  }

  fs::path folder_, real_folder_;
  const json& document_;
  const LogSink& warn_;
  ScenePaths paths_;
  JsonContext context_;
  std::set<int> frame_ids_;
};

json plane_json(const Plane& plane) {
  return {{"normal", vector_json(plane.normal)}, {"offset", number_json(plane.offset)}};
}

json intrinsics_json(const PinholeCamera& camera) {
  return {{"width", camera.width},        {"height", camera.height},
          {"fx", number_json(camera.fx)}, {"fy", number_json(camera.fy)},
          {"cx", number_json(camera.cx)}, {"cy", number_json(camera.cy)}};
}

json box_json(const Box2& box) {
  return json::array(
      {number_json(box.x1), number_json(box.y1), number_json(box.x2), number_json(box.y2)});
}

/// A path as the manifest has it: relative to its folder, so that both can be moved together, else
/// absolute. The folders are followed through links, as whoever opens the path will.
std::string manifest_path(const fs::path& path, const fs::path& folder) {
  std::error_code error;
  fs::path whole = fs::absolute(path).lexically_normal();
  const fs::path real = fs::weakly_canonical(whole.parent_path(), error);
  if (!error) whole = real / whole.filename();
  const fs::path relative = whole.lexically_relative(folder);
  const std::string name = (relative.empty() ? whole : relative).generic_string();
  try {
    (void)json(name).dump();
  } catch (const json::type_error&) {
    throw InputError(path.string(),
                     "the name is not valid UTF-8, expected one that a manifest can hold");
  }
  return name;
}

json detection_json(const VehicleDetection& vehicle) {
  json out = {{"id", vehicle.id},
              {"class", vehicle.vehicle_class},
              {"box", box_json(vehicle.box)},
              {"score", number_json(vehicle.score)}};
  if (vehicle.track >= 0) out["track"] = vehicle.track;
  if (!vehicle.keypoints.empty()) {
    json rows = json::array();
    for (const KeypointObservation& k : vehicle.keypoints) {
      rows.push_back(json::array(
          {number_json(k.pixel.x()), number_json(k.pixel.y()), number_json(k.confidence)}));
    }
    out["keypoints"] = std::move(rows);
    const auto stated = [](const KeypointObservation& k) { return std::isfinite(k.sigma); };
    if (std::any_of(vehicle.keypoints.begin(), vehicle.keypoints.end(), stated)) {
      json sigmas = json::array();
      for (const KeypointObservation& k : vehicle.keypoints) sigmas.push_back(number_json(k.sigma));
      out["keypoint_sigmas_px"] = std::move(sigmas);
    }
  }
  if (vehicle.has_plane) out["plane"] = plane_json(vehicle.given_plane);
  return out;
}

json truth_vehicle_json(const TruthVehicle& vehicle) {
  const Dimensions& size = vehicle.pose.dimensions;
  json out = {{"id", vehicle.id},
              {"class", vehicle.vehicle_class},
              {"box", box_json(vehicle.box)},
              {"bottom_center", vector_json(vehicle.pose.bottom_center())},
              {"rotation", matrix_json(vehicle.pose.camera_from_vehicle.rotation_matrix())},
              {"dimensions",
               {{"length", number_json(size.length)},
                {"width", number_json(size.width)},
                {"height", number_json(size.height)}}},
              {"moving", vehicle.moving},
              {"occlusion", number_json(vehicle.occlusion)},
              {"truncation", number_json(vehicle.truncation)}};
  if (!vehicle.uncertain.empty()) out["uncertain"] = vehicle.uncertain;
  if (vehicle.plane) out["plane"] = plane_json(*vehicle.plane);
  if (!vehicle.keypoints.empty()) {
    json rows = json::array();
    for (const Eigen::Vector3d& k : vehicle.keypoints) rows.push_back(vector_json(k));
    out["keypoints"] = std::move(rows);
  }
  return out;
}

/// A whole number of a --frames list.
int parse_frame_number(const std::string& text, const std::string& list) {
  int value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size() || text.empty()) {
    throw UsageError(
        fmt::format("--frames {}: found '{}', expected frame ids like 48,49,50 or 48:52 "
                    "or 0:10:5",
                    printable(list), printable(text)));
  }
  return value;
}

std::vector<std::string> split(const std::string& text, char separator) {
  std::vector<std::string> parts(1);
  for (const char c : text) {
    if (c == separator) {
      parts.emplace_back();
    } else {
      parts.back() += c;
    }
  }
  return parts;
}

}  // namespace

double time_of(const SceneFrame& frame, double frame_rate) {
  return frame.time_s.value_or(frame.id / frame_rate);
}

double default_speed_sigma(double speed) { return std::max(0.1, 0.02 * speed); }

const SceneFrame* Scene::find_frame(int id) const {
  const auto at =
      std::lower_bound(frames.begin(), frames.end(), id,
                       [](const SceneFrame& frame, int value) { return frame.id < value; });
  return at != frames.end() && at->id == id ? &*at : nullptr;
}

Scene read_scene(const fs::path& path, const LogSink& warn, ScenePaths paths) {
  if (const InputKind kind = kind_of_input(path); kind != InputKind::kScene) {
    const char* found = kind == InputKind::kVideo    ? "a film"
                        : kind == InputKind::kImages ? "a folder of images"
                                                     : "a bag";
    throw InputError(path.string(),
                     fmt::format("found {}, expected a scene manifest (scene.json): camber import "
                                 "{} {} --height METRES --out scene makes one",
                                 found, to_string(kind), printable(path.string(), 120)));
  }
  std::error_code error;
  const fs::path manifest = fs::is_directory(path, error) ? path / "scene.json" : path;
  const json document = parse_json(read_whole_file(manifest), manifest.string());
  return ManifestReader(manifest, document, warn, paths).read();
}

void write_scene(const Scene& scene, const fs::path& path) {
  std::error_code error;
  const fs::path stated = fs::absolute(path).lexically_normal().parent_path();
  const fs::path real = fs::weakly_canonical(stated, error);
  const fs::path& folder = error ? stated : real;
  json out = {{"format", kFormat}, {"version", kFormatVersion}};
  if (!scene.name.empty()) out["name"] = scene.name;
  out["camera"] = intrinsics_json(scene.camera);
  if (scene.distortion.model != LensModel::kNone) {
    json& lens = out["camera"]["distortion"];
    lens["model"] = to_string(scene.distortion.model);
    lens["coefficients"] = scene.distortion.coefficients;
    lens["raw"] = intrinsics_json(scene.distortion.raw);
  }
  if (scene.height_above_road) {
    out["camera"]["height_above_road"] = *scene.height_above_road;
    if (scene.height_sigma != Scene().height_sigma) {
      out["camera"]["height_sigma"] = scene.height_sigma;
    }
  }
  for (const auto& [key, sigma] : {std::pair{"focal_sigma", scene.camera_sigma.focal},
                                   std::pair{"principal_sigma", scene.camera_sigma.principal},
                                   std::pair{"distortion_sigma", scene.camera_sigma.distortion}}) {
    if (sigma > 0.0) out["camera"][key] = sigma;
  }
  if (scene.frame_rate) out["frame_rate"] = *scene.frame_rate;
  if (scene.reference_frame) out["reference_frame"] = *scene.reference_frame;
  if (!scene.detections_source.empty()) out["detections_source"] = scene.detections_source;
  if (scene.box_sigma_px) out["box_sigma_px"] = number_json(*scene.box_sigma_px);
  if (!scene.segmentation_classes.empty()) out["segmentation_classes"] = scene.segmentation_classes;
  if (!scene.segmentation_source.empty()) out["segmentation_source"] = scene.segmentation_source;
  if (!scene.markings_m.empty()) out["markings_m"] = scene.markings_m;
  if (!scene.map_crs.empty()) {
    out["gnss"] = {{"crs", scene.map_crs}, {"antenna", vector_json(scene.antenna)}};
  }

  json frames = json::array();
  for (const SceneFrame& frame : scene.frames) {
    json f = {{"id", frame.id}};
    if (frame.time_s) f["time_s"] = number_json(*frame.time_s);
    if (!frame.image.empty()) f["image"] = manifest_path(frame.image, folder);
    if (!frame.segmentation.empty()) f["segmentation"] = manifest_path(frame.segmentation, folder);
    if (!frame.road_mask.empty()) f["road_mask"] = manifest_path(frame.road_mask, folder);
    if (frame.ego_plane) f["ego_plane"] = plane_json(*frame.ego_plane);
    if (frame.world_from_camera)
      f["world_from_camera"] = matrix_json(frame.world_from_camera->matrix());
    if (frame.up) {
      f["up"] = vector_json(*frame.up);
      f["up_sigma_deg"] = number_json(frame.up_sigma / kRadians);
    }
    if (frame.speed) {
      f["speed"] = number_json(*frame.speed);
      f["speed_sigma"] = number_json(frame.speed_sigma);
    }
    if (frame.map_position) f["gnss"] = map_position_json(*frame.map_position);
    if (!frame.vehicles.empty()) {
      json vehicles = json::array();
      for (const VehicleDetection& vehicle : frame.vehicles)
        vehicles.push_back(detection_json(vehicle));
      f["vehicles"] = std::move(vehicles);
    }
    frames.push_back(std::move(f));
  }
  out["frames"] = std::move(frames);

  if (scene.truth) {
    json truth = json::object();
    json truth_frames = json::array();
    for (const TruthFrame& frame : scene.truth->frames) {
      json f = {{"id", frame.id}};
      if (frame.world_from_camera)
        f["world_from_camera"] = matrix_json(frame.world_from_camera->matrix());
      if (frame.ego_plane) f["ego_plane"] = plane_json(*frame.ego_plane);
      if (!frame.depth.empty()) {
        f["depth"] = manifest_path(frame.depth, folder);
        f["depth_encoding"] = frame.depth_encoding;
      }
      if (!frame.label.empty()) f["label"] = manifest_path(frame.label, folder);
      if (!frame.vehicles.empty()) {
        json vehicles = json::array();
        for (const TruthVehicle& v : frame.vehicles) vehicles.push_back(truth_vehicle_json(v));
        f["vehicles"] = std::move(vehicles);
      }
      truth_frames.push_back(std::move(f));
    }
    truth["frames"] = std::move(truth_frames);
    if (!scene.truth->vehicles_source.empty()) {
      truth["vehicles_source"] = scene.truth->vehicles_source;
    }
    if (!scene.truth->cloud.empty()) truth["cloud"] = manifest_path(scene.truth->cloud, folder);
    if (scene.truth->cloud_frame) truth["cloud_frame"] = *scene.truth->cloud_frame;
    out["truth"] = std::move(truth);
  }
  write_file_atomically(path, format_json(out));
}

std::vector<int> select_frames(const Scene& scene, const std::string& list) {
  std::set<int> ids;
  if (list.empty() || list == "all") {
    for (const SceneFrame& frame : scene.frames) ids.insert(frame.id);
    return {ids.begin(), ids.end()};
  }
  const auto add = [&](int id) {
    if (!scene.find_frame(id)) {
      throw UsageError(
          fmt::format("--frames {}: frame {} is not in the scene, expected ids from {} to {}",
                      printable(list), id, scene.frames.empty() ? 0 : scene.frames.front().id,
                      scene.frames.empty() ? 0 : scene.frames.back().id));
    }
    ids.insert(id);
  };
  for (const std::string& part : split(list, ',')) {
    const std::vector<std::string> ends = split(part, ':');
    if (ends.size() == 1) {
      add(parse_frame_number(part, list));
      continue;
    }
    const int first = parse_frame_number(ends[0], list);
    const int last = parse_frame_number(ends[1], list);
    const int step = ends.size() == 3 ? parse_frame_number(ends[2], list) : 1;
    if (ends.size() > 3 || step <= 0 || first > last) {
      throw UsageError(
          fmt::format("--frames {}: found '{}', expected FIRST:LAST or FIRST:LAST:STEP with "
                      "FIRST <= LAST and STEP >= 1",
                      printable(list), printable(part)));
    }
    for (long long id = first; id <= last; id += step) add(static_cast<int>(id));
  }
  return {ids.begin(), ids.end()};
}

int choose_reference_frame(const Scene& scene, const std::vector<int>& ids) {
  if (ids.empty())
    throw std::invalid_argument("choose_reference_frame: ids is empty, expected at least 1");
  if (scene.reference_frame &&
      std::find(ids.begin(), ids.end(), *scene.reference_frame) != ids.end()) {
    return *scene.reference_frame;
  }
  return ids[ids.size() / 2];
}

}  // namespace camber
