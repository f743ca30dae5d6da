#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <stdexcept>

#include "camber/cloud/colmap.h"
#include "camber/core/errors.h"
#include "camber/core/read_file.h"
#include "camber/import/detail/own_data.h"
#include "camber/import/formats/frame_files.h"
#include "camber/import/import_common.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

/// The file of a model's part, binary before text as COLMAP reads it.
fs::path part_of(const fs::path& model, const std::string& name) {
  std::error_code error;
  for (const char* extension : {".bin", ".txt"}) {
    const fs::path file = model / (name + extension);
    if (fs::is_regular_file(file, error)) return file;
  }
  throw InputError(
      model.string(),
      fmt::format("found no {}.bin and no {}.txt, expected the folder of a COLMAP model", name,
                  name));
}

/// The images of one camera: the chosen one, or that of all.
std::vector<ColmapImage> images_of_camera(std::vector<ColmapImage> images, const fs::path& model,
                                          std::string* camera) {
  std::map<std::int64_t, std::size_t> counts;
  for (const ColmapImage& image : images) ++counts[image.camera_id];
  if (counts.empty())
    throw InputError(model.string(), "found a model without images, expected at least one");
  if (camera->empty() && counts.size() > 1) {
    throw InputError(model.string(),
                     fmt::format("found images of {} cameras, expected one: --camera ID chooses "
                                 "(camera {} has {} images)",
                                 counts.size(), counts.begin()->first, counts.begin()->second));
  }
  if (camera->empty()) *camera = std::to_string(counts.begin()->first);
  const std::string wanted = *camera;
  images.erase(std::remove_if(images.begin(), images.end(),
                              [&](const ColmapImage& image) {
                                return std::to_string(image.camera_id) != wanted;
                              }),
               images.end());
  if (images.empty())
    throw InputError(model.string(),
                     fmt::format("found no image of camera {}, expected one", printable(wanted)));
  return images;
}

}  // namespace

OwnImport import_colmap(const fs::path& model, const fs::path& images,
                        std::optional<double> metres_per_unit, const OwnDataOptions& options) {
  options.validate();
  if (metres_per_unit && !(*metres_per_unit > 0.0 && std::isfinite(*metres_per_unit))) {
    throw std::invalid_argument(
        fmt::format("metres_per_unit {}, expected a positive number", *metres_per_unit));
  }
  const fs::path image_file = part_of(model, "images");
  const std::string bytes = read_whole_file(image_file);
  OwnCamera camera = options.camera;
  std::vector<ColmapImage> listed = images_of_camera(
      parse_colmap_images(bytes.data(), bytes.size(), image_file.string()), model, &camera.name);
  std::sort(listed.begin(), listed.end(), [](const ColmapImage& a, const ColmapImage& b) {
    return natural_less(a.name, b.name);
  });
  OwnImport out;
  Scene& scene = out.scene;
  std::error_code error;
  for (const ColmapImage& image : listed) {
    SceneFrame frame;
    frame.image = images / image.name;
    if (!fs::is_regular_file(frame.image, error)) {
      throw InputError(frame.image.string(),
                       fmt::format("no such file, expected the image that {} names",
                                   printable(image_file.filename().string())));
    }
    if (metres_per_unit) {
      SE3 pose = image.camera_from_world.inverse();
      pose.set_translation(*metres_per_unit * pose.translation());
      frame.world_from_camera = pose;
    }
    scene.frames.push_back(std::move(frame));
  }
  number_frames(scene, out);
  fs::path folder = fs::absolute(model).lexically_normal();
  if (!folder.has_filename()) folder = folder.parent_path();
  scene.name = options.name.empty() ? folder.filename().string() : options.name;
  if (options.times.rate) put_rate(scene, *options.times.rate, out);
  measure_images(scene);
  camera.calibration = part_of(model, "cameras");
  put_camera(scene, camera, out);
  finish_import(options, out);
  if (metres_per_unit) {
    out.found.push_back(fmt::format("poses of the model, {} metres per unit", *metres_per_unit));
  } else {
    out.missing.emplace_back(
        "poses: a model is up to scale, --scale METRES takes them with the metres per unit");
  }
  return out;
}

}  // namespace camber
