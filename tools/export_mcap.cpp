// camber export --to mcap: a result as JSON messages with Foxglove's schemas.

#include "export_mcap.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "camber/cloud/cloud_io.h"
#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "camber/core/interruption.h"
#include "camber/core/lower_case.h"
#include "camber/core/read_file.h"
#include "camber/export/foxglove.h"
#include "camber/image/image_io.h"
#include "camber/image/video.h"
#include "camber/import/import_own.h"
#include "camber/scene/drive_document.h"
#include "camber/scene/georeference.h"
#include "camber/scene/json_reader.h"
#include "camber/scene/results.h"
#include "camber/scene/scene_of_run.h"
#include "crs.h"
#include "own_inputs.h"
#include "plugins/recording_plugin.h"
#include "strip_input.h"

namespace fs = std::filesystem;
using nlohmann::json;

namespace camber::tools {
namespace {

constexpr const char* kWorld = "reference_camera";  // frame of results
constexpr const char* kMap = "map";
constexpr const char* kCamera = "camera";

struct Color {
  double r, g, b, a;
};

json to_json(const Eigen::Vector3d& v) { return {{"x", v.x()}, {"y", v.y()}, {"z", v.z()}}; }
json to_json(const Eigen::Quaterniond& q) {
  return {{"x", q.x()}, {"y", q.y()}, {"z", q.z()}, {"w", q.w()}};
}
json to_json(const Color& c) { return {{"r", c.r}, {"g", c.g}, {"b", c.b}, {"a", c.a}}; }
json pose_of(const SE3& pose) {
  return {{"position", to_json(pose.translation())}, {"orientation", to_json(pose.rotation())}};
}
json stamp_of(std::uint64_t ns) { return {{"sec", ns / 1000000000}, {"nsec", ns % 1000000000}}; }

/// Topics by name, made when the first message comes.
class Topics {
 public:
  explicit Topics(MessageSink& sink) : sink_(sink) {}

  void write(const std::string& topic, const std::string& schema, std::uint64_t ns,
             const json& message) {
    const std::string text = message.dump(-1, ' ', false, json::error_handler_t::replace);
    sink_.write(channel(topic, schema), ns, text);
    ++counts_[topic];
  }
  json counts() const { return counts_; }

 private:
  std::uint16_t channel(const std::string& topic, const std::string& schema) {
    const auto found = channels_.find(topic);
    if (found != channels_.end()) return found->second;
    auto known = schemas_.find(schema);
    if (known == schemas_.end()) {
      known = schemas_.emplace(schema, sink_.add_schema(schema, foxglove_schema(schema))).first;
    }
    return channels_[topic] = sink_.add_channel(known->second, topic);
  }

  MessageSink& sink_;
  std::map<std::string, std::uint16_t> schemas_, channels_;
  std::map<std::string, std::uint64_t> counts_;
};

/// A frame of the run with the time of its messages.
struct Moment {
  int id = 0;
  std::uint64_t ns = 0;
  SE3 world_from_camera;
  const SceneFrame* frame = nullptr;  // nullptr: the scene is not there
};

/// @param drive  a drive's own frames, whose times count where the scene is gone; or none.
std::vector<Moment> moments_of(const RunDocument& run, const std::optional<Scene>& scene,
                               const std::optional<DriveDocument>& drive) {
  std::vector<Moment> out;
  double first = std::numeric_limits<double>::infinity();
  std::vector<double> times;
  std::map<int, const SceneFrame*> frames;
  if (scene) {
    for (const SceneFrame& frame : scene->frames) frames[frame.id] = &frame;
  }
  std::map<int, double> drive_times;
  if (drive) {
    for (const DriveFrame& frame : drive->frames) {
      if (std::isfinite(frame.time_s)) drive_times[frame.id] = frame.time_s;
    }
  }
  for (const RunDocument::CameraPose& camera : run.cameras) {
    Moment moment;
    moment.id = camera.id;
    moment.world_from_camera = camera.reference_from_camera;
    const auto frame = frames.find(camera.id);
    if (frame != frames.end()) moment.frame = frame->second;
    const auto own = drive_times.find(camera.id);
    // Without times a frame is a tenth of a second.
    const double time = moment.frame != nullptr && (moment.frame->time_s || scene->frame_rate)
                            ? time_of(*moment.frame, scene->frame_rate.value_or(10.0))
                        : own != drive_times.end() ? own->second
                                                   : 0.1 * camera.id;
    times.push_back(time);
    first = std::min(first, time);
    out.push_back(moment);
  }
  for (std::size_t i = 0; i < out.size(); ++i) {
    const double time = first < 0.0 ? times[i] - first : times[i];
    out[i].ns = static_cast<std::uint64_t>(std::llround(1e9 * time));
  }
  std::stable_sort(out.begin(), out.end(),
                   [](const Moment& a, const Moment& b) { return a.ns < b.ns; });
  return out;
}

void write_camera(const Scene& scene, const Moment& moment, Topics& topics) {
  const PinholeCamera& camera =
      scene.distortion.model == LensModel::kNone ? scene.camera : scene.distortion.raw;
  const std::string model = scene.distortion.model == LensModel::kFisheye ? "kannala_brandt"
                            : scene.distortion.coefficients.size() > 5    ? "rational_polynomial"
                                                                          : "plumb_bob";
  std::vector<double> coefficients = scene.distortion.coefficients;
  if (model == "plumb_bob") coefficients.resize(5, 0.0);
  topics.write(
      "/camera/calibration", "foxglove.CameraCalibration", moment.ns,
      {{"timestamp", stamp_of(moment.ns)},
       {"frame_id", kCamera},
       {"width", camera.width},
       {"height", camera.height},
       {"distortion_model", model},
       {"D", coefficients},
       {"K", {camera.fx, 0.0, camera.cx, 0.0, camera.fy, camera.cy, 0.0, 0.0, 1.0}},
       {"R", {1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0}},
       {"P",
        {camera.fx, 0.0, camera.cx, 0.0, 0.0, camera.fy, camera.cy, 0.0, 0.0, 0.0, 1.0, 0.0}}});
}

/// Frames of films in their order, one pass a film. FrameImageReader would load OpenCV.
class FilmFrames {
 public:
  /// @return empty where the film has no such frame. @throws InputError as open_video().
  Image read(const VideoFrameName& name) {
    if (!video_ || file_ != name.file || video_->index() > name.index) {
      video_ = open_video(name.file);
      file_ = name.file;
    }
    while (video_->index() < name.index) {
      if (!video_->next()) return {};
    }
    return video_->image();
  }

 private:
  fs::path file_;
  std::unique_ptr<VideoReader> video_;
};

/// The file of an image as it is, or a frame of a film as JPEG; empty where it is not there.
std::string image_content(const SceneFrame& frame, FilmFrames& film) {
  std::error_code error;
  if (fs::is_regular_file(frame.image, error)) {
    std::string content = read_whole_file(frame.image);
    const bool known =
        content.compare(0, 2, "\xff\xd8") == 0 || content.compare(0, 4, "\x89PNG") == 0;
    return known ? content : std::string();
  }
  const auto name = video_frame_name(frame.image);
  if (!name) return {};
  try {
    const Image image = film.read(*name);
    return image.empty() ? std::string() : encode_jpeg(image);
  } catch (const InputError&) {
    return {};
  }
}

/// @return whether there was an image.
bool write_image(const Moment& moment, FilmFrames& film, Topics& topics) {
  if (moment.frame == nullptr) return false;
  const std::string content = image_content(*moment.frame, film);
  if (content.empty()) return false;
  const bool jpeg = content.compare(0, 2, "\xff\xd8") == 0;
  topics.write("/camera/image", "foxglove.CompressedImage", moment.ns,
               {{"timestamp", stamp_of(moment.ns)},
                {"frame_id", kCamera},
                {"data", base64(content)},
                {"format", jpeg ? "jpeg" : "png"}});
  return true;
}

void write_transform(const std::string& parent, const std::string& child, const SE3& pose,
                     std::uint64_t ns, Topics& topics) {
  topics.write("/tf", "foxglove.FrameTransform", ns,
               {{"timestamp", stamp_of(ns)},
                {"parent_frame_id", parent},
                {"child_frame_id", child},
                {"translation", to_json(pose.translation())},
                {"rotation", to_json(pose.rotation())}});
}

/// @param world_from_cloud  where the cloud's frame is another one than the world.
void write_cloud(const fs::path& file, const SE3& world_from_cloud, std::uint64_t ns,
                 Topics& topics) {
  const RoadCloud cloud = read_cloud(file);
  const bool colors = cloud.colors.size() == cloud.size();
  const bool sigmas = cloud.sigmas.size() == cloud.size();
  std::string data;
  const auto put = [&](float value) {
    char bytes[sizeof value];
    std::memcpy(bytes, &value, sizeof value);
    data.append(bytes, sizeof bytes);
  };
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    for (int axis = 0; axis < 3; ++axis) put(cloud.points[i][axis]);
    if (sigmas) put(cloud.sigmas[i]);
    if (!colors) continue;
    for (const std::uint8_t channel : cloud.colors[i]) data += static_cast<char>(channel);
    data += '\xff';
  }
  constexpr int kUint8 = 1, kFloat32 = 7;  // of Foxglove's NumericType
  json fields = json::array();
  int offset = 0;
  const auto add = [&](const char* name, int type, int size) {
    fields.push_back({{"name", name}, {"offset", offset}, {"type", type}});
    offset += size;
  };
  for (const char* const axis : {"x", "y", "z"}) add(axis, kFloat32, 4);
  if (sigmas) add("sigma", kFloat32, 4);
  if (colors) {
    for (const char* const channel : {"red", "green", "blue", "alpha"}) add(channel, kUint8, 1);
  }
  topics.write(
      "/road/points", "foxglove.PointCloud", ns,
      {{"timestamp", stamp_of(ns)},
       {"frame_id", kWorld},
       {"pose", pose_of(world_from_cloud * SE3(Eigen::Quaterniond::Identity(), cloud.origin))},
       {"point_stride", offset},
       {"fields", fields},
       {"data", base64(data)}});
}

/// A stretch of a drive's road with the moment at which the drive reaches it.
struct Stretch {
  fs::path file;
  double from_s = 0.0;
  std::uint64_t ns = 0;
};

struct StripFiles {
  SE3 world_from_strip;
  std::vector<Stretch> stretches;  ///< in the order of the drive
};

/// @param moments  of the drive's frames, by which places along it have times.
StripFiles strip_of(const fs::path& folder, const DriveDocument& drive,
                    const std::vector<Moment>& moments) {
  const StripIndex index = read_strip_index(folder / "strip");
  StripFiles out;
  out.world_from_strip = index.strip_from_world.inverse();
  std::map<int, double> places;  // s by frame id
  for (const DriveFrame& frame : drive.frames) places[frame.id] = frame.s.value;
  for (const StripIndex::Stretch& part : index.stretches) {
    Stretch stretch;
    stretch.file = part.file;
    stretch.from_s = part.from_s;
    stretch.ns = moments.back().ns;
    for (const Moment& moment : moments) {
      const auto place = places.find(moment.id);
      if (place == places.end() || !(place->second >= stretch.from_s)) continue;
      stretch.ns = moment.ns;
      break;
    }
    out.stretches.push_back(std::move(stretch));
  }
  return out;
}

json entity_of(const std::string& id, const std::string& frame, std::uint64_t ns) {
  json out = {{"timestamp", stamp_of(ns)},
              {"frame_id", frame},
              {"id", id},
              {"lifetime", {{"sec", 0}, {"nsec", 0}}},
              {"frame_locked", true},
              {"metadata", json::array()}};
  for (const char* const list :
       {"arrows", "cubes", "spheres", "cylinders", "lines", "triangles", "texts", "models"}) {
    out[list] = json::array();
  }
  return out;
}

void add_metadata(json& entity, const char* key, const std::string& value) {
  entity["metadata"].push_back({{"key", key}, {"value", value}});
}

/// Outlines of the patches, with their numbers as metadata.
void write_patches(const RoadSurface& surface, std::uint64_t ns, Topics& topics) {
  constexpr int kLoop = 1;  // of Foxglove's LineType
  json entities = json::array();
  for (const PlanePatch& patch : surface.patches) {
    if (patch.status == Status::kFailed || patch.boundary.size() < 3) continue;
    const Color color = patch.kind == PatchKind::kRoad       ? Color{0.35, 0.67, 1.0, 1.0}
                        : patch.kind == PatchKind::kPavement ? Color{0.94, 0.67, 0.35, 1.0}
                        : patch.kind == PatchKind::kGround   ? Color{0.5, 0.8, 0.5, 1.0}
                                                             : Color{0.7, 0.7, 0.7, 1.0};
    json points = json::array();
    for (const Eigen::Vector3d& corner : patch.boundary) points.push_back(to_json(corner));
    json entity = entity_of(fmt::format("patch {}", patch.id), kWorld, ns);
    add_metadata(entity, "kind", std::string(to_string(patch.kind)));
    add_metadata(entity, "grade_deg", fmt::format("{:.3f}", patch.grade * 180.0 / M_PI));
    add_metadata(entity, "bank_deg", fmt::format("{:.3f}", patch.bank * 180.0 / M_PI));
    entity["lines"].push_back({{"type", kLoop},
                               {"pose", pose_of(SE3())},
                               {"thickness", 2.0},
                               {"scale_invariant", true},
                               {"points", points},
                               {"color", to_json(color)},
                               {"colors", json::array()},
                               {"indices", json::array()}});
    entities.push_back(std::move(entity));
  }
  topics.write("/road/patches", "foxglove.SceneUpdate", ns,
               {{"deletions", json::array()}, {"entities", entities}});
}

void write_vehicles(const VehicleDocument& document, const Moment& moment, Topics& topics) {
  constexpr int kAll = 1;  // of Foxglove's SceneEntityDeletionType
  json entities = json::array();
  for (const VehicleFrame& frame : document.frames) {
    if (frame.id != moment.id) continue;
    for (const VehicleEstimate& vehicle : frame.vehicles) {
      if (vehicle.status == Status::kFailed) continue;
      const Dimensions& d = vehicle.pose.dimensions;
      // The vehicle's x is to the front, y up, z to the right.
      const SE3 center(vehicle.pose.camera_from_vehicle.rotation(), vehicle.pose.center());
      json entity =
          entity_of(fmt::format("vehicle {}", vehicle.track >= 0 ? vehicle.track : vehicle.id),
                    kCamera, moment.ns);
      add_metadata(entity, "class", vehicle.vehicle_class);
      add_metadata(entity, "status", std::string(to_string(vehicle.status)));
      entity["cubes"].push_back({{"pose", pose_of(center)},
                                 {"size", {{"x", d.length}, {"y", d.height}, {"z", d.width}}},
                                 {"color", to_json(Color{1.0, 0.5, 0.1, 0.5})}});
      entities.push_back(std::move(entity));
    }
  }
  json deletions = json::array();
  deletions.push_back({{"timestamp", stamp_of(moment.ns)}, {"type", kAll}, {"id", ""}});
  topics.write("/vehicles", "foxglove.SceneUpdate", moment.ns,
               {{"deletions", deletions}, {"entities", entities}});
}

/// Where the cameras are on the earth.
void write_fixes(const std::vector<Moment>& moments, const GeoReference& map, Topics& topics) {
  std::vector<Eigen::Vector2d> places;
  std::vector<double> heights;
  for (const Moment& moment : moments) {
    const Eigen::Vector3d x = map.map_from_reference * moment.world_from_camera.translation();
    places.push_back(x.head<2>());
    heights.push_back(x.z());
  }
  const std::vector<GeoPoint> points = places_on_earth(map.crs, places);
  constexpr int kDiagonal = 2;
  for (std::size_t i = 0; i < moments.size(); ++i) {
    const double plan = std::isfinite(map.position_sigma) ? map.position_sigma : 0.0;
    const double height = std::isfinite(map.height_sigma) ? map.height_sigma : 0.0;
    topics.write("/camera/fix", "foxglove.LocationFix", moments[i].ns,
                 {{"timestamp", stamp_of(moments[i].ns)},
                  {"frame_id", kCamera},
                  {"latitude", points[i].latitude},
                  {"longitude", points[i].longitude},
                  {"altitude", std::isfinite(heights[i]) ? heights[i] : 0.0},
                  {"position_covariance",
                   {plan * plan, 0.0, 0.0, 0.0, plan * plan, 0.0, 0.0, 0.0, height * height}},
                  {"position_covariance_type", plan > 0.0 ? kDiagonal : 0}});
  }
}

}  // namespace

json export_mcap(const CommonOptions& common, const ExportArguments& args, Timings& timings) {
  StageTimer load(timings, "load");
  const fs::path result = args.input, folder = road_folder(result), file = folder / "run.json";
  const RunDocument run = read_run(file);
  if (run.cameras.empty()) throw NoAnswerError(file.string() + ": the run has no camera poses");
  const LogSink warn = make_warning_sink(common);
  std::string missing;
  const std::optional<Scene> scene =
      read_scene_of_run(run, folder, {}, scene_paths(args.confine), &missing);
  if (!missing.empty() && warn) warn(args.input + ": " + missing);
  if (!run.metric && warn) {
    warn(file.string() + ": the run is up to an unknown scale, and so are the positions");
  }
  std::error_code error;
  std::optional<DriveDocument> drive;
  if (fs::exists(result / "drive.json", error)) drive = read_drive(result / "drive.json");
  const std::vector<Moment> moments = moments_of(run, scene, drive);
  StripFiles strip;
  if (drive && fs::exists(result / "strip/index.json", error)) {
    strip = strip_of(result, *drive, moments);
  }
  const std::optional<GeoReference> map = georeference_of(run, file);
  std::optional<RoadSurface> surface;
  if (fs::exists(folder / "surface.json", error)) surface = read_surface(folder / "surface.json");
  std::optional<VehicleDocument> vehicles;
  if (fs::exists(result / "vehicles.json", error)) {
    vehicles = read_vehicles(result / "vehicles.json");
  }
  load.stop();
  StageTimer writing(timings, "write");
  json counts;
  std::size_t without_image = 0;
  write_file_atomically(args.out, [&](std::ostream& out) {
    const std::unique_ptr<MessageSink> sink = make_mcap_sink(out);
    Topics topics(*sink);
    const std::uint64_t start = moments.front().ns;
    if (map) write_transform(kMap, kWorld, map->map_from_reference, start, topics);
    // The road of a drive comes stretch by stretch, as it is driven on.
    const bool at_once = strip.stretches.empty() && fs::exists(folder / "road.ply", error);
    if (at_once) write_cloud(folder / "road.ply", SE3(), start, topics);
    auto stretch = strip.stretches.begin();
    FilmFrames film;
    if (surface) write_patches(*surface, start, topics);
    for (const Moment& moment : moments) {
      throw_if_interrupted();
      write_transform(kWorld, kCamera, moment.world_from_camera, moment.ns, topics);
      if (scene) write_camera(*scene, moment, topics);
      if (!write_image(moment, film, topics)) ++without_image;
      for (; stretch != strip.stretches.end() && stretch->ns <= moment.ns; ++stretch) {
        write_cloud(stretch->file, strip.world_from_strip, moment.ns, topics);
      }
      if (vehicles) write_vehicles(*vehicles, moment, topics);
    }
    if (map && map->known()) write_fixes(moments, *map, topics);
    sink->finish();
    counts = topics.counts();
  });
  writing.stop();
  if (without_image > 0 && warn) {
    warn(fmt::format(
        "{}: {} of {} frames have no image that can be read (PNG, JPEG, film); theirs are left out",
        args.out, without_image, moments.size()));
  }
  return {{"messages", counts},
          {"frames", moments.size()},
          {"metric", run.metric},
          {"geo_reference", map ? map->crs : std::string()}};
}

}  // namespace camber::tools
