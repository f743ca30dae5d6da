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

struct Inputs {
  KittiLabelFile labels;
  RoadSurface surface;
  std::map<int, SE3> cameras;  ///< camera_from_reference by frame id
  int reference = 0;           ///< frame id
  KittiCalibration::Camera camera;
};

Inputs load(const Arguments& args) {
  Inputs in;
  in.labels = read_kitti_labels(args.labels);
  if (args.frame && in.labels.form == KittiLabelForm::kTracking && !in.labels.labels.empty()) {
    throw UsageError(fmt::format("--frame {}: {} is of the tracking form, whose rows have frames",
                                 *args.frame, args.labels));
  }
  in.surface = surface_without_vehicles(read_camera_surface(args.surface));
  const RunDocument run = read_run(road_folder(args.surface) / "run.json");
  for (const RunDocument::CameraPose& c : run.cameras) {
    in.cameras[c.id] = c.reference_from_camera.inverse();
    if (c.reference_from_camera.translation().norm() == 0.0) in.reference = c.id;
  }
  in.camera = read_kitti_calibration(args.calibration).camera(args.camera);
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
  app.add_option("labels", a.labels, "KITTI label file, tracking or object form")->required();
  app.add_option("--surface", a.surface, "result folder of reconstruct")->required();
  app.add_option("--calib", a.calibration, "KITTI calibration file(s)")->required();
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
      "Puts the 3D boxes of a monocular detector (KITTI label form, yaw only) on the road surface "
      "of a result. The distance along the ray is joined from the detector's, from the height of "
      "its 2D box with its 3D height and the size prior, and from the surface below, each with its "
      "standard deviation; what contradicts the others is left out. Height, pitch and roll come "
      "from the patch below. Rows that the surface does not cover, or whose frame its run does not "
      "know, are corrected by their 2D box alone, or stay as they were, beside rows that are put "
      "on it; a file of which it covers no row is refused (exit code 1). Pitch, roll, the new "
      "distance's standard deviation and what it was made of go to a side file, OUT with the "
      "extension .tilt.csv.",
      "  camber lift detector/0009.txt --surface out/0009 --calib calib/0009.txt --out lifted.txt\n"
      "  camber lift 000050.txt --frame 50 --surface out/0009 --calib calib.txt --out lifted.txt "
      "--depth-sigma 0.1");
  const auto arguments = std::make_shared<Arguments>();
  add_arguments(*command->app, *arguments);
  command->run = [command, arguments] { return run(*command, *arguments); };
}

}  // namespace camber::tools
