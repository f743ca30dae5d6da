#include "camber/import/import_common.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>

#include "camber/core/errors.h"
#include "camber/core/folder_files.h"
#include "camber/core/lower_case.h"
#include "camber/image/image_io.h"
#include "camber/scene/json_reader.h"

namespace fs = std::filesystem;

namespace camber {

std::optional<int> frame_number(const fs::path& file) {
  const std::string stem = file.stem().string();
  if (stem.empty() || !std::all_of(stem.begin(), stem.end(),
                                   [](unsigned char c) { return std::isdigit(c) != 0; })) {
    return std::nullopt;
  }
  int number = 0;
  const auto [end, error] = std::from_chars(stem.data(), stem.data() + stem.size(), number);
  if (error != std::errc() || end != stem.data() + stem.size()) return std::nullopt;
  return number;
}

std::map<int, fs::path> numbered_files(const fs::path& folder,
                                       const std::vector<std::string>& extensions,
                                       const char* what) {
  std::error_code error;
  if (!fs::is_directory(folder, error)) {
    throw InputError(folder.string(),
                     fmt::format("is not a folder, expected a folder of {}", what));
  }
  std::map<int, fs::path> out;
  for (const fs::path& file : files_in(folder)) {
    const std::string extension = lower_case(file.extension().string());
    if (std::find(extensions.begin(), extensions.end(), extension) == extensions.end()) continue;
    const std::optional<int> number = frame_number(file);
    if (!number) continue;
    const auto [place, fresh] = out.emplace(*number, file);
    if (!fresh) {
      throw InputError(folder.string(),
                       fmt::format("found both {} and {}, expected one file for frame {}",
                                   printable(place->second.filename().string()),
                                   printable(file.filename().string()), *number));
    }
  }
  if (out.empty()) {
    throw InputError(folder.string(),
                     fmt::format("found no {} named by frame number, expected files like 000048{}",
                                 what, extensions.front()));
  }
  return out;
}

std::vector<int> keep_frames(Scene& scene, const std::string& list) {
  const std::vector<int> selected = select_frames(scene, list);
  const std::set<int> wanted(selected.begin(), selected.end());
  scene.frames.erase(
      std::remove_if(scene.frames.begin(), scene.frames.end(),
                     [&](const SceneFrame& frame) { return !wanted.count(frame.id); }),
      scene.frames.end());

  return selected;
}

void measure_images(Scene& scene) {
  scene.camera.width = 0;
  for (const SceneFrame& frame : scene.frames) {
    const ImageInfo info = read_image_info(frame.image);
    if (scene.camera.width == 0) {
      scene.camera.width = info.width;
      scene.camera.height = info.height;
    }
    if (info.width != scene.camera.width || info.height != scene.camera.height) {
      throw InputError(frame.image.string(),
                       fmt::format("found an image of {} x {} pixels, expected {} x {} as {}",
                                   info.width, info.height, scene.camera.width, scene.camera.height,
                                   printable(scene.frames.front().image.filename().string())));
    }
  }
}

std::optional<Box2> projected_box(const OrientedBox& box, const PinholeCamera& camera) {
  const auto corners = box.corners();
  constexpr double kHuge = 1e12;
  Box2 whole{kHuge, kHuge, -kHuge, -kHuge};
  for (Eigen::Index i = 0; i < corners.cols(); ++i) {
    if (!(corners(2, i) > 0.1)) return std::nullopt;
    const Eigen::Vector2d p = *camera.project(corners.col(i));
    whole = {std::min(whole.x1, p.x()), std::min(whole.y1, p.y()), std::max(whole.x2, p.x()),
             std::max(whole.y2, p.y())};
  }
  return whole;
}

double projected_truncation(const OrientedBox& box, const PinholeCamera& camera) {
  const std::optional<Box2> whole = projected_box(box, camera);
  if (!whole) return 1.0;
  return std::clamp(1.0 - whole->clipped(camera.width, camera.height).area() / whole->area(), 0.0,
                    1.0);
}

std::map<int, FrameLabels> read_frame_labels(const fs::path& path,
                                             const std::vector<SceneFrame>& frames,
                                             const char* what, const LogSink& warn) {
  std::map<int, FrameLabels> out;
  std::set<int> wanted;
  for (const SceneFrame& frame : frames) wanted.insert(frame.id);
  std::error_code error;
  if (fs::is_directory(path, error)) {
    for (const auto& [number, file] : numbered_files(path, {".txt"}, what)) {
      if (!wanted.count(number)) continue;
      const KittiLabelFile read = read_kitti_labels(file);
      if (read.form == KittiLabelForm::kTracking && !read.labels.empty()) {
        throw InputError(file.string(),
                         "found rows of the tracking form, expected object rows (15 columns) in a "
                         "folder of one file an image; give a tracking file by its own path");
      }
      out[number] = {file, read.labels};
    }
  } else {
    const KittiLabelFile read = read_kitti_labels(path);
    if (read.form == KittiLabelForm::kTracking) {
      for (const KittiLabel& label : read.labels) {
        if (!wanted.count(label.frame)) continue;
        FrameLabels& frame = out[label.frame];
        frame.file = path;
        frame.labels.push_back(label);
      }
    } else if (!read.labels.empty()) {
      const std::optional<int> number = frame_number(path);
      if (!number || !wanted.count(*number)) {
        throw InputError(path.string(),
                         "found object rows (15 columns) in a file that is not named "
                         "by one of the frames, expected a tracking file or a folder "
                         "of object files");
      }
      out[*number] = {path, read.labels};
    }
  }
  if (out.empty() && warn) {
    warn(fmt::format("{}: no row for frames {} to {}", path.string(), frames.front().id,
                     frames.back().id));
  }
  return out;
}

std::vector<int> ids_of(const std::vector<KittiLabel>& labels) {
  std::set<int> seen;
  std::vector<int> ids;
  for (const KittiLabel& label : labels) {
    if (label.track < 0 || !seen.insert(label.track).second) {
      ids.resize(labels.size());
      for (std::size_t i = 0; i < ids.size(); ++i) ids[i] = static_cast<int>(i);
      return ids;
    }
    ids.push_back(label.track);
  }
  return ids;
}

std::vector<KittiLabel> vehicles_among(const std::vector<KittiLabel>& labels,
                                       const std::set<std::string>& classes) {
  std::vector<KittiLabel> out;
  for (const KittiLabel& label : labels) {
    if (!label.dont_care() && classes.count(lower_case(label.type))) out.push_back(label);
  }
  return out;
}

std::vector<VehicleDetection> detections_of(const std::vector<KittiLabel>& labels) {
  const std::vector<int> ids = ids_of(labels);
  std::vector<VehicleDetection> out;
  for (std::size_t i = 0; i < labels.size(); ++i) {
    VehicleDetection detection;
    detection.id = ids[i];
    detection.vehicle_class = lower_case(labels[i].type);
    detection.track = labels[i].track;
    detection.box = labels[i].box;
    if (!std::isnan(labels[i].score)) detection.score = labels[i].score;
    out.push_back(std::move(detection));
  }
  return out;
}

void put_detections(Scene& scene, const fs::path& path, const std::set<std::string>& classes,
                    const LogSink& warn) {
  const auto labels = read_frame_labels(path, scene.frames, "detection files", warn);
  for (SceneFrame& frame : scene.frames) {
    const auto at = labels.find(frame.id);
    if (at == labels.end()) continue;
    frame.vehicles = detections_of(vehicles_among(at->second.labels, classes));
  }
  scene.detections_source = "network";
}

}  // namespace camber
