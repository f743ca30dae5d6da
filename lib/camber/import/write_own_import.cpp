#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "camber/core/made_folder.h"
#include "camber/core/read_file.h"
#include "camber/image/video.h"
#include "camber/import/detail/own_data.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

/// Whether an import wrote the manifest: it and the pictures beside it may be replaced.
bool is_a_scene(const fs::path& manifest) {
  std::error_code ignored;
  if (!fs::is_regular_file(manifest, ignored)) return false;
  const auto document = nlohmann::json::parse(read_whole_file(manifest), nullptr, false);
  const auto format = document.is_object() ? document.find("format") : document.end();
  return format != document.end() && *format == "camber-scene";
}

}  // namespace

void write_own_import(OwnImport& import, const fs::path& manifest) {
  const fs::path folder = manifest.has_parent_path() ? manifest.parent_path() : fs::path(".");
  Scene& scene = import.scene;
  const bool own = is_a_scene(manifest);
  AtomicFiles files;
  const auto stage = [&](const fs::path& path) {
    const fs::path staged = files.stage(path);  // first: that it is an input is the better reason
    std::error_code ignored;
    if (!own && fs::exists(path, ignored)) {
      throw OutputError(path.string(), "is there already, and no import wrote it");
    }
    return staged;
  };
  std::optional<MadeFolder> masks, images;
  if (!import.conversions.empty()) masks.emplace(folder / "segmentation");
  for (const auto& [id, mask] : import.conversions) {
    const auto frame = std::find_if(scene.frames.begin(), scene.frames.end(),
                                    [id = id](const SceneFrame& f) { return f.id == id; });
    if (frame == scene.frames.end()) continue;  // not among the frames that were asked for
    frame->segmentation = folder / "segmentation" / fmt::format("{:06}.png", id);
    write_png(labels_of_colors(mask, import.mask_classes, file_camera(scene)),
              stage(frame->segmentation));
  }
  if (!import.extractions.empty() || import.write_images) images.emplace(folder / "image");
  FrameImageReader reader;
  for (const auto& [from, to] : import.extractions) {
    write_png(reader.read(from, file_camera(scene)).color, stage(to));
  }
  const ImageSink write = [&](const fs::path& path, const std::string& content) {
    write_file_atomically(stage(path), content);
  };
  if (import.write_images) import.write_images(write);
  write_scene(scene, stage(manifest));
  files.commit();
  if (masks) masks->keep();
  if (images) images->keep();
}

}  // namespace camber
