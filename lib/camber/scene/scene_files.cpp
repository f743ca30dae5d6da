#include "camber/scene/scene_files.h"

#include "camber/image/video.h"

namespace fs = std::filesystem;

namespace camber {

std::vector<fs::path> files_of(const Scene& scene) {
  std::vector<fs::path> files;
  for (const SceneFrame& frame : scene.frames) {
    files.insert(files.end(), {image_file_of(frame.image), frame.segmentation, frame.road_mask});
  }
  if (scene.truth) {
    files.push_back(scene.truth->cloud);
    for (const TruthFrame& frame : scene.truth->frames) {
      files.insert(files.end(), {frame.depth, frame.label});
    }
  }
  return files;
}

}  // namespace camber
