#include "own_inputs.h"

#include <map>
#include <system_error>

#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "camber/core/protected_inputs.h"
#include "camber/image/video.h"

namespace fs = std::filesystem;

namespace camber::tools {
namespace {

/// What is read of a folder that is given as an input.
constexpr const char* kFolderFiles[] = {
    "scene.json",          "surface.json",   "vehicles.json",    "run.json",
    "metrics.json",        "road.ply",       "labels.ply",       "points3D.bin",
    "cameras.bin",         "images.bin",     "points3D.txt",     "cameras.txt",
    "images.txt",          "images.npy",     "keypoints.npy",    "visibility.npy",
    "boxes.npy",           "true_boxes.npy", "heading.npy",      "car.npy",
    "crops.json",          "drive.json",     "surface/run.json", "surface/road.ply",
    "surface/surface.json"};

void protect_with_folders(const std::vector<fs::path>& inputs) {
  protect_inputs(inputs);
  for (const fs::path& input : inputs) {
    std::error_code error;
    if (!fs::is_directory(input, error)) continue;
    std::vector<fs::path> files;
    for (const char* file : kFolderFiles) files.push_back(input / file);
    protect_inputs(files);
  }
}

/// Devices and pipes can take several results.
void refuse_same_outputs(const std::vector<fs::path>& outputs) {
  std::map<fs::path, fs::path> names;
  for (const fs::path& output : outputs) {
    std::error_code error;
    if (output.empty() || (fs::exists(output, error) && !fs::is_regular_file(output, error))) {
      continue;
    }
    const auto [same, first] = names.emplace(fs::weakly_canonical(output, error), output);
    if (first) continue;
    throw UsageError(output == same->second
                         ? output.string() + ": is given for two outputs, expected two names"
                         : output.string() + ": is the output " + same->second.string() +
                               " under another name, expected two files");
  }
}

}  // namespace

void add_confine_option(App& app, bool& confine) {
  app.add_flag("--confine", confine,
               "refuse a scene that names files outside its folder, also by links");
}

ScenePaths scene_paths(bool confine) {
  return confine ? ScenePaths::kConfined : ScenePaths::kAnywhere;
}

void refuse_own_inputs(const Command& command) {
  const NamedFiles named = command.app->named_files();
  command.foreign_folders ? protect_inputs(named.inputs) : protect_with_folders(named.inputs);
  for (const fs::path& output : named.outputs) refuse_protected_file(output);
  for (const fs::path& folder : named.folders) refuse_protected_folder(folder);
  refuse_same_outputs(named.outputs);
}

void refuse_own_inputs(const std::vector<fs::path>& outputs, const std::vector<fs::path>& inputs) {
  protect_with_folders(inputs);
  for (const fs::path& output : outputs) check_output_file(output);
  refuse_same_outputs(outputs);
}

}  // namespace camber::tools
