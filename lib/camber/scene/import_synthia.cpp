#include "camber/scene/import_synthia.h"

#include <fmt/format.h>

#include <cmath>
#include <set>
#include <stdexcept>

#include "camber/core/errors.h"
#include "camber/image/image_io.h"
#include "camber/scene/import_common.h"

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

/// Files that appear together: written under other names until all of them are there. What was
/// made is removed again unless kept.
class NewFiles {
 public:
  NewFiles() = default;
  ~NewFiles() {
    if (kept_) return;
    std::error_code ignored;
    for (auto at = made_.rbegin(); at != made_.rend(); ++at) fs::remove(*at, ignored);
  }
  NewFiles(const NewFiles&) = delete;
  NewFiles& operator=(const NewFiles&) = delete;
  void make_folder(const fs::path& folder) {
    std::error_code error;
    if (fs::create_directory(folder, error)) made_.push_back(folder);
  }
  /// Where to write a file for now.
  fs::path stage(const fs::path& file) {
    staged_.emplace_back(file.string() + ".part", file);
    made_.push_back(staged_.back().first);
    return staged_.back().first;
  }
  /// Gives the staged files their names.
  void appear() {
    for (const auto& [part, file] : staged_) {
      std::error_code error;
      if (!fs::exists(file, error)) made_.push_back(file);
      fs::rename(part, file, error);
      if (error) throw OutputError(file.string(), "cannot be written: " + error.message());
    }
  }
  void keep() { kept_ = true; }

 private:
  std::vector<fs::path> made_;
  std::vector<std::pair<fs::path, fs::path>> staged_;
  bool kept_ = false;
};

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
  positive(camera_height, "camera_height");
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

  NewFiles made;
  const fs::path label_folder =
      (manifest.has_parent_path() ? manifest.parent_path() : fs::path(".")) / "label";
  SceneTruth truth;
  for (SceneFrame& frame : scene.frames) {
    TruthFrame true_frame;
    true_frame.id = frame.id;
    if (const auto depth = depths.find(frame.id); depth != depths.end()) {
      true_frame.depth = depth->second;
      true_frame.depth_encoding = "synthia";
    }
    if (const auto label = labels.find(frame.id); label != labels.end()) {
      const Image classes = read_label_channel(label->second, 0);
      if (classes.width != scene.camera.width || classes.height != scene.camera.height) {
        throw InputError(
            label->second.string(),
            fmt::format("found an image of {} x {} pixels, expected {} x {} as its "
                        "colour image",
                        classes.width, classes.height, scene.camera.width, scene.camera.height));
      }
      true_frame.label = label_folder / fmt::format("{:06}.png", frame.id);
      made.make_folder(label_folder);
      write_png(classes, made.stage(true_frame.label));
      if (options.segmentation_from_labels) frame.segmentation = true_frame.label;
    } else if (options.segmentation_from_labels) {
      throw InputError((options.sequence / "GTLeft").string(),
                       fmt::format("found no label image of frame {}, expected one for the "
                                   "segmentation",
                                   frame.id));
    }
    if (!true_frame.depth.empty() || !true_frame.label.empty()) {
      truth.frames.push_back(std::move(true_frame));
    }
  }
  if (!truth.frames.empty()) scene.truth = std::move(truth);
  made.appear();
  write_scene(scene, manifest);
  made.keep();
  return scene;
}

}  // namespace camber
