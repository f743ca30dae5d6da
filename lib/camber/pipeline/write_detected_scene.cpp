#include "camber/pipeline/write_detected_scene.h"

#include <fmt/format.h>

#include <algorithm>
#include <optional>

#include "camber/core/atomic_file.h"
#include "camber/core/made_folder.h"
#include "camber/image/image_io.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

fs::path folder_of(const fs::path& manifest) {
  return manifest.has_parent_path() ? manifest.parent_path() : fs::path(".");
}

fs::path labels_folder(const fs::path& manifest) {
  return folder_of(manifest) / (manifest.stem().string() + "-segmentation");
}

fs::path label_file(const fs::path& manifest, int id) {
  return labels_folder(manifest) / fmt::format("{:06}.png", id);
}

}  // namespace

std::vector<fs::path> detected_scene_files(const NetworkView& view, const fs::path& manifest) {
  std::vector<fs::path> out = {manifest};
  for (const auto& [id, labels] : view.labels) out.push_back(label_file(manifest, id));
  return out;
}

Scene write_detected_scene(Scene scene, const NetworkView& view, const fs::path& manifest) {
  std::optional<MadeFolder> folder;
  if (!view.labels.empty()) folder.emplace(labels_folder(manifest));
  AtomicFiles files;
  for (SceneFrame& frame : scene.frames) {
    if (!view.segmenter) break;
    // Label images of another source have other values.
    frame.segmentation.clear();
    const auto labels = view.labels.find(frame.id);
    if (labels == view.labels.end()) continue;
    frame.segmentation = label_file(manifest, frame.id);
    write_png(labels->second, files.stage(frame.segmentation));
  }
  const fs::path staged = files.stage(manifest);
  write_scene(scene, staged);
  files.commit();
  if (folder) folder->keep();
  return scene;
}

}  // namespace camber
