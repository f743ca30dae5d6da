// drive and calibrate: whole drives.

#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <string>
#include <utility>

#include "camber/calibrate/write_calibration.h"
#include "camber/core/atomic_file.h"
#include "camber/core/hash.h"
#include "camber/drive/drive_scene.h"
#include "camber/pipeline/find_vehicles.h"
#include "camber/scene/scene_files.h"
#include "convert.h"
#include "networks.h"
#include "running.h"
#include "scene.h"

namespace fs = std::filesystem;

namespace camber::python {
namespace {

void bind_drive(py::module_& module) {
  module.def(
      "drive",
      [](const PythonScene& scene, const fs::path& out, const std::string& frames, bool masks,
         bool calibrate, bool pictures, const std::optional<fs::path>& film, bool overwrite,
         bool resume, const fs::path& detector, const fs::path& detector_config,
         const fs::path& keypoints, const fs::path& keypoints_config,
         const std::optional<fs::path>& cache, std::uint64_t seed, int threads,
         const py::object& progress) {
        DriveSceneOptions options;
        options.networks =
            network_choice(detector, detector_config, "", "", keypoints, keypoints_config, cache);
        options.networks.validate();
        options.drive.window.seed = seed;
        options.drive.window.num_threads = threads;
        options.drive.window.load.use_masks = masks;
        options.drive.window.load.pixels = scene.source();
        options.frames = frames;
        options.calibrates = calibrate;
        options.pictures = pictures;
        if (film) options.film = *film;
        options.overwrite = overwrite;
        options.resume = resume;
        options.command = "camber.drive";
        options.manifest = scene.path;
        if (!scene.path.empty()) {
          fs::path manifest = scene.path;
          if (fs::is_directory(manifest)) manifest /= "scene.json";
          options.manifest_hash = hash_file(manifest);
          options.inputs = files_of(scene.scene);
          options.inputs.push_back(manifest);
        }
        options.notice = python_log();
        options.warn = python_warnings();
        const Progress report = to_progress(progress);
        const DriveOutcome outcome =
            compute([&] { return drive_scene(scene.scene, out, options, report); });
        return to_python(*outcome.run);
      },
      py::arg("scene"), py::arg("out"), py::kw_only(), py::arg("frames") = "",
      py::arg("masks") = true, py::arg("calibrate") = true, py::arg("pictures") = true,
      py::arg("film") = py::none(), py::arg("overwrite") = false, py::arg("resume") = false,
      py::arg("detector") = "", py::arg("detector_config") = "", py::arg("keypoints") = "",
      py::arg("keypoints_config") = "", py::arg("cache") = py::none(), py::arg("seed") = 0,
      py::arg("threads") = 0, py::arg("progress") = py::none(),
      with_keywords(
          "A whole drive into a folder, as camber drive writes it (but trajectory.gpx). Gives the "
          "folder's run.json.",
          {{"out", "folder of the result"},
           {"frames", "ids: '48:200', '0:400:2'; '': all"},
           {"masks", "False: segmentations and road masks are not read"},
           {"calibrate", "False: a camera that is guessed stays so"},
           {"pictures", "False: no film, plots and report"},
           {"film", "FILE.mp4 or FILE.avi; None: film.mp4 in the folder"},
           {"overwrite", "replaces a folder that is no result, too"},
           {"resume", "goes on with what an interrupted run of the same drive left"},
           {"detector",
            "finds vehicles: 'shipped', an ONNX file or 'none'; '': the one that "
            "ships, where the scene has no boxes"},
           {"keypoints",
            "finds the 36 keypoints: 'shipped', an ONNX file or 'none'; '': the one "
            "that ships, where no vehicle has keypoints"},
           {"cache", "folder that keeps results of networks; None: as the program's; '': none"},
           {"progress",
            "called with the stage's name and the share done; an exception ends the "
            "run, which another call with resume goes on with"}})
          .c_str());
}

py::dict number_of(double value, double sigma) {
  py::dict out;
  out["value"] = value;
  out["sigma"] = sigma;
  return out;
}

py::object known_or_none(const std::optional<MountingNumber>& number) {
  return number ? py::object(number_of(number->value, number->sigma)) : py::object(py::none());
}

/// Of what is known, value and sigma; angles in rad, the height in m.
py::dict to_dict(const DriveCalibration& c) {
  const DriveLens& lens = c.lens.lens;
  py::dict out;
  out["width"] = lens.width;
  out["height"] = lens.height;
  out["focal"] = number_of(lens.f, lens.f * c.lens.sigma(0));
  out["cx"] = number_of(lens.cx, c.lens.sigma(1));
  out["cy"] = number_of(lens.cy, c.lens.sigma(2));
  out["k1"] = number_of(lens.k1, c.lens.sigma(3));
  out["k2"] = number_of(lens.k2, c.lens.sigma(4));
  out["focal_decided_by"] = c.focal_decided_by;
  out["pitch"] = known_or_none(c.mounting.pitch);
  out["yaw"] = known_or_none(c.mounting.yaw);
  out["roll"] = known_or_none(c.mounting.roll);
  out["height"] = known_or_none(c.mounting.height);
  out["frames"] = c.frames;
  out["windows"] = c.windows;
  out["height_by"] = c.mounting.height_by;
  py::list sources;
  for (const CameraSource& source : c.sources) {
    py::dict entry;
    entry["name"] = source.name;
    entry["source"] = source.phrase;
    entry["accepted"] = source.accepted;
    entry["sigma"] = source.sigma;
    entry["residual_sigma"] = source.residual_sigma;
    sources.append(std::move(entry));
  }
  out["sources"] = std::move(sources);
  out["notes"] = c.notes;
  return out;
}

void bind_calibrate(py::module_& module) {
  module.def(
      "calibrate",
      [](const PythonScene& scene, const std::optional<fs::path>& out,
         const std::optional<fs::path>& scene_out, const std::string& frames, std::uint64_t seed,
         int threads, const py::object& progress) {
        CalibrateOptions options;
        options.seed = seed;
        options.num_threads = threads;
        options.find_vehicles = vehicle_finder({}, threads, scene.source());
        options.validate();
        const Progress report = to_progress(progress);
        const DriveCalibration found = compute([&] {
          DriveCalibration result = calibrate_drive(scene.scene, select_frames(scene.scene, frames),
                                                    options, scene.source(), report);
          if (scene_out) write_scene(calibrated_scene(scene.scene, result), *scene_out);
          if (out) write_file_atomically(*out, calibration_yaml(result, scene.path));
          return result;
        });
        return to_dict(found);
      },
      py::arg("scene"), py::arg("out") = py::none(), py::kw_only(),
      py::arg("scene_out") = py::none(), py::arg("frames") = "", py::arg("seed") = 0,
      py::arg("threads") = 0, py::arg("progress") = py::none(),
      with_keywords("The camera from its own drive, as camber calibrate estimates it: a dict of "
                    "value and sigma each (px, rad), and what decided. A calibration that the "
                    "scene has is not used.",
                    {{"out", "calibration to write, OpenCV's YAML"},
                     {"scene_out", "manifest to write (.json) of the scene with that camera"},
                     {"frames", "ids: '48:200', '0:400:2'; '': all"}})
          .c_str());
}

}  // namespace

void bind_drives(py::module_& module) {
  bind_drive(module);
  bind_calibrate(module);
}

}  // namespace camber::python
