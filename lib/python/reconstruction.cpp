#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "camber/core/errors.h"
#include "camber/pipeline/reconstruct_scene.h"
#include "convert.h"
#include "networks.h"
#include "reconstruction.h"
#include "running.h"
#include "scene.h"

namespace fs = std::filesystem;

namespace camber::python {
namespace {

struct Keywords {
  std::string method, preset, paper_terms, paper_scale;
  int keypoint_set, rounds;
  bool photometric, masks, markings, road_width, vehicles, tracks, calibrate;
  std::uint64_t seed;
  int threads;
};

ReconstructOptions options_of(const Keywords& k) {
  ReconstructOptions options;
  options.seed = k.seed;
  options.num_threads = k.threads;
  options.rounds = k.rounds;
  options.photometric = k.photometric;
  options.load.use_masks = k.masks;
  options.scale.use_markings = k.markings;
  options.scale.use_road_width = k.road_width;
  options.vehicles.method = vehicle_method_from_string(k.method);
  options.vehicles.enabled = k.vehicles;
  options.vehicles.tracks = k.tracks;
  if (k.keypoint_set != 36 && k.keypoint_set != 14) {
    throw std::invalid_argument(
        fmt::format("keypoint_set: found {}, expected 36 or 14", k.keypoint_set));
  }
  options.vehicles.fit.keypoint_set = static_cast<KeypointSet>(k.keypoint_set);
  options.preset = preset_from_string(k.preset);
  options.paper.vehicles.terms = paper::terms_from_string(k.paper_terms);
  options.paper.ground.scale = paper_scale_from_string(k.paper_scale);
  options.validate();
  return options;
}

PythonReconstruction run(const PythonScene& scene, const std::optional<std::vector<int>>& frames,
                         const Keywords& keywords, const NetworkChoice& networks,
                         const py::object& progress) {
  ReconstructSceneOptions options;
  options.run = options_of(keywords);
  options.run.load.pixels = scene.source();
  if (frames) {
    options.frames = *frames;
    if (frames->empty()) throw std::invalid_argument("frames: found none, expected ids");
  }
  options.networks = networks;
  options.networks.validate();
  options.places_vehicles = keywords.vehicles;
  options.calibrates = keywords.calibrate;
  options.notice = python_log();
  options.warn = python_warnings();
  const Progress report = to_progress(progress);
  SceneReconstruction found =
      compute([&] { return reconstruct_scene(scene.scene, options, report); });
  PythonReconstruction out{std::move(found.result), std::move(found.scene),
                           std::move(found.calibrated)};
  out.run.scene = scene.path;
  return out;
}

void bind_result(py::module_& module) {
  using R = PythonReconstruction;
  py::class_<R>(module, "Reconstruction", kDoc_Reconstruction)
      .def_readonly("frame_ids", &R::frame_ids)
      .def_readonly("reference_frame", &R::reference_frame,
                    CAMBER_DOC(Reconstruction, reference_frame))
      .def_readonly("cloud", &R::cloud, CAMBER_DOC(Reconstruction, cloud))
      .def_readonly("surface", &R::surface, "planar patches, their graph and the driven line")
      .def_readonly("vehicles", &R::vehicles, "vehicles of each frame, in its camera")
      .def_readonly("run", &R::run, "motion, scale, constraints, timings")
      .def_property_readonly(
          "images",
          [](const py::object& self) {
            py::list out;
            for (Image& image : self.cast<R&>().images) out.append(view_of(image, self));
            return out;
          },
          CAMBER_DOC(Reconstruction, images))
      .def_property_readonly(
          "road_mask",
          [](const py::object& self) -> py::object {
            Image& mask = self.cast<R&>().road_mask;
            return mask.empty() ? py::object(py::none()) : view_of(mask, self);
          },
          CAMBER_DOC(Reconstruction, road_mask))
      .def(
          "write",
          [](R& self, const std::filesystem::path& folder, bool pictures, bool overwrite,
             const py::object& progress) {
            WriteReconstructionOptions options;
            options.pictures = pictures;
            options.overwrite = overwrite;
            if (self.calibrated) {
              self.run.scene = (fs::absolute(folder) / "scene" / "scene.json").lexically_normal();
              options.add_files = [&](const fs::path& staging) {
                fs::create_directories(staging / "scene");
                write_scene(*self.calibrated, staging / "scene" / "scene.json");
              };
            }
            const Progress report = to_progress(progress);
            return compute(
                [&] { return write_reconstruction(self.of, self, folder, options, report); });
          },
          py::arg("folder"), py::kw_only(), py::arg("pictures") = true,
          py::arg("overwrite") = false, py::arg("progress") = py::none(), kDoc_write_reconstruction)
      .def("__repr__", [](const R& r) {
        std::size_t vehicles = 0;
        for (const VehicleFrame& frame : r.vehicles.frames) vehicles += frame.vehicles.size();
        return fmt::format(
            "<camber.Reconstruction {} road points, {} patches, {} vehicles in {} frames, {}>",
            r.cloud.size(), r.surface.patches.size(), vehicles, r.frame_ids.size(),
            r.surface.metric ? fmt::format("scale +- {:.1f} %", 100.0 * r.surface.scale_sigma)
                             : "up to scale");
      });
}

}  // namespace

void bind_reconstruction(py::module_& module) {
  bind_result(module);
  py::class_<ChosenFrames>(module, "ChosenFrames", kDoc_ChosenFrames)
      .CAMBER_FIELD(ChosenFrames, ids)
      .CAMBER_FIELD(ChosenFrames, spacing)
      .CAMBER_FIELD(ChosenFrames, parallax_px)
      .CAMBER_FIELD(ChosenFrames, instead)
      .def("__repr__", [](const ChosenFrames& c) {
        return fmt::format(
            "<camber.ChosenFrames {} frames, {:.1f} px of parallax {} from the reference>",
            c.ids.size(), c.parallax_px, c.spacing);
      });
  module.def(
      "choose_frames",
      [](const PythonScene& scene, int each_side) {
        return compute([&] { return choose_frames(scene.scene, scene.source(), each_side); });
      },
      py::arg("scene"), py::arg("each_side") = 2, kDoc_ChosenFrames);
  const ReconstructOptions defaults;
  module.def(
      "reconstruct",
      [](const PythonScene& scene, const std::optional<std::vector<int>>& frames,
         const std::string& method, const std::string& preset, const std::string& paper_terms,
         const std::string& paper_scale, int keypoint_set, int rounds, bool photometric, bool masks,
         bool markings, bool road_width, bool vehicles, bool tracks, bool calibrate,
         const std::filesystem::path& detector, const std::filesystem::path& detector_config,
         const std::filesystem::path& segmenter, const std::filesystem::path& segmenter_config,
         const std::filesystem::path& keypoints, const std::filesystem::path& keypoints_config,
         const std::optional<std::filesystem::path>& cache, std::uint64_t seed, int threads,
         const py::object& progress) {
        return run(scene, frames,
                   {method, preset, paper_terms, paper_scale, keypoint_set, rounds, photometric,
                    masks, markings, road_width, vehicles, tracks, calibrate, seed, threads},
                   network_choice(detector, detector_config, segmenter, segmenter_config, keypoints,
                                  keypoints_config, cache),
                   progress);
      },
      py::arg("scene"), py::arg("frames") = py::none(), py::kw_only(), py::arg("method") = "joint",
      py::arg("preset") = "default", py::arg("paper_terms") = "meant",
      py::arg("paper_scale") = "ego", py::arg("keypoint_set") = 36,
      py::arg("rounds") = defaults.rounds, py::arg("photometric") = defaults.photometric,
      py::arg("masks") = defaults.load.use_masks, py::arg("markings") = defaults.scale.use_markings,
      py::arg("road_width") = defaults.scale.use_road_width,
      py::arg("vehicles") = defaults.vehicles.enabled, py::arg("tracks") = defaults.vehicles.tracks,
      py::arg("calibrate") = true, CAMBER_NETWORK_ARGUMENTS, py::arg("seed") = defaults.seed,
      py::arg("threads") = defaults.num_threads, py::arg("progress") = py::none(),
      with_keywords(
          (std::string(kDoc_reconstruct) +
           "\n\nFrames, networks and so the numbers are those of the program; what it decided on "
           "the way goes to the logger 'camber'. The process keeps freed memory from then on "
           "(glibc), for a run goes faster so.")
              .c_str(),
          {{"frames", "ids; None: those of choose_frames(), fewer where they give no answer"},
           {"method",
            "plane under the vehicles: 'joint' (local patch), 'coplanar' (ego plane), "
            "'flat' (level plane at the camera's height)"},
           {"preset", "'default', or 'paper': the paper's own method"},
           {"paper_terms", "of preset 'paper': 'meant' or 'printed'"},
           {"paper_scale", "of preset 'paper': 'ego' or 'patch'"},
           {"keypoint_set", "36 or 14"},
           {"rounds", CAMBER_DOC(ReconstructOptions, rounds)},
           {"photometric", CAMBER_DOC(ReconstructOptions, photometric)},
           {"masks", "False: segmentations and road masks are not read"},
           {"markings", CAMBER_DOC(ScaleOptions, use_markings)},
           {"road_width", CAMBER_DOC(ScaleOptions, use_road_width)},
           {"vehicles", "False: the road alone"},
           {"tracks", CAMBER_DOC(VehicleOptions, tracks)},
           {"calibrate", "False: a camera that is guessed stays so"},
           {"detector",
            "finds vehicles: 'shipped', an ONNX file or 'none'; '': the one that ships, where the "
            "scene has no boxes"},
           {"segmenter", "finds the road: an ONNX file; '': none"},
           {"keypoints",
            "finds the 36 keypoints: 'shipped', an ONNX file or 'none'; '': the one that ships, "
            "where no vehicle has keypoints"},
           {"detector_config", "its description; '': beside it"},
           {"cache",
            "folder that keeps results of networks; None: as the program's; '': "
            "nothing is kept"},
           {"threads", "0: all"},
           {"progress",
            "called with the stage's name and the share done; an exception ends the "
            "run"}})
          .c_str());
}

}  // namespace camber::python
