// camber lift: yaw-only boxes of any detector put on the road surface.

#include <fmt/format.h>

#include <cstdio>
#include <filesystem>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>

#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "camber/core/lower_case.h"
#include "camber/core/version.h"
#include "camber/import/formats/map_boxes.h"
#include "camber/pipeline/lift_box.h"
#include "camber/pipeline/lift_map_box.h"
#include "camber/scene/json_reader.h"
#include "command.h"
#include "crs.h"
#include "own_inputs.h"
#include "raster_input.h"
#include "road_arguments.h"

namespace camber::tools {
namespace {

namespace fs = std::filesystem;

struct Arguments {
  std::string labels, surface, poses, out;
  std::vector<fs::path> calibration;
  int camera = 2;
  std::optional<int> frame;
  LiftOptions options;
  bool json = false;
};

/// The surface.json of a result folder, or the file that is given.
fs::path surface_file(const std::string& surface) {
  std::error_code ignored;
  return fs::is_directory(surface, ignored) ? road_folder(surface) / "surface.json"
                                            : fs::path(surface);
}

/// Whether boxes are a data set's with z up, not KITTI's.
bool is_map_boxes(const std::string& labels) {
  const std::string kind = lower_case(fs::path(labels).extension().string());
  return kind == ".json" || kind == ".csv" || kind == ".feather";
}

/// m around a box's middle in which cells of a GeoTIFF are read: a plane's points, of large cells
/// too.
constexpr double kAroundBox = 12.0;

/// The ground of a result of `patches` or of a drive on the map, of a cloud or of a GeoTIFF.
/// @param boxes  in its frame
std::unique_ptr<HeightSource> ground_of(const Arguments& args, const std::vector<MapBox>& boxes,
                                        const LogSink& warn) {
  if (is_raster(args.surface)) {
    const RasterInput raster(args.surface, "");
    const std::string remark = remark_on_units(raster);
    if (warn && !remark.empty()) warn(args.surface + ": " + remark);
    PlanCorridor where;
    where.reach = kAroundBox;
    for (const MapBox& box : boxes) where.places.emplace_back(box.center.head<2>());
    return raster_heights(raster, where);
  }
  std::error_code ignored;
  const bool result =
      fs::is_directory(args.surface, ignored) || fs::path(args.surface).extension() == ".json";
  if (!result) {
    CloudFile file = read_cloud_file(args.surface);
    use_metres(args.surface, &file, warn);
    return cloud_heights(file.cloud, PlanFrame(file.cloud.default_up()));
  }
  const RoadSurface surface = read_surface(surface_file(args.surface));
  if (!surface.metric) {
    throw NoAnswerError(args.surface + ": the surface is up to scale, boxes are in metres");
  }
  if (surface.frame == "camera") {
    throw UsageError(args.surface +
                     ": lies in a camera's frame, boxes of nuScenes and Argoverse 2 do not; "
                     "expected a result of patches, or a cloud, in the boxes' frame");
  }
  return surface_heights(surface, PlanFrame(surface.up), args.options.reach);
}

/// Boxes with z up: they take height, pitch and roll of the ground below.
int run_on_map_boxes(const Command& command, const Arguments& args) {
  for (const char* name :
       {"--calib", "--camera", "--frame", "--depth-sigma", "--size-sigma", "--box-sigma"}) {
    if (command.app->count(name) == 0) continue;
    throw UsageError(fmt::format("{}: found boxes with z up, whose place in plan stays", name));
  }
  check_output_file(args.out);
  if (lower_case(fs::path(args.out).extension().string()) == ".feather") {
    throw UsageError("--out: found " + args.out + ", expected .csv, as which tables are written");
  }
  Timings timings;
  StageTimer load_timer(timings, "load");
  const MapBoxFile file = MapBoxFile::read(args.labels);
  std::map<std::int64_t, SE3> poses;
  if (!args.poses.empty()) poses = read_stamped_poses(args.poses);
  if (file.boxes().empty()) throw NoAnswerError(args.labels + ": it holds no 3D box");
  // Poses that take the boxes to the ground's frame; none: not known.
  std::vector<std::optional<SE3>> ground_from_boxes;
  std::vector<MapBox> on_ground, placed;
  for (const MapBox& given : file.boxes()) {
    const auto pose = poses.find(given.timestamp);
    const bool known = args.poses.empty() || pose != poses.end();
    const SE3 ground_from_box = args.poses.empty() || !known ? SE3() : pose->second;
    ground_from_boxes.push_back(known ? std::optional<SE3>(ground_from_box) : std::nullopt);
    MapBox box = given;
    box.center = ground_from_box * given.center;
    box.rotation = ground_from_box.rotation() * given.rotation;
    if (known) placed.push_back(box);
    on_ground.push_back(std::move(box));
  }
  const std::unique_ptr<HeightSource> ground =
      ground_of(args, placed, make_warning_sink(command.common));
  load_timer.stop();
  StageTimer compute(timings, "compute");
  std::vector<MapBox> boxes;
  std::vector<MapBoxNote> notes;
  nlohmann::json rows = nlohmann::json::array();
  std::size_t lifted = 0;
  for (std::size_t i = 0; i < on_ground.size(); ++i) {
    const MapBox& given = file.boxes()[i];
    LiftedMapBox found;
    if (ground_from_boxes[i]) {
      found = lift_map_box(on_ground[i], *ground);
    } else {
      found = {given, Status::kFailed, "no pose of its time"};
    }
    if (found.status != Status::kFailed) {
      ++lifted;
      const SE3 back = ground_from_boxes[i]->inverse();
      found.box.center = back * found.box.center;
      found.box.rotation = back.rotation() * found.box.rotation;
    } else {
      found.box = given;
    }
    notes.push_back({std::string(to_string(found.status)), found.reason, found.height_sigma});
    rows.push_back({{"row", rows.size()},
                    {"category", given.category},
                    {"status", to_string(found.status)},
                    {"reason", found.reason},
                    {"rise", found.rise},
                    {"height_sigma", number_json(found.height_sigma)}});
    boxes.push_back(std::move(found.box));
  }
  compute.stop();
  if (lifted == 0) {
    throw NoAnswerError(
        fmt::format("{}: none of its {} boxes can be put on the ground; of the "
                    "last one: {}",
                    args.labels, boxes.size(), notes.back().reason));
  }
  StageTimer write_timer(timings, "write");
  write_file_atomically(args.out, file.encoded(boxes, notes));
  write_timer.stop();
  if (args.json) {
    nlohmann::json json = {{"version", kVersion},
                           {"seed", command.common.seed},
                           {"options", {{"labels", args.labels}, {"surface", args.surface}}},
                           {"form", file.form()},
                           {"boxes", boxes.size()},
                           {"lifted", lifted},
                           {"rows", rows}};
    add_other_options(command, &json["options"]);
    for (const auto& [stage, milliseconds] : timings.stages()) {
      json["timings_ms"][stage] = milliseconds;
    }
    std::printf("%s\n", json.dump(2, ' ', false, nlohmann::json::error_handler_t::replace).c_str());
  } else if (!command.common.quiet) {
    std::printf("%s: %zu of %zu boxes put on the ground\n", args.out.c_str(), lifted, boxes.size());
  }
  return 0;
}

/// What was done to each row, in the order of the file.
nlohmann::json rows_json(const std::vector<LiftedBox>& lifted) {
  nlohmann::json out = nlohmann::json::array();
  for (std::size_t i = 0; i < lifted.size(); ++i) {
    const LiftedBox& b = lifted[i];
    out.push_back({{"row", i},
                   {"frame", b.label.frame},
                   {"track", b.label.track},
                   {"status", to_string(b.status)},
                   {"reason", b.reason},
                   {"sources", b.sources()},
                   {"patch", b.patch},
                   {"depth_factor", b.depth_factor},
                   {"sigma_depth", b.sigma_depth}});
  }
  return out;
}

struct Inputs {
  KittiLabelFile labels;
  RoadSurface surface;
  std::map<int, SE3> cameras;  ///< camera_from_reference by frame id
  int reference = 0;           ///< frame id
  KittiCalibration::Camera camera;
};

/// camera_from_laser of a calibration: a surface of a laser scan lies in that frame.
SE3 camera_from_laser(const KittiCalibration& calibration, const KittiCalibration::Camera& camera,
                      const std::string& surface) {
  Eigen::Matrix4d rigid = Eigen::Matrix4d::Identity();
  if (calibration.rectified_from_laser) {
    rigid.topRows<3>() = *calibration.rectified_from_laser;
  } else if (calibration.camera0_from_laser) {
    rigid.topRows<3>() = *calibration.camera0_from_laser;
    if (calibration.rectification) {
      rigid.topRows<3>() = (*calibration.rectification * rigid.topRows<3>()).eval();
    }
  } else {
    throw InputError(calibration.file,
                     "found no transform of the laser (Tr_velo_to_cam, Tr), expected one for " +
                         surface + ", which lies in no camera's frame");
  }
  rigid.topRightCorner<3, 1>() += camera.offset;
  return SE3::from_matrix(rigid);
}

/// A surface of a cloud in the laser's frame: of the one frame of a label file in the object form.
void load_laser_surface(const Arguments& args, const KittiCalibration& calibration, Inputs* in) {
  if (in->labels.form == KittiLabelForm::kTracking && !in->labels.labels.empty()) {
    throw UsageError(args.surface + ": lies in the frame of one laser scan, but " + args.labels +
                     " is of the tracking form, of many frames; expected the object form, or the "
                     "result of a drive");
  }
  in->reference = args.frame.value_or(0);
  in->cameras[in->reference] = camera_from_laser(calibration, in->camera, args.surface);
}

Inputs load(const Arguments& args) {
  Inputs in;
  in.labels = read_kitti_labels(args.labels);
  if (args.frame && in.labels.form == KittiLabelForm::kTracking && !in.labels.labels.empty()) {
    throw UsageError(fmt::format("--frame {}: {} is of the tracking form, whose rows have frames",
                                 *args.frame, args.labels));
  }
  const KittiCalibration calibration = read_kitti_calibration(args.calibration);
  in.camera = calibration.camera(args.camera);
  in.surface = surface_without_vehicles(read_surface(surface_file(args.surface)));
  if (in.surface.frame != "camera") {
    load_laser_surface(args, calibration, &in);
    return in;
  }
  const RunDocument run = read_run(road_folder(args.surface) / "run.json");
  for (const RunDocument::CameraPose& c : run.cameras) {
    in.cameras[c.id] = c.reference_from_camera.inverse();
    if (c.reference_from_camera.translation().norm() == 0.0) in.reference = c.id;
  }
  return in;
}

struct Lifted {
  std::vector<LiftedBox> boxes;  ///< a row of the label file each
  int with_box3 = 0;             ///< that could be lifted
  int on_surface = 0;
  int by_box = 0;  ///< corrected by the 2D box alone
};

Lifted lift(const Inputs& in, const Arguments& args) {
  Lifted lifted;
  for (const KittiLabel& label : in.labels.labels) {
    const int frame = label.frame >= 0 ? label.frame : args.frame.value_or(in.reference);
    const auto at = in.cameras.find(frame);
    std::optional<SE3> camera_from_reference;
    if (at != in.cameras.end()) camera_from_reference = at->second;
    LiftedBox box = lift_box(label, in.surface, camera_from_reference, in.camera, args.options);
    lifted.with_box3 += label.has_box3() && !label.dont_care() ? 1 : 0;
    lifted.on_surface += box.by_surface ? 1 : 0;
    lifted.by_box += box.by_box && !box.by_surface ? 1 : 0;
    lifted.boxes.push_back(std::move(box));
  }
  if (lifted.on_surface > 0) return lifted;
  if (lifted.with_box3 == 0) throw NoAnswerError(args.labels + ": it holds no 3D box");
  std::string why;
  for (const LiftedBox& b : lifted.boxes) {
    if (b.label.has_box3() && !b.label.dont_care()) why = b.reason;
  }
  // What the 2D box alone would give is not asked for where the surface adds nothing at all.
  const std::string_view by_box = "distance by the 2D box: ";
  if (std::string_view(why).substr(0, by_box.size()) == by_box) why.erase(0, by_box.size());
  throw NoAnswerError(
      fmt::format("{}: none of its {} 3D boxes can be put on the surface; of the "
                  "last one: {}",
                  args.labels, lifted.with_box3, why));
}

void write(const std::string& path, KittiLabelForm form, const std::vector<LiftedBox>& lifted) {
  KittiLabelFile out{form, {}};
  for (const LiftedBox& b : lifted) out.labels.push_back(b.label);
  AtomicFiles files;
  const fs::path labels_file = files.stage(path);
  write_tilts(lifted, files.stage(tilt_file(path)));
  write_kitti_labels(out, labels_file);
  files.commit();
}

void print_json(const Command& command, const Arguments& args, const Lifted& lifted,
                const Timings& timings) {
  nlohmann::json json = {{"version", kVersion},
                         {"seed", command.common.seed},
                         {"options",
                          {{"labels", args.labels},
                           {"surface", args.surface},
                           {"camera", args.camera},
                           {"depth_sigma", args.options.depth_sigma},
                           {"size_sigma", args.options.size_sigma},
                           {"box_sigma", args.options.box_pixel_sigma}}},
                         {"boxes", lifted.with_box3},
                         {"lifted", lifted.on_surface},
                         {"by_box", lifted.by_box},
                         {"rows", rows_json(lifted.boxes)}};
  add_other_options(command, &json["options"]);
  for (const auto& [stage, milliseconds] : timings.stages()) {
    json["timings_ms"][stage] = milliseconds;
  }
  std::printf("%s\n", json.dump(2).c_str());
}

int run(const Command& command, const Arguments& args) {
  if (is_map_boxes(args.labels)) return run_on_map_boxes(command, args);
  if (!args.poses.empty()) {
    throw UsageError("--poses: found KITTI labels, expected boxes of nuScenes or Argoverse 2");
  }
  if (args.calibration.empty()) {
    throw UsageError(args.labels + ": KITTI labels need --calib, none is given");
  }
  if (is_raster(args.surface)) {
    throw UsageError(args.surface +
                     ": lies on a map, KITTI labels in a camera's frame; expected a result of "
                     "reconstruct, drive or patches");
  }
  refuse_own_inputs({args.out, tilt_file(args.out)}, {});
  Timings timings;
  StageTimer load_timer(timings, "load");
  const Inputs in = load(args);
  load_timer.stop();
  if (!in.surface.metric) {
    throw NoAnswerError(args.surface + ": the surface is up to scale, boxes are in metres");
  }
  StageTimer compute(timings, "compute");
  const Lifted lifted = lift(in, args);
  compute.stop();
  StageTimer write_timer(timings, "write");
  write(args.out, in.labels.form, lifted.boxes);
  write_timer.stop();
  if (args.json) {
    print_json(command, args, lifted, timings);
  } else if (!command.common.quiet) {
    std::printf("%s: %d of %d boxes put on the surface, %d more corrected by their 2D box\n",
                args.out.c_str(), lifted.on_surface, lifted.with_box3, lifted.by_box);
  }
  return 0;
}

void add_arguments(App& app, Arguments& a) {
  app.add_option("labels", a.labels,
                 "KITTI label file, tracking or object form; or boxes with z up: nuScenes (.json: "
                 "results or "
                 "annotations) or Argoverse 2 (.feather, .csv)")
      ->required();
  app.add_option(
         "--surface", a.surface,
         "result folder of reconstruct, drive or patches, or its surface.json; for boxes with z up "
         "also a cloud or a GeoTIFF of heights")
      ->required();
  app.add_option("--calib", a.calibration, "KITTI calibration file(s), of KITTI labels");
  app.add_option("--poses", a.poses,
                 "Argoverse 2: poses of the vehicle in the surface's frame by time (.feather or "
                 ".csv: timestamp_ns, qw ... tz_m); without, boxes are in that frame");
  app.add_option("--out", a.out, "label file to write")->output_file()->required();
  app.add_option("--camera", a.camera, "camera of the surface's images")
      ->check(in_range(0, 3))
      ->capture_default_str();
  app.add_option("--frame", a.frame,
                 "frame id of a file in the object form; default: the result's reference frame");
  app.add_option("--depth-sigma", a.options.depth_sigma,
                 "standard deviation of the detector's distance, as a share of it")
      ->check(positive_number())
      ->capture_default_str();
  app.add_option("--size-sigma", a.options.size_sigma,
                 "standard deviation of the detector's 3D height, as a share of it")
      ->check(positive_number())
      ->capture_default_str();
  app.add_option("--box-sigma", a.options.box_pixel_sigma,
                 "standard deviation of the sides of its 2D boxes, pixels, beside 2.5 % of the "
                 "box's height")
      ->check(positive_number())
      ->capture_default_str();
  app.add_flag("--json", a.json, "print what was done as JSON");
}

}  // namespace

void register_lift(App& root) {
  Command* command = add_command(
      root, "lift",
      "Puts the 3D boxes of a detector on the road surface. Boxes of nuScenes and Argoverse 2, "
      "which "
      "have their place in plan, take height, pitch and roll of the ground below. Of a monocular "
      "detector (KITTI label form, yaw only) the distance along the ray is joined from the "
      "detector's, from the height of "
      "its 2D box with its 3D height and the size prior, and from the surface below, each with its "
      "standard deviation; what contradicts the others is left out. Height, pitch and roll come "
      "from the patch below. Rows that the surface does not cover, or whose frame its run does not "
      "know, are corrected by their 2D box alone, or stay as they were, beside rows that are put "
      "on it; a file of which it covers no row is refused (exit code 1). Pitch, roll, the new "
      "distance's standard deviation and what it was made of go to a side file, OUT with the "
      "extension .tilt.csv.",
      "  camber lift detector/0009.txt --surface out/0009 --calib calib/0009.txt --out lifted.txt\n"
      "  camber lift 000050.txt --frame 50 --surface out/0009 --calib calib.txt --out lifted.txt "
      "--depth-sigma 0.1\n"
      "  camber lift annotations.feather --poses city_SE3_egovehicle.feather --surface ground.ply "
      "--out lifted.csv");
  const auto arguments = std::make_shared<Arguments>();
  add_arguments(*command->app, *arguments);
  command->run = [command, arguments] { return run(*command, *arguments); };
}

}  // namespace camber::tools
