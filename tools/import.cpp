// camber import: a person's own data (import_own.cpp) and native data sets to scene manifests.

#include <memory>
#include <nlohmann/json.hpp>

#include "camber/core/made_folder.h"
#include "camber/core/stopwatch.h"
#include "camber/import/import_kitti.h"
#include "camber/import/import_own.h"
#include "camber/import/import_synthia.h"
#include "camber/scene/validate_scene.h"
#include "command.h"
#include "gnss_arguments.h"
#include "import_output.h"

namespace fs = std::filesystem;
using nlohmann::json;

namespace camber::tools {
namespace {

struct KittiArguments {
  KittiImportOptions options;
  GnssArguments gnss;
  std::string images, labels, poses, times, velodyne, detections, keypoints, up, out;
  int sequence = -1, poses_camera = -1;
  std::vector<std::string> calibration;
  int camera = -1;
  double height_sigma = 0.0;
  double up_sigma_deg = 1.0;
  int reference_frame = -1;
  bool json = false;
};

void register_kitti(App& import) {
  Command* command = add_command(
      import, "kitti",
      "Writes the scene manifest of a KITTI clip (tracking, raw, odometry or object layout). "
      "Labels, poses and laser scans become ground truth; boxes become detections only when asked "
      "for.",
      "  camber import kitti --images image_02/0009 --calib calib/0009.txt "
      "--labels label_02/0009.txt \\\n"
      "      --detections-from-labels --frames 48:53 --out clip/scene.json\n"
      "  camber import kitti --images image_0 --calib calib.txt --poses poses.txt --out drive06\n"
      "  camber import kitti --images image_02/data --calib calib_cam_to_cam.txt "
      "calib_velo_to_cam.txt \\\n"
      "      --velodyne velodyne_points/data --gnss oxts --up oxts --out drive0052");
  auto arguments = std::make_shared<KittiArguments>();
  KittiArguments& a = *arguments;
  App& app = *command->app;
  command->foreign_folders = true;
  app.add_option("--images", a.images, "folder of images named by frame number")->required();
  app.add_option("--calib", a.calibration,
                 "calibration files; default: calib.txt beside the folder of images");
  app.add_option("--labels", a.labels,
                 "true boxes: a tracking label file, or a folder of object label files");
  app.add_option("--poses", a.poses, "true poses, 12 numbers a row (odometry form)");
  app.add_option("--poses-camera", a.poses_camera,
                 "camera whose poses they are; default: 0, as in KITTI's files")
      ->check(in_range(0, 3));
  app.add_option("--times", a.times,
                 "times of the images, one a row; default: times.txt or timestamps.txt beside "
                 "them, else 10 a second");
  app.add_option("--velodyne", a.velodyne,
                 "folder of laser scans; the reference frame's becomes the true cloud");
  app.add_option("--detections", a.detections,
                 "a detector's boxes in KITTI's label form, as for --labels");
  app.add_flag("--detections-from-labels", a.options.detections_from_labels,
               "take the boxes of --labels as detections and say so")
      ->needs("--labels")
      ->excludes("--detections");
  app.add_option("--keypoints", a.keypoints,
                 "36 keypoints of the detections, JSON: a list of objects with sequence, frame, "
                 "track_id or bbox_xyxy, and keypoints_uv_confidence");
  app.add_option("--sequence", a.sequence,
                 "sequence of the images, for --keypoints; default: their folder's number")
      ->check(non_negative_number());
  app.add_option("--frames", a.options.frames,
                 "frame ids: 48,49,50, 48:52, 0:10:5 or all; default: all")
      ->no_name();
  app.add_option("--reference", a.reference_frame,
                 "reference frame; default: left to the run (the middle one)")
      ->check(non_negative_number());
  app.add_option("--camera", a.camera,
                 "camera of the images; default: by a folder name like image_02")
      ->check(in_range(0, 3));
  app.add_option("--height,--camera-height", a.options.camera_height, "metres above the road")
      ->check(in_range(1e-3, kMostCameraHeight))
      ->capture_default_str();
  app.add_option("--height-sigma", a.height_sigma, "standard deviation of the height, m")
      ->check(positive_number());
  app.add_option("--up", a.up, "roll and pitch of the vehicle: the folder oxts, or CSV");
  app.add_option("--up-sigma-deg", a.up_sigma_deg,
                 "standard deviation of --up, and of headings in --gnss, degrees")
      ->check(positive_number())
      ->capture_default_str()
      ->default_varies();
  add_gnss_options(app, a.gnss);
  app.add_option("--classes", a.options.classes, "types that count as vehicles")
      ->no_name()
      ->delimiter(',')
      ->capture_default_str();
  app.add_option("--name", a.options.name, "name of the scene; default: the clip's folder")
      ->no_name();
  app.add_option("--out", a.out, "manifest to write (.json), or its folder")
      ->output_manifest()
      ->required();
  app.add_flag("--json", a.json, "print what was found as JSON to stdout");
  command->run = [arguments, command]() {
    KittiArguments& given = *arguments;
    KittiImportOptions& options = given.options;
    check_up_sigma(*command->app, given.up, given.gnss);
    options.images = given.images;
    options.calibration.assign(given.calibration.begin(), given.calibration.end());
    options.labels = given.labels;
    options.poses = given.poses;
    options.velodyne = given.velodyne;
    options.detections = given.detections;
    options.keypoints = given.keypoints;
    if (given.sequence >= 0) options.sequence = given.sequence;
    if (given.camera >= 0) options.camera = given.camera;
    if (given.poses_camera >= 0) options.poses_camera = given.poses_camera;
    options.times = given.times;
    if (given.height_sigma > 0.0) options.height_sigma = given.height_sigma;
    if (given.reference_frame >= 0) options.reference_frame = given.reference_frame;
    options.up = given.up;
    options.up_sigma = given.up_sigma_deg * 0.017453292519943295;
    options.gnss = given.gnss.take(options.up_sigma);
    options.validate();
    const fs::path manifest = manifest_of(given.out);
    MadeFolder folder(folder_of(manifest));
    Timings timings;
    StageTimer timer(timings, "import");
    const Scene scene = import_kitti_to(options, manifest, make_warning_sink(command->common));
    timer.stop();
    folder.keep();
    json used = {{"images", given.images},
                 {"calib", given.calibration},
                 {"labels", given.labels},
                 {"poses", given.poses},
                 {"times", given.times},
                 {"velodyne", given.velodyne},
                 {"detections", given.detections},
                 {"keypoints", given.keypoints},
                 {"detections_from_labels", options.detections_from_labels},
                 {"camera_height", options.camera_height},
                 {"height_sigma", scene.height_sigma},
                 {"up", given.up},
                 {"up_sigma_deg", given.up_sigma_deg},
                 {"classes", options.classes}};
    add_gnss_json(given.gnss, &used);
    report_import(*command, scene, manifest, {{}, missing_in(scene)}, std::move(used), given.json,
                  timings);
    return 0;
  };
}

struct SynthiaSfArguments {
  SynthiaSfImportOptions options;
  std::string sequence, detections, out;
  double camera_height = 0.0;
  double height_sigma = 0.0;
  double frame_rate = 0.0;
  int reference_frame = -1;
  bool json = false;
};

void register_synthia_sf(App& import) {
  Command* command = add_command(
      import, "synthia-sf",
      "Writes the scene manifest of a SYNTHIA-SF sequence (RGBLeft, DepthLeft, GTLeft). Depth and "
      "labels become ground truth, with true vehicles by a fit to both; labels become the run's "
      "segmentation only when asked for.",
      "  camber import synthia-sf --sequence SYNTHIA-SF/SEQ4 --frames 67:69 "
      "--segmentation-from-labels \\\n"
      "      --detections boxes.txt --out seq4/scene.json");
  auto arguments = std::make_shared<SynthiaSfArguments>();
  SynthiaSfArguments& a = *arguments;
  App& app = *command->app;
  command->foreign_folders = true;
  app.add_option("--sequence", a.sequence, "folder of the sequence, with RGBLeft in it")
      ->required();
  app.add_option("--frames", a.options.frames,
                 "frame ids: 67,68,69, 67:69, 0:100:5 or all; default: all")
      ->no_name();
  app.add_option("--reference", a.reference_frame,
                 "reference frame; default: left to the run (the middle one)")
      ->check(non_negative_number());
  app.add_option("--detections", a.detections,
                 "a detector's boxes in KITTI's label form: a tracking file, or a folder of object "
                 "files");
  app.add_flag("--segmentation-from-labels", a.options.segmentation_from_labels,
               "take the true labels as segmentation and say so");
  app.add_option("--height,--camera-height", a.camera_height,
                 "metres above the road; without it results are up to scale")
      ->check(in_range(1e-3, kMostCameraHeight));
  app.add_option("--height-sigma", a.height_sigma, "standard deviation of the height, m")
      ->check(positive_number())
      ->needs("--height");
  app.add_option("--rate,--frame-rate", a.frame_rate, "frames a second")->check(positive_number());
  app.add_option("--classes", a.options.classes, "types of the detections that count as vehicles")
      ->no_name()
      ->delimiter(',')
      ->capture_default_str()
      ->needs("--detections");
  app.add_option("--name", a.options.name, "name of the scene; default: the sequence's folder")
      ->no_name();
  app.add_option("--out", a.out, "manifest to write (.json), or its folder")
      ->output_manifest()
      ->required();
  app.add_flag("--json", a.json, "print what was found as JSON to stdout");
  command->run = [arguments, command]() {
    SynthiaSfArguments& given = *arguments;
    SynthiaSfImportOptions& options = given.options;
    options.sequence = given.sequence;
    options.detections = given.detections;
    if (given.camera_height > 0.0) options.camera_height = given.camera_height;
    if (given.frame_rate > 0.0) options.frame_rate = given.frame_rate;
    if (given.height_sigma > 0.0) options.height_sigma = given.height_sigma;
    if (given.reference_frame >= 0) options.reference_frame = given.reference_frame;
    options.num_threads = command->common.threads;
    options.validate();
    const fs::path manifest = manifest_of(given.out);
    MadeFolder folder(folder_of(manifest));
    Timings timings;
    StageTimer timer(timings, "import");
    const Scene scene = import_synthia_sf_to(options, manifest, make_warning_sink(command->common));
    timer.stop();
    folder.keep();
    report_import(
        *command, scene, manifest, {{}, missing_in(scene)},
        {{"sequence", given.sequence},
         {"detections", given.detections},
         {"segmentation_from_labels", options.segmentation_from_labels},
         {"camera_height", given.camera_height > 0.0 ? json(given.camera_height) : json()},
         {"height_sigma", scene.height_sigma},
         {"classes", options.classes}},
        given.json, timings);
    return 0;
  };
}

}  // namespace

void register_import(App& root) {
  App* import =
      root.add_subcommand("import", "Writes scene manifests for your own images and for data sets");
  import->require_subcommand();
  register_import_images(*import);
  register_import_video(*import);
  register_import_colmap(*import);
  register_import_rosbag(*import);
  register_kitti(*import);
  register_synthia_sf(*import);
}

}  // namespace camber::tools
