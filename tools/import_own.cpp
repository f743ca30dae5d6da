// camber import images|video|colmap|rosbag: one's own images, with what one has beside them, to a
// scene manifest.

#include <memory>
#include <nlohmann/json.hpp>

#include "camber/core/made_folder.h"
#include "camber/core/protected_inputs.h"
#include "camber/import/import_own.h"
#include "camber/import/import_rosbag.h"
#include "camber/scene/validate_scene.h"
#include "camera_arguments.h"
#include "gnss_arguments.h"
#include "import_output.h"
#include "plugins/recording_plugin.h"

namespace fs = std::filesystem;
using nlohmann::json;

namespace camber::tools {
namespace {

/// What all imports of one's own data take; NaN and empty: not given.
struct OwnArguments {
  OwnDataOptions options;
  CameraArguments camera;
  GnssArguments gnss;
  std::string times, detections, class_names, masks, poses, speed, up, out;
  double up_sigma_deg = 1.0;
  double rate = 0;
  int reference_frame = -1;
  bool json = false;
};

void add_detection_options(App& app, OwnArguments& a) {
  app.add_option("--detections", a.detections,
                 "boxes of vehicles: COCO, YOLO, Pascal VOC, MOT, KITTI, BDD100K, CVAT, VisDrone; "
                 "a file, or a "
                 "folder of a file an image");
  app.add_option("--class-names", a.class_names,
                 "names of the class numbers in --detections: a list, a .data or a YAML file")
      ->needs("--detections");
  app.add_option("--classes", a.options.detections.classes, "classes that count as vehicles")
      ->no_name()
      ->delimiter(',')
      ->capture_default_str()
      ->needs("--detections");
  app.add_option("--default-class", a.options.detections.default_class,
                 "class of boxes in files without classes")
      ->no_name()
      ->capture_default_str()
      ->needs("--detections");
  app.add_option("--least-score", a.options.detections.least_score,
                 "boxes with a lower score are left out")
      ->check(in_range(0.0, 1.0))
      ->capture_default_str()
      ->needs("--detections");
  app.add_option("--detections-source", a.options.detections.source,
                 "what the manifest states as their source")
      ->no_name()
      ->capture_default_str()
      ->needs("--detections");
}

void add_known_options(App& app, OwnArguments& a) {
  app.add_option("--masks", a.masks, "folder of road masks (PNG), named as the images are");
  app.add_option("--class-map", a.options.class_map,
                 "of --masks: kitti-road, cityscapes, cityscapes-train, bdd100k, bdd100k-drivable, "
                 "mapillary, mapillary-2, camber, binary (not zero: road), or a file")
      ->needs("--masks");
  app.add_option("--poses", a.poses,
                 "known poses of the camera in metres: TUM, EuRoC, KITTI, COLMAP, 4 x 4 matrices");
  app.add_option("--pose-scale", a.options.pose_scale, "metres per unit of --poses")
      ->check(positive_number())
      ->capture_default_str()
      ->needs("--poses");
  app.add_option("--speed", a.speed,
                 "speeds: CSV of time and m/s, GPX, NMEA, RTKLIB, or a folder of KITTI's oxts");
  app.add_option(
         "--speed-offset", a.options.speed_offset,
         "seconds to add to the times of --speed; first: the log starts with the first frame")
      ->no_name()
      ->needs("--speed");
  app.add_option(
      "--up", a.up,
      "roll and pitch of the vehicle: CSV (time or frame, roll, pitch), or KITTI's oxts");
  app.add_option("--up-sigma-deg", a.up_sigma_deg,
                 "standard deviation of --up, and of headings in --gnss, degrees")
      ->check(positive_number())
      ->capture_default_str()
      ->default_varies();
  add_gnss_options(app, a.gnss);
}

void add_output_options(App& app, OwnArguments& a) {
  app.add_option("--reference", a.reference_frame,
                 "reference frame; default: left to the run (the middle one)")
      ->check(non_negative_number());
  app.add_option("--name", a.options.name, "name of the scene; default: the folder's")->no_name();
  app.add_option("--out", a.out, "manifest to write (.json), or its folder")
      ->output_manifest()
      ->required();
  app.add_flag("--json", a.json, "print what was found as JSON to stdout");
}

/// The options of the library from what was typed.
const OwnDataOptions& take(OwnArguments& a) {
  OwnDataOptions& o = a.options;
  a.camera.take(&o);
  if (a.rate > 0.0) o.times.rate = a.rate;
  o.times.list = a.times;
  o.detections.file = a.detections;
  o.detections.class_names = a.class_names;
  o.masks = a.masks;
  o.poses = a.poses;
  o.speed = a.speed;
  o.up = a.up;
  o.up_sigma = a.up_sigma_deg * 0.017453292519943295;
  o.gnss = a.gnss.take(o.up_sigma);
  if (a.reference_frame >= 0) o.reference_frame = a.reference_frame;
  o.validate();
  return o;
}

json options_json(const OwnArguments& a) {
  const auto number = [](const std::optional<double>& value) {
    return value ? json(*value) : json();
  };
  const OwnDataOptions& o = a.options;
  json out = {{"rate", number(o.times.rate)},
              {"times", a.times},
              {"times_from_names", o.times.from_names},
              {"detections", a.detections},
              {"class_names", a.class_names},
              {"classes", o.detections.classes},
              {"default_class", o.detections.default_class},
              {"least_score", o.detections.least_score},
              {"detections_source", o.detections.source},
              {"masks", a.masks},
              {"class_map", o.class_map},
              {"poses", a.poses},
              {"pose_scale", o.pose_scale},
              {"speed", a.speed},
              {"speed_offset", o.speed_offset},
              {"up", a.up},
              {"up_sigma_deg", a.up_sigma_deg},
              {"frames", o.frames}};
  a.camera.add_json(&out);
  add_gnss_json(a.gnss, &out);
  return out;
}

/// What is read of folders: boxes, which the manifest could replace, and masks, which the images of
/// a video and the converted masks could.
std::vector<fs::path> files_in_folders(const OwnArguments& a, const OwnImport& import) {
  std::vector<fs::path> files;
  std::error_code error;
  for (fs::directory_iterator at(a.detections, error), end; !error && at != end;
       at.increment(error)) {
    files.push_back(at->path());
  }
  for (const auto& [frame, mask] : import.conversions) files.push_back(mask);
  for (const SceneFrame& frame : import.scene.frames) {
    files.insert(files.end(), {frame.segmentation, frame.road_mask});
  }
  return files;
}

/// Writes the manifest that `import` makes, and reports it.
template <typename Import>
int write_import(const Command& command, OwnArguments& a, json options, const Import& import) {
  const fs::path manifest = manifest_of(a.out);
  MadeFolder folder(folder_of(manifest));
  Timings timings;
  StageTimer timer(timings, "import");
  OwnImport made = import(manifest);
  protect_inputs(files_in_folders(a, made));
  write_own_import(made, manifest);
  timer.stop();
  folder.keep();
  report_import(command, made.scene, manifest, {made.found, made.missing}, std::move(options),
                a.json, timings);
  return 0;
}

/// The times of a recording that are taken.
struct TimeRange {
  double from = -1.0, to = -1.0;  // s, < 0: not given
};

void add_time_range(App& app, TimeRange& times) {
  app.add_option("--from", times.from, "first time to take, seconds since the first frame")
      ->check(non_negative_number());
  app.add_option("--to", times.to, "last time to take, likewise")->check(non_negative_number());
}

void take_time_range(const TimeRange& times, VideoChoice* choice, json* used) {
  if (times.from >= 0.0) choice->from = times.from;
  if (times.to >= 0.0) choice->to = times.to;
  (*used)["from"] = choice->from ? json(*choice->from) : json();
  (*used)["to"] = choice->to ? json(*choice->to) : json();
}

}  // namespace

void register_import_images(App& import) {
  Command* command = add_command(
      import, "images",
      "Writes the scene manifest of your own images: PNG or JPEG files of any names, in natural "
      "order. The camera comes from a calibration file of many programs or from numbers.",
      "  camber import images frames/ --calib camera.yaml --height 1.4 --rate 10 --out scene\n"
      "  camber import images 'drive/*.jpg' --fov 90 --times-from-names --out scene");
  struct Arguments : OwnArguments {
    std::vector<std::string> places;
  };
  auto arguments = std::make_shared<Arguments>();
  Arguments& a = *arguments;
  App& app = *command->app;
  command->foreign_folders = true;
  app.add_option("images", a.places, "folders, patterns in quotes, or files")->required();
  add_camera_options(app, a.camera, CameraSource::kImages);
  app.add_option("--rate", a.rate, "frames a second")->check(positive_number());
  app.add_option("--times", a.times,
                 "times in seconds, one a line, or with a file name in a second column");
  app.add_flag("--times-from-names", a.options.times.from_names,
               "file names are times: seconds, ms, us or ns by their digits, or dates");
  add_detection_options(app, a);
  add_known_options(app, a);
  app.add_option("--frames", a.options.frames,
                 "frame ids to keep: 48,49,50, 48:52, 0:100:5 or all; default: all")
      ->no_name();
  add_output_options(app, a);
  command->run = [arguments, command]() {
    check_up_sigma(*command->app, arguments->up, arguments->gnss);
    const OwnDataOptions& options = take(*arguments);
    json used = options_json(*arguments);
    used["images"] = arguments->places;
    return write_import(*command, *arguments, std::move(used), [&](const fs::path&) {
      return import_images(arguments->places, options, make_warning_sink(command->common));
    });
  };
}

void register_import_video(App& import) {
  Command* command = add_command(
      import, "video",
      "Writes the scene manifest of a video (mp4, mkv, avi, ...). Every frame is decoded once for "
      "its time; frames are referred to as FILE#NUMBER and stay in the video unless --extract is "
      "given. Positions, speeds and gravity that the camera recorded with it (GoPro's track in it, "
      "or a .gpx, .nmea or .srt of its name beside it) are taken where no option gives them.",
      "  camber import video drive.mp4 --calib camera.yaml --height 1.4 --out scene\n"
      "  camber import video drive.mp4 --fov 90 --from 12.5 --to 20 --every 3 --extract --out "
      "scene");
  struct Arguments : OwnArguments {
    std::string video;
    VideoChoice choice;
    TimeRange times;
    TelemetryArguments telemetry;
  };
  auto arguments = std::make_shared<Arguments>();
  Arguments& a = *arguments;
  App& app = *command->app;
  command->foreign_folders = true;
  app.add_option("video", a.video, "file of the video")->required();
  app.add_option("--every", a.choice.every, "take each n-th frame")
      ->check(in_range(1, 1000000))
      ->capture_default_str();
  add_time_range(app, a.times);
  app.add_flag("--extract", a.choice.extract, "write the frames as PNG files beside the manifest");
  add_camera_options(app, a.camera, CameraSource::kImages);
  add_detection_options(app, a);
  add_known_options(app, a);
  add_telemetry_options(app, a.telemetry);
  app.add_option("--frames", a.options.frames,
                 "frames to keep of those taken: 48,49,50, 48:52 or all; default: all")
      ->no_name();
  add_output_options(app, a);
  command->run = [arguments, command]() {
    Arguments& given = *arguments;
    check_up_sigma(*command->app, given.up, given.gnss);
    given.options.telemetry = given.telemetry.take();
    const OwnDataOptions& options = take(given);
    json used = options_json(given);
    add_telemetry_json(given.telemetry, &used);
    take_time_range(given.times, &given.choice, &used);
    used["video"] = given.video;
    used["every"] = given.choice.every;
    used["extract"] = given.choice.extract;
    return write_import(*command, given, std::move(used), [&](const fs::path& manifest) {
      return import_video(given.video, given.choice, options, manifest);
    });
  };
}

void register_import_colmap(App& import) {
  Command* command =
      add_command(import, "colmap",
                  "Writes the scene manifest of a COLMAP model: its images, their camera with its "
                  "lens, and its "
                  "poses where the metres per unit are given.",
                  "  camber import colmap sparse/0 --images frames --height 1.4 --out scene\n"
                  "  camber import colmap sparse/0 --images frames --scale 1.0 --out scene");
  struct Arguments : OwnArguments {
    std::string model, images;
    double scale = 0.0;
  };
  auto arguments = std::make_shared<Arguments>();
  Arguments& a = *arguments;
  App& app = *command->app;
  command->foreign_folders = true;
  app.add_option("model", a.model, "folder with cameras, images and points3D, .bin or .txt")
      ->required();
  app.add_option("--images", a.images, "folder that the images' names are relative to")->required();
  app.add_option("--scale", a.scale, "metres per unit of the model: takes its poses")
      ->check(positive_number());
  app.add_option("--rate", a.rate, "frames a second")->check(positive_number());
  add_camera_options(app, a.camera, CameraSource::kModel);
  add_detection_options(app, a);
  app.add_option("--frames", a.options.frames,
                 "frame ids to keep: 48,49,50, 48:52, 0:100:5 or all; default: all")
      ->no_name();
  add_output_options(app, a);
  command->run = [arguments, command]() {
    Arguments& given = *arguments;
    const OwnDataOptions& options = take(given);
    json used = options_json(given);
    used["model"] = given.model;
    used["images"] = given.images;
    used["scale"] = given.scale > 0.0 ? json(given.scale) : json();
    return write_import(*command, given, std::move(used), [&](const fs::path&) {
      return import_colmap(given.model, given.images,
                           given.scale > 0.0 ? std::optional(given.scale) : std::nullopt, options);
    });
  };
}

void register_import_rosbag(App& import) {
  Command* command = add_command(
      import, "rosbag",
      "Writes the scene manifest of a recording: an MCAP file, a folder or .db3 file of rosbag2, "
      "or a bag of ROS 1 (which needs Debian's librosbag-storage-dev when the program is built). "
      "The images of a topic (Image or CompressedImage) are written beside it, times are those of "
      "their headers, the camera is that of CameraInfo unless one is given; positions "
      "(NavSatFix), gravity (Imu), speeds (Odometry) and the camera's height above base_footprint "
      "(/tf_static) are taken where no option gives them.",
      "  camber import rosbag drive.mcap --height 1.4 --out scene\n"
      "  camber import rosbag drive.bag --topic /camera/image_raw/compressed --calib camera.yaml "
      "\\\n      --from 12.5 --to 20 --every 3 --out scene");
  struct Arguments : OwnArguments {
    std::string bag;
    BagChoice choice;
    TimeRange times;
  };
  auto arguments = std::make_shared<Arguments>();
  Arguments& a = *arguments;
  App& app = *command->app;
  command->foreign_folders = true;
  app.add_option("bag", a.bag, "file of the bag, or folder of rosbag2")->required();
  app.add_option("--topic", a.choice.topic, "topic of the images, where the bag has several")
      ->no_name();
  app.add_option("--info-topic", a.choice.info_topic,
                 "topic of their CameraInfo; default: camera_info beside them")
      ->no_name();
  app.add_option("--fix-topic", a.choice.fix_topic,
                 "topic of positions (NavSatFix), or none; default: the only one")
      ->no_name();
  app.add_option("--imu-topic", a.choice.imu_topic,
                 "topic of gravity (Imu), or none; default: the only one")
      ->no_name();
  app.add_option("--odometry-topic", a.choice.odometry_topic,
                 "topic of speeds (Odometry), or none; default: the only one")
      ->no_name();
  app.add_option("--every", a.choice.frames.every, "take each n-th image")
      ->check(in_range(1, 1000000))
      ->capture_default_str();
  add_time_range(app, a.times);
  add_camera_options(app, a.camera, CameraSource::kBag);
  add_detection_options(app, a);
  add_known_options(app, a);
  app.add_option("--frames", a.options.frames,
                 "frames to keep of those taken: 48,49,50, 48:52 or all; default: all")
      ->no_name();
  add_output_options(app, a);
  command->run = [arguments, command]() {
    Arguments& given = *arguments;
    check_up_sigma(*command->app, given.up, given.gnss);
    const OwnDataOptions& options = take(given);
    BagChoice& choice = given.choice;
    json used = options_json(given);
    take_time_range(given.times, &choice.frames, &used);
    choice.frames.validate();
    used["bag"] = given.bag;
    used["topic"] = choice.topic;
    used["info_topic"] = choice.info_topic;
    used["fix_topic"] = choice.fix_topic;
    used["imu_topic"] = choice.imu_topic;
    used["odometry_topic"] = choice.odometry_topic;
    used["every"] = choice.frames.every;
    return write_import(*command, given, std::move(used), [&](const fs::path& manifest) {
      return import_rosbag(open_any_bag(given.bag), given.bag, choice, options, manifest);
    });
  };
}

}  // namespace camber::tools
