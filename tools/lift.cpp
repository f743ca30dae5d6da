// camber lift: yaw-only boxes of any detector put on the road surface.

#include <cstdio>
#include <filesystem>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>

#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "camber/core/version.h"
#include "camber/pipeline/lift_box.h"
#include "command.h"
#include "own_inputs.h"
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

}  // namespace

void register_lift(App& root) {
  Command* command = add_command(
      root, "lift",
      "Puts the 3D boxes of a monocular detector (KITTI label form, yaw only) on the road surface "
      "of a result. The distance along the ray is joined from the detector's, from the height of "
      "its 2D box with its 3D height and the size prior, and from the surface below, each with its "
      "standard deviation; what contradicts the others is left out. Height, pitch and roll come "
      "from the patch below. Rows that the surface does not cover, or whose frame its run does not "
      "know, are corrected by their 2D box alone, or stay as they were. Pitch, roll, the new "
      "distance's standard deviation and what it was made of go to a side file, OUT with the "
      "extension .tilt.csv.",
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
  command->run = [command, arguments] {
    const Arguments& args = *arguments;
    std::vector<fs::path> inputs = args.calibration;
    inputs.insert(inputs.end(), {args.labels, args.surface});
    refuse_own_inputs({args.out, tilt_file(args.out)}, inputs);
    Timings timings;
    KittiLabelFile labels;
    RoadSurface surface;
    RunDocument run;
    KittiCalibration::Camera camera;
    {
      const StageTimer timer(timings, "load");
      labels = read_kitti_labels(args.labels);
      surface = surface_without_vehicles(read_camera_surface(args.surface));
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
    int boxes = 0, on_surface = 0, by_box = 0;
    {
      const StageTimer timer(timings, "compute");
      for (const KittiLabel& label : labels.labels) {
        const int frame = label.frame >= 0 ? label.frame : args.frame.value_or(reference);
        const auto at = cameras.find(frame);
        std::optional<SE3> camera_from_reference;
        if (at != cameras.end()) camera_from_reference = at->second;
        LiftedBox box = lift_box(label, surface, camera_from_reference, camera, args.options);
        boxes += label.has_box3() && !label.dont_care() ? 1 : 0;
        on_surface += box.by_surface ? 1 : 0;
        by_box += box.by_box && !box.by_surface ? 1 : 0;
        lifted.push_back(std::move(box));
      }
    }
    if (on_surface == 0) {
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
                               {"depth_sigma", args.options.depth_sigma},
                               {"size_sigma", args.options.size_sigma},
                               {"box_sigma", args.options.box_pixel_sigma}}},
                             {"boxes", boxes},
                             {"lifted", on_surface},
                             {"by_box", by_box},
                             {"rows", rows_json(lifted)}};
      for (const auto& [stage, milliseconds] : timings.stages()) {
        json["timings_ms"][stage] = milliseconds;
      }
      std::printf("%s\n", json.dump(2).c_str());
    } else if (!command->common.quiet) {
      std::printf("%s: %d of %d boxes put on the surface, %d more corrected by their 2D box\n",
                  args.out.c_str(), on_surface, boxes, by_box);
    }
    return 0;
  };
}

}  // namespace camber::tools
