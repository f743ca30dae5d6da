// camber lift: yaw-only boxes of any detector put on the road surface.

#include <cstdio>
#include <filesystem>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>

#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "camber/core/version.h"
#include "camber/pipeline/kitti_boxes.h"
#include "command.h"
#include "road_arguments.h"

namespace camber::tools {
namespace {

namespace fs = std::filesystem;

struct Arguments {
  std::string labels, surface, out;
  std::vector<fs::path> calibration;
  int camera = 2;
  std::optional<int> frame;
  LiftOptions options;
  bool json = false;
};

}  // namespace

void register_lift(App& root) {
  Command* command = add_command(
      root, "lift",
      "Puts the 3D boxes of a monocular detector (KITTI label form, yaw only) on the road surface "
      "of "
      "a result: distance along the ray corrected by its uncertainty, height, pitch and roll from "
      "the "
      "patch below. Pitch and roll go to a side file, OUT with the extension .tilt.csv. Rows that "
      "the "
      "surface does not cover stay as they were.",
      "  camber lift detector/0009.txt --surface out/0009 --calib calib/0009.txt --out lifted.txt\n"
      "  camber lift 000050.txt --frame 50 --surface out/0009 --calib calib.txt --out lifted.txt "
      "--depth-sigma 0.1");
  auto arguments = std::make_shared<Arguments>();
  Arguments& a = *arguments;
  App& app = *command->app;
  app.add_option("labels", a.labels, "KITTI label file, tracking or object form")->required();
  app.add_option("--surface", a.surface, "result folder of reconstruct")->required();
  app.add_option("--calib", a.calibration, "KITTI calibration file(s)")->required();
  app.add_option("--out", a.out, "label file to write")->required();
  app.add_option("--camera", a.camera, "camera of the surface's images")
      ->check(in_range(0, 3))
      ->capture_default_str();
  app.add_option("--frame", a.frame,
                 "frame id of a file in the object form; default: the result's reference frame");
  app.add_option("--depth-sigma", a.options.depth_sigma,
                 "standard deviation of the detector's distance, as a share of it")
      ->check(positive_number())
      ->capture_default_str();
  app.add_flag("--json", a.json, "print what was done as JSON");
  command->run = [command, arguments] {
    const Arguments& args = *arguments;
    Timings timings;
    KittiLabelFile labels;
    RoadSurface surface;
    RunDocument run;
    KittiCalibration::Camera camera;
    {
      const StageTimer timer(timings, "load");
      labels = read_kitti_labels(args.labels);
      surface = read_camera_surface(args.surface);
      run = read_run(fs::path(args.surface) / "run.json");
      camera = read_kitti_calibration(args.calibration).camera(args.camera);
    }
    if (!surface.metric) {
      throw NoAnswerError(args.surface + ": the surface is up to scale, boxes are in metres");
    }
    std::map<int, SE3> cameras;
    int reference = 0;
    for (const RunDocument::CameraPose& c : run.cameras) {
      cameras[c.id] = c.reference_from_camera.inverse();
      if (c.reference_from_camera.translation().norm() == 0.0) reference = c.id;
    }
    std::vector<LiftedBox> lifted;
    int boxes = 0, done = 0;
    {
      const StageTimer timer(timings, "compute");
      for (const KittiLabel& label : labels.labels) {
        const int frame = label.frame >= 0 ? label.frame : args.frame.value_or(reference);
        const auto at = cameras.find(frame);
        LiftedBox box;
        if (at == cameras.end()) {
          box.label = label;
          box.status = Status::kFailed;
          box.reason = "the surface's run has no frame " + std::to_string(frame);
        } else {
          box = lift_box(label, surface, at->second, camera, args.options);
        }
        boxes += label.has_box3() && !label.dont_care() ? 1 : 0;
        done += box.status != Status::kFailed ? 1 : 0;
        lifted.push_back(std::move(box));
      }
    }
    if (done == 0) {
      std::string why = "it holds no 3D box";
      for (const LiftedBox& b : lifted) {
        if (b.label.has_box3() && !b.label.dont_care()) why = b.reason;
      }
      throw NoAnswerError(args.labels + ": no box can be put on the surface: " + why);
    }
    {
      const StageTimer timer(timings, "write");
      KittiLabelFile out{labels.form, {}};
      for (const LiftedBox& b : lifted) out.labels.push_back(b.label);
      AtomicFiles files;
      const fs::path labels_file = files.stage(args.out);
      write_tilts(lifted, files.stage(tilt_file(args.out)));
      write_kitti_labels(out, labels_file);
      files.commit();
    }
    if (args.json) {
      nlohmann::json json = {{"version", kVersion},
                             {"seed", command->common.seed},
                             {"options",
                              {{"labels", args.labels},
                               {"surface", args.surface},
                               {"camera", args.camera},
                               {"depth_sigma", args.options.depth_sigma}}},
                             {"boxes", boxes},
                             {"lifted", done}};
      for (const auto& [stage, milliseconds] : timings.stages()) {
        json["timings_ms"][stage] = milliseconds;
      }
      std::printf("%s\n", json.dump(2).c_str());
    } else if (!command->common.quiet) {
      std::printf("%s: %d of %d boxes put on the surface\n", args.out.c_str(), done, boxes);
    }
    return 0;
  };
}

}  // namespace camber::tools
