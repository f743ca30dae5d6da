#include "camber/scene/results.h"

#include <cmath>
#include <limits>
#include <set>

#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "camber/core/version.h"
#include "camber/scene/json_reader.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

using nlohmann::json;

constexpr double kPi = 3.14159265358979323846;
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr int kMaxId = 2000000000;

double to_degrees(double radians) { return radians * 180.0 / kPi; }
double to_radians(double degrees) { return degrees * kPi / 180.0; }

json points_json(const std::vector<Eigen::Vector3d>& points) {
  json out = json::array();
  for (const Eigen::Vector3d& p : points) out.push_back(vector_json(p));
  return out;
}

json counts_json(const std::vector<std::pair<std::string, long>>& counts) {
  json out = json::object();
  for (const auto& [name, count] : counts) out[name] = count;
  return out;
}

json vehicle_json(const VehicleEstimate& vehicle) {
  const OrientedBox& pose = vehicle.pose;
  const Eigen::Matrix3d rotation = pose.camera_from_vehicle.rotation_matrix();
  json keypoints = json::array();
  for (const Eigen::Vector3d& k : vehicle.keypoints) keypoints.push_back(vector_json(k));
  json covariance = json::array();
  for (int r = 0; r < 9; ++r) {
    for (int c = 0; c < 9; ++c) covariance.push_back(number_json(vehicle.covariance(r, c)));
  }
  json shape = json::array();
  for (const double v : vehicle.shape) shape.push_back(number_json(v));
  json out = {{"id", vehicle.id},
              {"class", vehicle.vehicle_class},
              {"box", json::array({number_json(vehicle.box.x1), number_json(vehicle.box.y1),
                                   number_json(vehicle.box.x2), number_json(vehicle.box.y2)})},
              {"status", to_string(vehicle.status)},
              {"reason", vehicle.reason},
              {"center", vector_json(pose.center())},
              {"bottom_center", vector_json(pose.bottom_center())},
              {"rotation", matrix_json(rotation)},
              {"rotation_y", number_json(rotation_y(rotation))},
              {"dimensions",
               {{"length", number_json(pose.dimensions.length)},
                {"width", number_json(pose.dimensions.width)},
                {"height", number_json(pose.dimensions.height)}}},
              {"keypoints", std::move(keypoints)},
              {"plane",
               {{"normal", vector_json(vehicle.plane.normal)},
                {"offset", number_json(vehicle.plane.offset)},
                {"sigma_height", number_json(vehicle.plane_sigma_height)},
                {"source", vehicle.plane_source}}},
              {"shape", std::move(shape)},
              {"covariance", std::move(covariance)},
              {"reprojection_rmse_px", number_json(vehicle.reprojection_rmse_px)}};
  if (vehicle.track >= 0) out["track"] = vehicle.track;
  // A document without the plane of an answered vehicle stays one; an unknown offset is refused.
  if (std::isnan(vehicle.plane.offset) && vehicle.plane_source.empty()) out.erase("plane");
  return out;
}

/// Reads one result file; what is absent keeps its default unless it is required.
class ResultReader {
 public:
  explicit ResultReader(const fs::path& path)
      : document_(parse_json(read_whole_file(path), path.string())) {
    context_.file = path.string();
  }
  JsonCursor root() { return JsonCursor(document_, context_); }
  const json& document() const { return document_; }

 private:
  json document_;
  JsonContext context_;
};

constexpr char kStatusWords[] = "\"ok\", \"weak\", \"not_observable\", \"failed\" or \"not_run\"";

Status status_at(const JsonCursor& cursor) {
  try {
    return status_from_string(cursor.text(kStatusWords));
  } catch (const std::invalid_argument&) {
    cursor.fail(kStatusWords);
  }
}

Status read_status(JsonObject& object) { return status_at(object.require("status", kStatusWords)); }

/// Whether an estimate with this status must be complete.
bool has_answer(Status status) { return status != Status::kFailed && status != Status::kNotRun; }

/// A unit vector; without an answer nulls are taken too.
Eigen::Vector3d read_direction(const JsonCursor& cursor, bool complete) {
  if (complete) return cursor.unit_vector();
  const Eigen::Vector3d v = cursor.vector3("3 numbers [x, y, z]", true);
  return v.allFinite() && !v.isZero() ? cursor.unit_vector() : v;
}

double read_number(const JsonCursor& cursor, bool complete) {
  return complete ? cursor.number() : cursor.number_or_null();
}

double find_number(JsonObject& object, const char* key, double otherwise) {
  const auto v = object.find(key);
  return v ? v->number() : otherwise;
}

bool find_boolean(JsonObject& object, const char* key, bool otherwise) {
  const auto v = object.find(key);
  return v ? v->boolean() : otherwise;
}

std::string find_text(JsonObject& object, const char* key) {
  const auto v = object.find(key);
  return v ? v->text() : std::string();
}

std::vector<Eigen::Vector3d> find_points(JsonObject& object, const char* key) {
  std::vector<Eigen::Vector3d> out;
  if (const auto v = object.find(key)) {
    for (const JsonCursor& point : v->items("an array of points [x, y, z]")) {
      out.push_back(point.vector3());
    }
  }
  return out;
}

int require_id(JsonObject& object, const char* key) {
  return object.require(key, "an integer id").integer(-1, kMaxId, "an integer id");
}

/// The id of one of several things, which no other of them may have.
int require_new_id(JsonObject& object, const std::string& among, std::set<int>* known) {
  const JsonCursor cursor = object.require("id", "an integer id");
  const int id = cursor.integer(-1, kMaxId, "an integer id");
  if (!known->insert(id).second) {
    cursor.fail_because("found " + std::to_string(id) +
                        " a second time, expected ids that differ among the " + among);
  }
  return id;
}

/// @param covariance  size x size numbers, row by row; NaN is taken.
void refuse_negative_variances(const JsonCursor& cursor, const std::vector<double>& covariance,
                               std::size_t size) {
  for (std::size_t i = 0; i < size; ++i) {
    const double variance = covariance[i * (size + 1)];
    if (variance < 0.0) {
      cursor.fail_because("found the variance " + number_json(variance).dump() +
                          ", expected numbers of at least 0 on the diagonal");
    }
  }
}

json plane_json(const UncertainPlane& plane) {
  return {
      {"normal", vector_json(plane.plane.normal)}, {"offset", number_json(plane.plane.offset)},
      {"centroid", vector_json(plane.centroid)},   {"axis1", vector_json(plane.axis1)},
      {"axis2", vector_json(plane.axis2)},         {"covariance", matrix_json(plane.covariance)}};
}

UncertainPlane read_plane(JsonObject& object, bool complete) {
  const char* unit = "a unit vector [x, y, z]";
  UncertainPlane out;
  out.plane.normal = read_direction(object.require("normal", unit), complete);
  const auto offset = object.find("offset");
  if (!offset && complete) object.require("offset", "a number of metres");
  out.plane.offset = offset ? read_number(*offset, complete) : kNaN;
  out.centroid =
      object.require("centroid", "3 numbers [x, y, z]").vector3("3 numbers [x, y, z]", !complete);
  out.axis1 = read_direction(object.require("axis1", unit), complete);
  out.axis2 = read_direction(object.require("axis2", unit), complete);
  const JsonCursor covariance = object.require("covariance", "9 numbers");
  const std::vector<double> c = covariance.numbers(9, "9 numbers", true);
  refuse_negative_variances(covariance, c, 3);
  out.covariance = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(c.data());
  return out;
}

PlanePatch read_patch(const JsonCursor& cursor, std::set<int>* ids) {
  JsonObject object(cursor, "a patch {\"id\", \"normal\", ...}");
  PlanePatch out;
  out.id = require_new_id(object, "patches", ids);
  out.status = read_status(object);
  out.reason = find_text(object, "reason");
  const bool complete = has_answer(out.status);
  if (const auto v = object.find("kind")) {
    const std::string& word = v->text();
    if (word == "road") {
      out.kind = PatchKind::kRoad;
    } else if (word == "pavement") {
      out.kind = PatchKind::kPavement;
    } else if (word == "ground") {
      out.kind = PatchKind::kGround;
    } else if (word == "other") {
      out.kind = PatchKind::kOther;
    } else {
      v->fail("\"road\", \"pavement\", \"ground\" or \"other\"");
    }
  }
  out.plane = read_plane(object, complete);
  if (const auto v = object.find("inliers")) out.inliers = v->integer(0, kMaxId, "a count");
  out.boundary = find_points(object, "boundary");
  if (const auto v = object.find("grade_deg")) out.grade = to_radians(v->number());
  if (const auto v = object.find("bank_deg")) out.bank = to_radians(v->number());
  out.refinement = find_text(object, "refinement");
  if (const auto v = object.find("unmodelled_sigma")) {
    out.unmodelled_sigma = v->in_range(0.0, 1e6, "a length of at least 0 m");
  }
  if (const auto v = object.find("without_vehicle")) {
    JsonObject alone(*v, "a plane {\"normal\", \"offset\", ...}");
    out.without_vehicle = read_plane(alone, true);
  }
  return out;
}

PatchLink read_link(const JsonCursor& cursor) {
  JsonObject object(cursor, "a link {\"a\", \"b\", ...}");
  PatchLink out;
  out.a = require_id(object, "a");
  out.b = require_id(object, "b");
  out.valid = find_boolean(object, "valid", true);
  out.reason = find_text(object, "reason");
  out.weight = find_number(object, "weight", kNaN);
  out.distance = find_number(object, "distance", kNaN);
  out.height_step = find_number(object, "height_step", kNaN);
  out.angle = to_radians(find_number(object, "angle_deg", kNaN));
  const auto residual = object.find("residual_sigma");
  out.residual_sigma = residual ? residual->number_or_null() : kNaN;
  return out;
}

VehicleEstimate read_vehicle(const JsonCursor& cursor, std::set<int>* ids) {
  JsonObject object(cursor, "a vehicle {\"id\", \"status\", ...}");
  VehicleEstimate out;
  out.id = require_new_id(object, "vehicles of a frame", ids);
  out.vehicle_class = find_text(object, "class");
  if (const auto v = object.find("track")) out.track = v->integer(0, kMaxId, "a track number");
  out.status = read_status(object);
  out.reason = find_text(object, "reason");
  const bool complete = has_answer(out.status);
  const std::vector<double> box = object.require("box", "4 numbers [x1, y1, x2, y2]")
                                      .numbers(4, "4 [x1, y1, x2, y2]", !complete);
  out.box = {box[0], box[1], box[2], box[3]};

  const JsonCursor bottom = object.require("bottom_center", "3 numbers [x, y, z]");
  const Eigen::Vector3d translation = bottom.vector3("3 numbers [x, y, z]", !complete);
  const auto rotation = object.find("rotation");
  const auto yaw = object.find("rotation_y");
  Eigen::Matrix3d r = Eigen::Matrix3d::Identity();
  if (rotation) {
    const std::vector<double> v = rotation->numbers(9, "9 numbers", !complete);
    bool finite = true;
    for (const double x : v) finite = finite && std::isfinite(x);
    r = finite ? rotation->rotation() : Eigen::Matrix3d::Constant(kNaN);
  } else if (yaw) {
    r = rotation_from_rotation_y(yaw->number());
  } else if (complete) {
    object.require("rotation", "9 numbers (camera_from_vehicle row by row), or a rotation_y");
  }
  out.pose.camera_from_vehicle = SE3(r, translation);
  JsonObject size(object.require("dimensions", "{\"length\", \"width\", \"height\"} in metres"));
  const auto side = [&](const char* key) {
    const auto v = size.find(key);
    if (!v && complete) size.require(key, "a number of metres");
    return v ? v->number() : kNaN;
  };
  out.pose.dimensions = {side("length"), side("width"), side("height")};

  if (const auto v = object.find("keypoints")) {
    const std::string expectation = std::to_string(kNumKeypoints) + " rows [x, y, z]";
    const std::vector<JsonCursor> rows = v->items(expectation.c_str());
    if (rows.size() != out.keypoints.size()) {
      v->fail_because("found " + std::to_string(rows.size()) + " rows, expected " + expectation);
    }
    for (std::size_t i = 0; i < rows.size(); ++i) {
      out.keypoints[i] = rows[i].vector3("3 numbers [x, y, z]", true);
    }
  }
  if (const auto v = object.find("plane")) {
    JsonObject plane(*v, "a plane {\"normal\", \"offset\", \"sigma_height\", \"source\"}");
    out.plane.normal = read_direction(plane.require("normal", "a unit vector [x, y, z]"), complete);
    const auto offset = plane.find("offset");
    if (!offset && complete) plane.require("offset", "a number of metres");
    out.plane.offset = offset ? offset->number() : kNaN;
    out.plane_sigma_height = find_number(plane, "sigma_height", kNaN);
    out.plane_source = find_text(plane, "source");
  } else {
    out.plane.offset = kNaN;
  }
  if (const auto v = object.find("shape")) {
    for (const JsonCursor& item : v->items("an array of numbers")) {
      out.shape.push_back(item.number_or_null());
    }
  }
  if (const auto v = object.find("covariance")) {
    const std::vector<double> c = v->numbers(81, "81 numbers", true);
    refuse_negative_variances(*v, c, 9);
    out.covariance = Eigen::Map<const Eigen::Matrix<double, 9, 9, Eigen::RowMajor>>(c.data());
  }
  out.reprojection_rmse_px = find_number(object, "reprojection_rmse_px", kNaN);
  return out;
}

ConstraintReport read_constraint(const JsonCursor& cursor) {
  JsonObject object(cursor, "a constraint {\"name\", \"source\", \"residual_sigma\", ...}");
  ConstraintReport out;
  out.name = object.require("name", "a word").text();
  out.source = find_text(object, "source");
  const auto residual = object.find("residual_sigma");
  out.residual_sigma = residual ? residual->number_or_null() : kNaN;
  out.accepted = find_boolean(object, "accepted", false);
  out.reason = find_text(object, "reason");
  return out;
}

std::vector<std::pair<std::string, long>> read_counts(const JsonCursor& cursor) {
  JsonObject object(cursor, "an object of counts");
  std::vector<std::pair<std::string, long>> out;
  for (const auto& [name, value] : object.entries()) {
    out.emplace_back(name, static_cast<long>(value.in_range(0, 1e15, "a count")));
  }
  return out;
}

}  // namespace

json to_json(const PlanePatch& patch) {
  json out = {{"id", patch.id},
              {"kind", to_string(patch.kind)},
              {"status", to_string(patch.status)},
              {"reason", patch.reason},
              {"inliers", patch.inliers},
              {"boundary", points_json(patch.boundary)},
              {"grade_deg", number_json(to_degrees(patch.grade))},
              {"bank_deg", number_json(to_degrees(patch.bank))},
              {"refinement", patch.refinement}};
  out.update(plane_json(patch.plane));
  if (patch.unmodelled_sigma > 0.0) out["unmodelled_sigma"] = patch.unmodelled_sigma;
  if (patch.without_vehicle) out["without_vehicle"] = plane_json(*patch.without_vehicle);
  return out;
}

json to_json(const RoadSurface& surface) {
  json patches = json::array(), links = json::array();
  for (const PlanePatch& patch : surface.patches) patches.push_back(to_json(patch));
  for (const PatchLink& link : surface.links) {
    links.push_back({{"a", link.a},
                     {"b", link.b},
                     {"valid", link.valid},
                     {"reason", link.reason},
                     {"weight", number_json(link.weight)},
                     {"distance", number_json(link.distance)},
                     {"height_step", number_json(link.height_step)},
                     {"angle_deg", number_json(to_degrees(link.angle))}});
    if (std::isfinite(link.residual_sigma)) {
      links.back()["residual_sigma"] = number_json(link.residual_sigma);
    }
  }
  json out = {{"frame", surface.frame},
              {"up", vector_json(surface.up)},
              {"level", to_string(surface.level)},
              {"metric", surface.metric},
              {"scale_sigma", number_json(surface.scale_sigma)},
              {"ego_patch", surface.ego_patch},
              {"patches", std::move(patches)},
              {"links", std::move(links)},
              {"driven_line", points_json(surface.driven_line)}};
  if (surface.level_sigma > 0.0) {
    out["level_sigma_deg"] = number_json(to_degrees(surface.level_sigma));
  }
  return out;
}

json to_json(const VehicleDocument& document) {
  json frames = json::array();
  for (const VehicleFrame& frame : document.frames) {
    json vehicles = json::array();
    for (const VehicleEstimate& vehicle : frame.vehicles) vehicles.push_back(vehicle_json(vehicle));
    frames.push_back({{"id", frame.id}, {"vehicles", std::move(vehicles)}});
  }
  json out = {{"method", document.method},
              {"detections_source", document.detections_source},
              {"metric", document.metric},
              {"frames", std::move(frames)}};
  if (!document.preset.empty()) out["preset"] = document.preset;
  if (!document.paper_terms.empty()) out["paper_terms"] = document.paper_terms;
  if (document.keypoint_set > 0) out["keypoint_set"] = document.keypoint_set;
  return out;
}

json to_json(const RunDocument& document) {
  json out = document.extra->is_object() ? *document.extra : json::object();
  json timings = json::object();
  for (const auto& [stage, milliseconds] : document.timings.stages()) {
    timings[stage] = number_json(milliseconds);
  }
  json cameras = json::array(), inputs = json::array();
  for (const RunDocument::CameraPose& camera : document.cameras) {
    cameras.push_back(
        {{"id", camera.id},
         {"reference_from_camera", matrix_json(camera.reference_from_camera.matrix())}});
  }
  for (const auto& [path, hash] : document.input_hashes) {
    inputs.push_back({{"path", path}, {"hash", hash}});
  }
  out["version"] = kVersion;
  out["seed"] = document.seed;
  out["options"] = *document.options;
  out["timings_ms"] = std::move(timings);
  out["cameras"] = std::move(cameras);
  out["metric"] = document.metric;
  out["scale"] = number_json(document.scale);
  out["scale_sigma"] = number_json(document.scale_sigma);
  if (document.calibration) {
    const RunDocument::Calibration& c = *document.calibration;
    out["calibration"] = {
        {"focal_sigma", number_json(c.sigma.focal)},
        {"principal_sigma", number_json(c.sigma.principal)},
        {"distortion_sigma", number_json(c.sigma.distortion)},
        {"field_of_view_deg", number_json(to_degrees(c.field_of_view))},
        {"field_of_view_sigma_deg", number_json(to_degrees(c.field_of_view_sigma))},
        {"scale_sigma", number_json(c.sigma_of_scale)}};
  }
  out["scale_status"] = to_string(document.scale_status);
  out["scale_reason"] = document.scale_reason;
  out["scene"] = document.scene;
  out["warnings"] = json::array();
  for (const RunDocument::Warning& warning : document.warnings) {
    out["warnings"].push_back({{"code", warning.code}, {"text", warning.text}});
  }
  out["constraints"] = json::array();
  for (const ConstraintReport& constraint : document.constraints) {
    out["constraints"].push_back({{"name", constraint.name},
                                  {"source", constraint.source},
                                  {"residual_sigma", number_json(constraint.residual_sigma)},
                                  {"accepted", constraint.accepted},
                                  {"reason", constraint.reason}});
  }
  out["points"] = {{"kept", counts_json(document.points_kept)},
                   {"dropped", counts_json(document.points_dropped)}};
  out["gl_backend"] = document.gl_backend;
  out["inputs"] = std::move(inputs);
  return out;
}

RoadSurface read_surface(const fs::path& path) {
  ResultReader reader(path);
  JsonObject object(reader.root(), "an object with patches");
  RoadSurface out;
  if (const auto v = object.find("frame")) out.frame = v->text();
  if (const auto v = object.find("up")) {
    out.up = v->unit_vector();
  } else if (out.frame != "camera") {
    out.up = Eigen::Vector3d::UnitZ();
  }
  out.level = out.frame == "camera" ? RoadSurface::Level::kCamera : RoadSurface::Level::kGravity;
  if (const auto v = object.find("level")) {
    const std::string word = v->text();
    if (word != "camera" && word != "gravity") v->fail("\"gravity\" or \"camera\"");
    out.level = word == "gravity" ? RoadSurface::Level::kGravity : RoadSurface::Level::kCamera;
  }
  if (const auto v = object.find("level_sigma_deg")) {
    out.level_sigma = v->positive("a positive number of degrees") * kPi / 180.0;
  }
  out.metric = find_boolean(object, "metric", true);
  out.scale_sigma = find_number(object, "scale_sigma", kNaN);
  if (const auto v = object.find("ego_patch")) {
    out.ego_patch = v->integer(-1, kMaxId, "a patch id, or -1");
  }
  std::set<int> ids;
  for (const JsonCursor& patch :
       object.require("patches", "an array of patches").items("an array of patches")) {
    out.patches.push_back(read_patch(patch, &ids));
  }
  if (const auto v = object.find("links")) {
    for (const JsonCursor& link : v->items("an array of links"))
      out.links.push_back(read_link(link));
  }
  out.driven_line = find_points(object, "driven_line");
  return out;
}

VehicleDocument read_vehicles(const fs::path& path) {
  ResultReader reader(path);
  JsonObject object(reader.root(), "an object with frames");
  VehicleDocument out;
  out.method = find_text(object, "method");
  out.preset = find_text(object, "preset");
  out.paper_terms = find_text(object, "paper_terms");
  if (const auto v = object.find("keypoint_set")) {
    out.keypoint_set = v->integer(0, kNumKeypoints, "a number of keypoints");
  }
  out.detections_source = find_text(object, "detections_source");
  out.metric = find_boolean(object, "metric", true);
  std::set<int> frame_ids;
  for (const JsonCursor& cursor :
       object.require("frames", "an array of frames").items("an array of frames")) {
    JsonObject frame(cursor, "a frame {\"id\", \"vehicles\"}");
    VehicleFrame read;
    read.id = require_new_id(frame, "frames", &frame_ids);
    std::set<int> ids;
    for (const JsonCursor& vehicle :
         frame.require("vehicles", "an array of vehicles").items("an array of vehicles")) {
      read.vehicles.push_back(read_vehicle(vehicle, &ids));
    }
    out.frames.push_back(std::move(read));
  }
  return out;
}

RunDocument read_run(const fs::path& path) {
  ResultReader reader(path);
  JsonObject object(reader.root(), "an object");
  RunDocument out;
  if (const auto v = object.find("seed")) {
    if (!v->value().is_number_unsigned()) v->fail("an integer of at least 0");
    out.seed = v->value().get<std::uint64_t>();
  }
  if (const auto v = object.find("options")) {
    if (!v->value().is_object()) v->fail("an object");
    out.options = v->value();
  }
  if (const auto v = object.find("timings_ms")) {
    JsonObject timings(*v, "an object of milliseconds");
    for (const auto& [stage, value] : timings.entries()) {
      out.timings.add(stage, value.number_or_null());
    }
  }
  if (const auto v = object.find("cameras")) {
    std::set<int> ids;
    for (const JsonCursor& cursor : v->items("an array of cameras")) {
      JsonObject camera(cursor, "a camera {\"id\", \"reference_from_camera\"}");
      const int id = require_new_id(camera, "cameras", &ids);
      out.cameras.push_back(
          {id, camera.require("reference_from_camera", "16 numbers, row by row").pose()});
    }
  }
  out.metric = find_boolean(object, "metric", true);
  out.scale = find_number(object, "scale", kNaN);
  out.scale_sigma = find_number(object, "scale_sigma", kNaN);
  if (const auto v = object.find("calibration")) {
    JsonObject calibration(*v, "an object {\"focal_sigma\", ...}");
    RunDocument::Calibration c;
    c.sigma.focal = find_number(calibration, "focal_sigma", 0.0);
    c.sigma.principal = find_number(calibration, "principal_sigma", 0.0);
    c.sigma.distortion = find_number(calibration, "distortion_sigma", 0.0);
    c.field_of_view = find_number(calibration, "field_of_view_deg", 0.0) * kPi / 180.0;
    c.field_of_view_sigma = find_number(calibration, "field_of_view_sigma_deg", 0.0) * kPi / 180.0;
    c.sigma_of_scale = find_number(calibration, "scale_sigma", 0.0);
    out.calibration = c;
  }
  if (const auto v = object.find("scale_status")) out.scale_status = status_at(*v);
  out.scale_reason = find_text(object, "scale_reason");
  out.scene = find_text(object, "scene");
  if (const auto v = object.find("warnings")) {
    for (const JsonCursor& cursor : v->items("an array of {\"code\", \"text\"}")) {
      JsonObject warning(cursor, "an object {\"code\", \"text\"}");
      const std::string code = warning.require("code", "a word").text();
      out.warnings.push_back({code, warning.require("text", "a sentence").text()});
    }
  }
  if (const auto v = object.find("constraints")) {
    for (const JsonCursor& cursor : v->items("an array of constraints")) {
      out.constraints.push_back(read_constraint(cursor));
    }
  }
  if (const auto v = object.find("points")) {
    JsonObject points(*v, "an object {\"kept\", \"dropped\"}");
    if (const auto kept = points.find("kept")) out.points_kept = read_counts(*kept);
    if (const auto dropped = points.find("dropped")) out.points_dropped = read_counts(*dropped);
  }
  out.gl_backend = find_text(object, "gl_backend");
  if (const auto v = object.find("inputs")) {
    for (const JsonCursor& cursor : v->items("an array of {\"path\", \"hash\"}")) {
      JsonObject input(cursor, "an object {\"path\", \"hash\"}");
      const std::string input_path = input.require("path", "a path").text();
      out.input_hashes.emplace_back(input_path, input.require("hash", "a hash").text());
    }
  }
  object.find("version");
  for (const auto& [key, value] : reader.document().items()) {
    if (!object.knows(key)) out.extra[key] = value;
  }
  return out;
}

std::filesystem::path road_folder(const std::filesystem::path& folder) {
  std::error_code error;
  const bool of_drive = std::filesystem::exists(folder / "drive.json", error) &&
                        std::filesystem::exists(folder / "surface" / "surface.json", error);
  return of_drive ? folder / "surface" : folder;
}

void write_json(const json& value, const fs::path& path) {
  write_file_atomically(path, format_json(value));
}

}  // namespace camber
