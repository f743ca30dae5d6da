#include "camber/import/import_synthia.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <set>
#include <stdexcept>

#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "camber/core/lower_case.h"
#include "camber/core/made_folder.h"
#include "camber/core/threads.h"
#include "camber/image/image_io.h"
#include "camber/import/import_common.h"
#include "camber/import/vehicles_from_depth.h"
#include "camber/scene/validate_scene.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

constexpr int kFullWidth = 1920, kFullHeight = 1080;
constexpr double kFocalLength = 847.630211643;  // px, of the data set's README

std::map<int, fs::path> optional_files(const fs::path& folder, const char* what) {
  std::error_code error;
  if (!fs::exists(folder, error)) return {};
  return numbered_files(folder, {".png"}, what);
}

/// What GTLeft has of one frame.
struct Labels {
  Image classes;
  std::vector<std::uint16_t> instances;  ///< green + 256 blue; empty: the image has one channel
};

Labels read_labels(const fs::path& file, const PinholeCamera& camera) {
  Labels out;
  const ImageInfo info = read_image_info(file);
  out.classes = read_label_channel(file, 0);
  if (out.classes.width != camera.width || out.classes.height != camera.height) {
    throw InputError(
        file.string(),
        fmt::format("found an image of {} x {} pixels, expected {} x {} as its "
                    "colour image",
                    out.classes.width, out.classes.height, camera.width, camera.height));
  }
  if (info.channels < 3) return out;
  const Image green = read_label_channel(file, 1), blue = read_label_channel(file, 2);
  out.instances.reserve(green.data.size());
  for (std::size_t i = 0; i < green.data.size(); ++i) {
    out.instances.push_back(static_cast<std::uint16_t>(green.data[i] + 256 * blue.data[i]));
  }
  return out;
}

const std::map<int, std::string>& vehicle_classes() {
  static const std::map<int, std::string> classes = {
      {kSynthiaCar, "car"}, {kSynthiaTruck, "truck"}, {kSynthiaBus, "bus"}};
  return classes;
}

/// Whether green and blue number the vehicles: in some frame they differ within a class. Where they
/// do not, they are the class's colour, or nothing.
bool have_instances(const std::map<int, fs::path>& labels, const std::vector<SceneFrame>& frames,
                    const PinholeCamera& camera) {
  for (const SceneFrame& frame : frames) {
    const auto file = labels.find(frame.id);
    if (file == labels.end()) continue;
    const Labels read = read_labels(file->second, camera);
    std::map<int, std::uint16_t> first;
    for (std::size_t i = 0; i < read.instances.size(); ++i) {
      const int id = read.classes.data[i];
      if (!vehicle_classes().count(id)) continue;
      if (first.emplace(id, read.instances[i]).first->second != read.instances[i]) return true;
    }
  }
  return false;
}

/// The vehicles of a frame, fitted to its depth.
std::vector<TruthVehicle> fitted_vehicles(const DepthImage& depth, const Labels& labels,
                                          bool instances, const PinholeCamera& camera) {
  const LabelledDepth image{&depth,
                            &labels.classes,
                            {kSynthiaRoad, kSynthiaRoadLines, kSynthiaSidewalk, kSynthiaTerrain}};
  std::set<int> classes;
  for (const auto& [id, name] : vehicle_classes()) classes.insert(id);
  std::vector<TruthVehicle> out;
  std::set<int> ids;
  for (const VehicleRegion& region :
       vehicle_regions(depth, labels.classes,
                       instances ? labels.instances : std::vector<std::uint16_t>(), classes)) {
    std::optional<TruthVehicle> vehicle =
        fit_vehicle_to_depth(region, image, camera, vehicle_classes().at(region.class_id));
    if (!vehicle) continue;
    vehicle->id = instances ? region.instance : static_cast<int>(out.size());
    while (!ids.insert(vehicle->id).second) vehicle->id += 1 << 16;  // one number, two classes
    out.push_back(std::move(*vehicle));
  }
  return out;
}

/// Truth of the scene's frames, their vehicles side by side; the label images are staged.
SceneTruth read_truth(const SynthiaSfImportOptions& options, const Scene& scene,
                      const std::map<int, fs::path>& depths, const std::map<int, fs::path>& labels,
                      const fs::path& manifest, std::optional<MadeFolder>* made,
                      AtomicFiles* files) {
  const bool instances = have_instances(labels, scene.frames, scene.camera);
  const fs::path label_folder =
      (manifest.has_parent_path() ? manifest.parent_path() : fs::path(".")) / "label";
  std::vector<TruthFrame> frames(scene.frames.size());
  std::vector<fs::path> staged(frames.size());
  for (std::size_t i = 0; i < frames.size(); ++i) {
    frames[i].id = scene.frames[i].id;
    if (const auto depth = depths.find(frames[i].id); depth != depths.end()) {
      frames[i].depth = depth->second;
      frames[i].depth_encoding = "synthia";
    }
    if (!labels.count(frames[i].id)) continue;
    frames[i].label = label_folder / fmt::format("{:06}.png", frames[i].id);
    if (!*made) made->emplace(label_folder);
    staged[i] = files->stage(frames[i].label);
  }
  parallel_for(frames.size(), options.num_threads, [&](std::size_t i) {
    TruthFrame& frame = frames[i];
    if (frame.label.empty()) return;
    const Labels read = read_labels(labels.at(frame.id), scene.camera);
    write_png(read.classes, staged[i]);
    if (frame.depth.empty()) return;
    frame.vehicles =
        fitted_vehicles(read_depth_image(frame.depth, frame.depth_encoding, scene.camera), read,
                        instances, scene.camera);
  });
  SceneTruth truth;
  for (TruthFrame& frame : frames) {
    if (!frame.vehicles.empty()) truth.vehicles_source = "depth_fit";
    if (!frame.depth.empty() || !frame.label.empty()) truth.frames.push_back(std::move(frame));
  }
  return truth;
}

}  // namespace

PinholeCamera synthia_sf_camera(int width, int height) {
  if (width <= 0 ||
      static_cast<long long>(width) * kFullHeight != static_cast<long long>(height) * kFullWidth) {
    throw std::invalid_argument(
        fmt::format("an image of {} x {} pixels, expected the shape of SYNTHIA-SF's 1920 x 1080",
                    width, height));
  }
  const double scale = static_cast<double>(width) / kFullWidth;
  // Pixel centres are integers: a corner of the image is at -0.5 in every size.
  return {width,
          height,
          kFocalLength * scale,
          kFocalLength * scale,
          (0.5 * kFullWidth + 0.5) * scale - 0.5,
          (0.5 * kFullHeight + 0.5) * scale - 0.5};
}

void SynthiaSfImportOptions::validate() const {
  const auto positive = [](const std::optional<double>& value, const char* what) {
    if (value && (!(*value > 0.0) || !std::isfinite(*value))) {
      throw std::invalid_argument(fmt::format("{} {}, expected a positive number", what, *value));
    }
  };
  if (camera_height) validate_camera_height(*camera_height);
  positive(frame_rate, "frame_rate");
  if (classes.empty()) throw std::invalid_argument("classes is empty, expected at least one type");
}

Scene import_synthia_sf_to(const SynthiaSfImportOptions& options, const fs::path& manifest,
                           const LogSink& warn) {
  options.validate();
  const auto images = numbered_files(options.sequence / "RGBLeft", {".png", ".jpg"}, "images");
  const auto depths = optional_files(options.sequence / "DepthLeft", "depth images");
  const auto labels = optional_files(options.sequence / "GTLeft", "label images");

  Scene scene;
  fs::path folder = fs::absolute(options.sequence).lexically_normal();
  if (!folder.has_filename()) folder = folder.parent_path();
  scene.name = options.name.empty() ? folder.filename().string() : options.name;
  scene.height_above_road = options.camera_height;
  if (options.height_sigma) scene.height_sigma = *options.height_sigma;
  scene.frame_rate = options.frame_rate;
  for (const auto& [number, file] : images) {
    SceneFrame frame;
    frame.id = number;
    if (options.frame_rate) frame.time_s = number / *options.frame_rate;
    frame.image = file;
    scene.frames.push_back(std::move(frame));
  }
  const std::vector<int> selected = keep_frames(scene, options.frames);
  measure_images(scene);
  try {
    scene.camera = synthia_sf_camera(scene.camera.width, scene.camera.height);
  } catch (const std::invalid_argument& error) {
    throw InputError(scene.frames.front().image.string(), std::string("found ") + error.what());
  }
  if (options.reference_frame) {
    if (!scene.find_frame(*options.reference_frame)) {
      throw UsageError(fmt::format("reference frame {} is not among the frames {} to {}",
                                   *options.reference_frame, selected.front(), selected.back()));
    }
    scene.reference_frame = options.reference_frame;
  }
  if (!options.detections.empty()) {
    std::set<std::string> classes;
    for (const std::string& name : options.classes) classes.insert(lower_case(name));
    put_detections(scene, options.detections, classes, warn);
  }
  if (options.segmentation_from_labels) {
    scene.segmentation_source = "truth";
    scene.segmentation_classes = {{"road", {kSynthiaRoad, kSynthiaRoadLines}},
                                  {"pavement", {kSynthiaSidewalk}},
                                  {"vehicle", {kSynthiaCar, kSynthiaTruck, kSynthiaBus}}};
  }

  std::optional<MadeFolder> made;
  AtomicFiles files;
  SceneTruth truth = read_truth(options, scene, depths, labels, manifest, &made, &files);
  if (options.segmentation_from_labels) {
    for (SceneFrame& frame : scene.frames) {
      const auto at = std::find_if(truth.frames.begin(), truth.frames.end(),
                                   [&](const TruthFrame& t) { return t.id == frame.id; });
      if (at == truth.frames.end() || at->label.empty()) {
        throw InputError((options.sequence / "GTLeft").string(),
                         fmt::format("found no label image of frame {}, expected one for the "
                                     "segmentation",
                                     frame.id));
      }
      frame.segmentation = at->label;
    }
  }
  if (!truth.frames.empty()) scene.truth = std::move(truth);
  const fs::path staged = files.stage(manifest);
  write_scene(scene, staged);
  files.commit();
  if (made) made->keep();
  return scene;
}

}  // namespace camber
