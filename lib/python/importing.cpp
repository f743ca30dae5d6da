// detect, import_images and import_video: scenes out of pictures and networks.

#include <string>
#include <utility>

#include "camber/core/made_folder.h"
#include "camber/import/import_own.h"
#include "camber/pipeline/write_detected_scene.h"
#include "convert.h"
#include "maps.h"
#include "networks.h"
#include "running.h"
#include "scene.h"

namespace fs = std::filesystem;

namespace camber::python {
namespace {

using Number = std::optional<double>;

// What both imports take, as OwnDataOptions has it.
#define CAMBER_OWN_PARAMETERS                                                                    \
  const fs::path &calibration, const std::string &camera_name, bool rectified, Number fx,        \
      Number fy, Number cx, Number cy, Number fov_deg, Number fov_sigma_deg, Number height,      \
      Number height_sigma, const fs::path &detections, const fs::path &class_names,              \
      const fs::path &masks, const std::string &class_map, const fs::path &poses,                \
      double pose_scale, const fs::path &speed, const std::string &speed_offset,                 \
      const fs::path &up, double up_sigma, const fs::path &gnss, const std::string &gnss_offset, \
      double gnss_sigma, const std::optional<Eigen::Vector3d>&antenna, const std::string &crs,   \
      const std::string &frames, std::optional<int> reference_frame, const std::string &name,    \
      bool guess
#define CAMBER_OWN_NAMES                                                                 \
  calibration, camera_name, rectified, fx, fy, cx, cy, fov_deg, fov_sigma_deg, height,   \
      height_sigma, detections, class_names, masks, class_map, poses, pose_scale, speed, \
      speed_offset, up, up_sigma, gnss, gnss_offset, gnss_sigma, antenna, crs, frames,   \
      reference_frame, name, guess
#define CAMBER_OWN_ARGUMENTS                                                                     \
  py::arg("calibration") = "", py::arg("camera_name") = "", py::arg("rectified") = false,        \
  py::arg("fx") = py::none(), py::arg("fy") = py::none(), py::arg("cx") = py::none(),            \
  py::arg("cy") = py::none(), py::arg("fov_deg") = py::none(),                                   \
  py::arg("fov_sigma_deg") = py::none(), py::arg("height") = py::none(),                         \
  py::arg("height_sigma") = py::none(), py::arg("detections") = "", py::arg("class_names") = "", \
  py::arg("masks") = "", py::arg("class_map") = "", py::arg("poses") = "",                       \
  py::arg("pose_scale") = 1.0, py::arg("speed") = "", py::arg("speed_offset") = "",              \
  py::arg("up") = "", py::arg("up_sigma") = OwnDataOptions().up_sigma, py::arg("gnss") = "",     \
  py::arg("gnss_offset") = "", py::arg("gnss_sigma") = GnssOptions().sigma,                      \
  py::arg("antenna") = py::none(), py::arg("crs") = "", py::arg("frames") = "",                  \
  py::arg("reference_frame") = py::none(), py::arg("name") = "", py::arg("guess") = false

fs::path manifest_of(const fs::path& out) {
  return out.extension() == ".json" ? out : out / "scene.json";
}

OwnDataOptions own_options(CAMBER_OWN_PARAMETERS) {
  OwnDataOptions out;
  out.camera.calibration = calibration;
  out.camera.name = camera_name;
  out.camera.rectified = rectified;
  out.camera.fx = fx;
  out.camera.fy = fy;
  out.camera.cx = cx;
  out.camera.cy = cy;
  out.camera.fov_deg = fov_deg;
  out.camera.fov_sigma_deg = fov_sigma_deg;
  out.camera.guess = guess;
  out.height = height;
  out.height_sigma = height_sigma;
  out.detections.file = detections;
  out.detections.class_names = class_names;
  out.masks = masks;
  out.class_map = class_map;
  out.poses = poses;
  out.pose_scale = pose_scale;
  out.speed = speed;
  out.speed_offset = speed_offset;
  out.up = up;
  out.up_sigma = up_sigma;
  out.gnss.file = gnss;
  out.gnss.offset = gnss_offset;
  out.gnss.sigma = gnss_sigma;
  if (antenna) out.gnss.antenna = *antenna;
  if (gnss.empty() && (antenna || !crs.empty() || !gnss_offset.empty())) {
    throw std::invalid_argument("gnss: expected it beside gnss_offset, antenna and crs");
  }
  if (!crs.empty()) out.gnss.crs = map_definition(crs, "crs");
  out.gnss.heading_sigma = up_sigma;
  out.gnss.projection = map_projection("crs");
  out.frames = frames;
  out.reference_frame = reference_frame;
  out.name = name;
  return out;
}

const std::vector<std::pair<const char*, const char*>>& own_words() {
  static const std::vector<std::pair<const char*, const char*>> kWords = {
      {"out", "manifest to write (.json), or its folder"},
      {"calibration", "file of the camera; else fx (fy, cx, cy) in px, or fov_deg"},
      {"camera_name", CAMBER_DOC(OwnCamera, name)},
      {"rectified", CAMBER_DOC(OwnCamera, rectified)},
      {"fov_deg", CAMBER_DOC(OwnCamera, fov_deg)},
      {"fov_sigma_deg", CAMBER_DOC(OwnCamera, fov_sigma_deg)},
      {"height", CAMBER_DOC(OwnDataOptions, height)},
      {"height_sigma", "m, of height"},
      {"detections", "boxes of another program, a file or a folder"},
      {"class_names", CAMBER_DOC(OwnDetections, class_names)},
      {"masks", CAMBER_DOC(OwnDataOptions, masks)},
      {"class_map", CAMBER_DOC(OwnDataOptions, class_map)},
      {"poses", "known poses of the camera in metres"},
      {"pose_scale", CAMBER_DOC(OwnDataOptions, pose_scale)},
      {"speed", "speeds: CSV, GPX, NMEA, RTKLIB, or a folder of KITTI's oxts"},
      {"speed_offset", CAMBER_DOC(OwnDataOptions, speed_offset)},
      {"up", "roll and pitch of the vehicle: CSV, or a folder of KITTI's oxts"},
      {"up_sigma", "rad, of up, and of headings in gnss"},
      {"gnss", "positions on the earth: GPX, NMEA, RTKLIB, CSV, or a folder of KITTI's oxts"},
      {"gnss_offset", CAMBER_DOC(GnssOptions, offset)},
      {"gnss_sigma", CAMBER_DOC(GnssOptions, sigma)},
      {"antenna", CAMBER_DOC(GnssOptions, antenna)},
      {"crs", "the map of gnss: EPSG:n or a definition; '': the UTM zone of the first position"},
      {"frames", "ids to keep: '48,49', '48:52', '0:100:5'; '': all"},
      {"guess", "a camera of which nothing is given is guessed, as reconstruct of a film does"}};
  return kWords;
}

/// Writes the import, all or nothing. @return the scene, as read_scene() gives it.
template <typename Import>
PythonScene written(const fs::path& out, const Import& import) {
  const fs::path manifest = manifest_of(out);
  const fs::path folder = manifest.has_parent_path() ? manifest.parent_path() : fs::path(".");
  return compute([&] {
    MadeFolder made(folder);
    OwnImport own = import(manifest);
    write_own_import(own, manifest);
    made.keep();
    PythonScene scene;
    scene.scene = std::move(own.scene);
    scene.path = fs::absolute(manifest).lexically_normal().string();
    return scene;
  });
}

void bind_imports(py::module_& module) {
  module.def(
      "import_images",
      [](const std::vector<std::string>& images, const fs::path& out, Number rate,
         const fs::path& times, bool times_from_names, CAMBER_OWN_PARAMETERS) {
        OwnDataOptions own = own_options(CAMBER_OWN_NAMES);
        own.times.rate = rate;
        own.times.list = times;
        own.times.from_names = times_from_names;
        own.validate();
        return written(
            out, [&](const fs::path&) { return import_images(images, own, python_warnings()); });
      },
      py::arg("images"), py::arg("out"), py::kw_only(), py::arg("rate") = py::none(),
      py::arg("times") = "", py::arg("times_from_names") = false, CAMBER_OWN_ARGUMENTS,
      with_keywords("Images as a scene, as camber import images writes it.",
                    [] {
                      auto words = own_words();
                      words.insert(words.begin(), {"images", "folders, patterns and files"});
                      words.emplace_back("rate", CAMBER_DOC(OwnTimes, rate));
                      return words;
                    }())
          .c_str());
  module.def(
      "import_video",
      [](const fs::path& video, const fs::path& out, int every, Number start, Number end,
         bool extract, bool telemetry, Number telemetry_offset, CAMBER_OWN_PARAMETERS) {
        VideoChoice choice;
        choice.every = every;
        choice.from = start;
        choice.to = end;
        choice.extract = extract;
        choice.validate();
        OwnDataOptions own = own_options(CAMBER_OWN_NAMES);
        own.telemetry = {telemetry, telemetry_offset};
        own.validate();
        return written(out, [&](const fs::path& manifest) {
          return import_video(video, choice, own, manifest);
        });
      },
      py::arg("video"), py::arg("out"), py::kw_only(), py::arg("every") = 1,
      py::arg("start") = py::none(), py::arg("end") = py::none(), py::arg("extract") = false,
      py::arg("telemetry") = true, py::arg("telemetry_offset") = py::none(), CAMBER_OWN_ARGUMENTS,
      with_keywords("A film as a scene, as camber import video writes it.",
                    [] {
                      auto words = own_words();
                      words.emplace_back("every", CAMBER_DOC(VideoChoice, every));
                      words.emplace_back("start", "s since the first frame; None: its start");
                      words.emplace_back("end", "s, inclusive; None: its end");
                      words.emplace_back("extract", CAMBER_DOC(VideoChoice, extract));
                      words.emplace_back("telemetry",
                                         "take what the camera recorded with the film: positions, "
                                         "speeds, gravity");
                      words.emplace_back("telemetry_offset",
                                         "s, added to its times; of a GPX or NMEA log beside the "
                                         "film when its first position was, since the first frame");
                      return words;
                    }())
          .c_str());
}

/// Label images of a network as arrays of the scene.
void hold_labels(NetworkView& view, PythonScene* scene) {
  for (auto& [id, labels] : view.labels) {
    const std::vector<py::ssize_t> shape = {labels.height, labels.width};
    scene->pixels[id].segmentation = py::array_t<std::uint8_t>(shape, labels.data.data());
  }
}

PythonScene detected(const PythonScene& given, const std::optional<std::vector<int>>& frames,
                     const fs::path& out, const NetworkChoice& choice, int threads,
                     const py::object& progress) {
  DetectFramesOptions options = detect_options(choice, threads);
  FindKeypointsOptions keypoints = keypoint_options(choice, threads);
  options.pixels = keypoints.pixels = given.source();
  if (options.networks.empty() && keypoints.choice != KeypointChoice::kAll) {
    throw std::invalid_argument("detect: expected detector, segmenter or keypoints");
  }
  if (!out.empty() && !given.pixels.empty()) {
    throw std::invalid_argument("out: found a scene of images in memory, expected one of files");
  }
  const Progress report = to_progress(progress);
  PythonScene made = given;
  NetworkView view;
  compute([&] {
    const std::vector<int> ids = frames ? *frames : select_frames(given.scene, "all");
    if (!options.networks.empty()) {
      view = detect_frames(given.scene, ids, options, report, python_warnings());
    }
    put_network_view(view, &made.scene);
    find_keypoints(&made.scene, ids, keypoints, report, python_warnings());
    if (out.empty()) return;
    const fs::path manifest = manifest_of(out);
    MadeFolder folder(manifest.has_parent_path() ? manifest.parent_path() : fs::path("."));
    made.scene = write_detected_scene(made.scene, view, manifest);
    folder.keep();
    made.path = fs::absolute(manifest).lexically_normal().string();
  });
  if (out.empty()) hold_labels(view, &made);
  return made;
}

}  // namespace

void bind_importing(py::module_& module) {
  bind_imports(module);
  module.def(
      "detect",
      [](const PythonScene& scene, const std::optional<std::vector<int>>& frames,
         const fs::path& out, const fs::path& detector, const fs::path& detector_config,
         const fs::path& segmenter, const fs::path& segmenter_config, const fs::path& keypoints,
         const fs::path& keypoints_config, const std::optional<fs::path>& cache, int threads,
         const py::object& progress) {
        return detected(scene, frames, out,
                        network_choice(detector, detector_config, segmenter, segmenter_config,
                                       keypoints, keypoints_config, cache),
                        threads, progress);
      },
      py::arg("scene"), py::arg("frames") = py::none(), py::kw_only(), py::arg("out") = "",
      CAMBER_NETWORK_ARGUMENTS, py::arg("threads") = 0, py::arg("progress") = py::none(),
      with_keywords("A copy of a scene with what networks see in its frames.",
                    {{"frames", "ids; None: all"},
                     {"out", "manifest to write (.json), or its folder; '': none is written"},
                     {"detector", "'shipped', an ONNX file or '': boxes stay"},
                     {"segmenter", "ONNX file of a network that shows the road"},
                     {"keypoints", "'shipped' or an ONNX file: keypoints are replaced"},
                     {"cache", "folder that keeps results; None: as the program's; '': none"}})
          .c_str());
}

}  // namespace camber::python
