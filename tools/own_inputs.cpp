#include "own_inputs.h"

#include <system_error>

#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"

namespace fs = std::filesystem;

namespace camber::tools {
namespace {

/// What is read of a folder that is given as an input.
constexpr const char* kFolderFiles[] = {
    "scene.json",     "surface.json", "vehicles.json",  "run.json",    "metrics.json",
    "road.ply",       "labels.ply",   "points3D.bin",   "cameras.bin", "images.bin",
    "points3D.txt",   "cameras.txt",  "images.txt",     "images.npy",  "keypoints.npy",
    "visibility.npy", "boxes.npy",    "true_boxes.npy", "heading.npy", "car.npy",
    "crops.json"};

void refuse_one(const fs::path& output, const fs::path& input) {
  std::error_code error;
  if (!fs::is_regular_file(input, error) || !fs::equivalent(output, input, error)) return;
  throw UsageError(output.string() + ": is the input " + input.string() +
                   (output == input ? "" : " under another name") +
                   ", and would be replaced; expected another name");
}

}  // namespace

std::vector<fs::path> files_of(const Scene& scene) {
  std::vector<fs::path> files;
  for (const SceneFrame& frame : scene.frames) {
    files.insert(files.end(), {frame.image, frame.segmentation, frame.road_mask});
  }
  if (scene.truth) {
    files.push_back(scene.truth->cloud);
    for (const TruthFrame& frame : scene.truth->frames) {
      files.insert(files.end(), {frame.depth, frame.label});
    }
  }
  return files;
}

void add_confine_option(App& app, bool& confine) {
  app.add_flag("--confine", confine,
               "refuse a scene that names files outside its folder, also by links");
}

ScenePaths scene_paths(bool confine) {
  return confine ? ScenePaths::kConfined : ScenePaths::kAnywhere;
}

void refuse_own_inputs(const std::vector<fs::path>& outputs, const std::vector<fs::path>& inputs) {
  for (const fs::path& output : outputs) {
    check_output_file(output);
    std::error_code error;
    if (output.empty() || !fs::is_regular_file(output, error)) continue;
    for (const fs::path& input : inputs) {
      if (input.empty()) continue;
      refuse_one(output, input);
      if (!fs::is_directory(input, error)) continue;
      for (const char* file : kFolderFiles) refuse_one(output, input / file);
    }
  }
}

}  // namespace camber::tools
