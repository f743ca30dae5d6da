// Masks, poses, speeds and directions of gravity, given to the frames that they belong to.

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <set>

#include "camber/core/errors.h"
#include "camber/core/folder_files.h"
#include "camber/core/lower_case.h"
#include "camber/core/read_file.h"
#include "camber/image/image_io.h"
#include "camber/import/detail/own_data.h"
#include "camber/import/detail/samples_in_time.h"
#include "camber/import/formats/class_map.h"
#include "camber/import/formats/frame_files.h"
#include "camber/import/formats/trajectory.h"
#include "camber/import/import_common.h"
#include "camber/scene/camera_up.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

/// The ending of a mask's or image's name that states what it is; empty: none.
std::string ending_of(const std::string& stem) {
  for (const char* suffix :
       {"_gtFine_labelIds", "_gtFine_labelTrainIds", "_gtFine_color", "_leftImg8bit", "_train_id",
        "_drivable_id", "_drivable_color", "_train_color", "_labelIds", "_label", "_mask", "_seg",
        "_road", "_color"}) {
    const std::string end = suffix;
    if (stem.size() > end.size() && stem.compare(stem.size() - end.size(), end.size(), end) == 0) {
      return end;
    }
  }
  return "";
}

/// The share of a file's name that an image and its mask have in common.
std::string shared_stem(const fs::path& file) {
  std::string stem = file.stem().string();
  if (const std::string ending = ending_of(stem); !ending.empty()) {
    return stem.substr(0, stem.size() - ending.size());
  }
  // KITTI road: um_000000 and um_road_000000.
  const std::size_t road = stem.find("_road_");
  if (road != std::string::npos) stem.erase(road, 5);
  return stem;
}

/// Masks by what their names share with images. Where a folder has several kinds for an image, as
/// Cityscapes has, the numbers that the class map is of.
std::map<std::string, fs::path> masks_in(const fs::path& folder, const std::string& class_map) {
  std::map<std::string, std::map<std::string, fs::path>> found;  // by ending
  std::error_code error;
  if (!fs::is_directory(folder, error))
    throw InputError(folder.string(), "is not a folder, expected a folder of masks");
  for (const fs::path& file : files_in(folder)) {
    if (lower_case(file.extension().string()) != ".png") continue;
    found[shared_stem(file)].emplace(ending_of(file.stem().string()), file);
  }
  if (found.empty())
    throw InputError(folder.string(),
                     "found no PNG image, expected one mask a frame, named as its image");
  const bool train_ids = class_map == "cityscapes-train";
  std::map<std::string, fs::path> out;
  for (const auto& [stem, kinds] : found) {
    auto chosen = kinds.find(train_ids ? "_gtFine_labelTrainIds" : "_gtFine_labelIds");
    if (kinds.size() == 1) chosen = kinds.begin();
    if (chosen == kinds.end()) {
      throw InputError(
          folder.string(),
          fmt::format("found both {} and {}, expected one mask an image",
                      printable(kinds.begin()->second.filename().string()),
                      printable(std::next(kinds.begin())->second.filename().string())));
    }
    out.emplace(stem, chosen->second);
  }
  return out;
}

ClassMap class_map_of(const std::string& name) {
  if (const auto known = named_class_map(name)) return *known;
  std::error_code error;
  if (!fs::exists(name, error)) {
    throw UsageError(fmt::format("--class-map {}: no such file, and none of the names {}, binary",
                                 printable(name), fmt::join(class_map_names(), ", ")));
  }
  return read_class_map(name);
}

constexpr int kRoadLabel = 1, kPavementLabel = 2, kVehicleLabel = 3;  // of masks that Camber writes

int label_of(MaskRole role) {
  switch (role) {
    case MaskRole::kRoad:
      return kRoadLabel;
    case MaskRole::kPavement:
      return kPavementLabel;
    case MaskRole::kVehicle:
      return kVehicleLabel;
    case MaskRole::kOther:
      break;
  }
  return 0;
}

/// Labels by role of masks that Camber writes from colours: of the roles that some class has.
std::map<std::string, std::vector<int>> labels_by_role(const ClassMap& classes) {
  std::map<std::string, std::vector<int>> out;
  for (const auto& [name, role] :
       {std::pair{"road", MaskRole::kRoad}, std::pair{"pavement", MaskRole::kPavement},
        std::pair{"vehicle", MaskRole::kVehicle}}) {
    const bool has =
        std::any_of(classes.classes.begin(), classes.classes.end(),
                    [role = role](const MaskClass& c) { return role_of_class(c.name) == role; });
    if (has) out[name] = {label_of(role)};
  }
  return out;
}

/// Label values by role; the first of `use_train_ids` that fits the image decides nothing here.
std::map<std::string, std::vector<int>> values_by_role(const ClassMap& classes, bool train_ids) {
  std::map<std::string, std::vector<int>> out;
  for (const MaskClass& one : classes.classes) {
    const std::optional<int>& id = train_ids ? one.train_id : one.id;
    if (!id || *id < 0 || *id > 255) continue;
    const MaskRole role = role_of_class(one.name);
    const char* name = role == MaskRole::kRoad       ? "road"
                       : role == MaskRole::kPavement ? "pavement"
                                                     : "vehicle";
    std::vector<int>& list = out[name];
    if (role != MaskRole::kOther && std::find(list.begin(), list.end(), *id) == list.end())
      list.push_back(*id);
  }
  for (auto at = out.begin(); at != out.end();)
    at = at->second.empty() ? out.erase(at) : std::next(at);
  return out;
}

/// Whether the masks' numbers are the training ids of classes that have others, too.
/// @throws InputError where a named class map is of other numbers than the mask's name states.
bool numbers_of_training(const fs::path& mask, const std::string& class_map,
                         const ClassMap& classes) {
  const std::string stem = mask.stem().string();
  const bool training = stem.find("rainId") != std::string::npos;
  if ((class_map == "cityscapes" && training) ||
      (class_map == "cityscapes-train" && stem.find("labelIds") != std::string::npos)) {
    throw InputError(mask.string(),
                     fmt::format("found a mask of {} ids, expected those of the class map {}",
                                 training ? "train" : "label", class_map));
  }
  return training && std::any_of(classes.classes.begin(), classes.classes.end(),
                                 [](const MaskClass& one) { return one.train_id.has_value(); });
}

}  // namespace

Image labels_of_colors(const fs::path& mask, const ClassMap& classes, const PinholeCamera& camera) {
  const Image colors = read_color_image(mask);
  if (colors.width != camera.width || colors.height != camera.height) {
    throw InputError(mask.string(),
                     fmt::format("found an image of {} x {} pixels, expected the camera's {} x {}",
                                 colors.width, colors.height, camera.width, camera.height));
  }
  std::map<int, int> label_by_color;
  for (const MaskClass& one : classes.classes) {
    if (one.color)
      label_by_color.emplace((*one.color)[0] << 16 | (*one.color)[1] << 8 | (*one.color)[2],
                             label_of(role_of_class(one.name)));
  }
  Image out{colors.width, colors.height, 1, {}};
  out.data.resize(static_cast<std::size_t>(out.width) * out.height);
  std::size_t unknown = 0;
  int last = -1, last_label = 0;
  for (std::size_t i = 0; i < out.data.size(); ++i) {
    const std::uint8_t* p = &colors.data[3 * i];
    const int color = p[0] << 16 | p[1] << 8 | p[2];
    if (color != last) {
      const auto at = label_by_color.find(color);
      last = color;
      last_label = at == label_by_color.end() ? -1 : at->second;
    }
    unknown += last_label < 0 ? 1 : 0;
    out.data[i] = static_cast<std::uint8_t>(std::max(0, last_label));
  }
  if (2 * unknown > out.data.size()) {
    throw InputError(
        mask.string(),
        fmt::format("found {:.0f} % of the pixels in colours that the class map does not have, "
                    "expected its colours",
                    100.0 * static_cast<double>(unknown) / static_cast<double>(out.data.size())));
  }
  return out;
}

namespace {

void put_oxts_speeds(Scene& scene, const std::vector<OxtsRecord>& records, std::size_t* count) {
  std::map<int, const OxtsRecord*> by_number;
  for (const OxtsRecord& record : records) by_number[record.number] = &record;
  for (SceneFrame& frame : scene.frames) {
    const auto at = by_number.find(frame.id);
    if (at == by_number.end()) continue;
    frame.speed = std::abs(at->second->forward_speed);
    frame.speed_sigma = default_speed_sigma(*frame.speed);
    ++*count;
  }
}

}  // namespace

void put_own_masks(Scene& scene, const fs::path& folder, const std::string& class_map,
                   OwnImport& out) {
  const auto masks = masks_in(folder, class_map);
  const bool binary = class_map == "binary";
  const ClassMap classes = binary ? ClassMap() : class_map_of(class_map);
  std::size_t count = 0;
  bool colors = false, train_ids = false;
  for (SceneFrame& frame : scene.frames) {
    const auto at = masks.find(shared_stem(frame.image));
    if (at == masks.end()) continue;
    const ImageInfo info = read_image_info(at->second);
    if (info.width != scene.camera.width || info.height != scene.camera.height) {
      throw InputError(
          at->second.string(),
          fmt::format("found an image of {} x {} pixels, expected the camera's {} x {}", info.width,
                      info.height, scene.camera.width, scene.camera.height));
    }
    const bool colored = info.channels >= 3 || info.palette;
    if (count > 0 && !binary && classes.has_ids() && colored != colors) {
      throw InputError(at->second.string(),
                       fmt::format("found a mask {}, expected all masks of one kind",
                                   colored ? "in colours beside others of numbers"
                                           : "of numbers beside others in colours"));
    }
    if (count++ == 0) {
      colors = !binary && (colored || !classes.has_ids());
      train_ids = numbers_of_training(at->second, class_map, classes);
    }
    if (binary) {
      frame.road_mask = at->second;
    } else if (colors) {
      out.conversions.push_back({frame.id, at->second});
    } else {
      frame.segmentation = at->second;
    }
  }
  if (count == 0) {
    throw InputError(
        folder.string(),
        fmt::format("found {} masks, none of which is named as one of the images", masks.size()));
  }
  if (!binary) {
    if (colors && !classes.has_colors()) {
      throw InputError(folder.string(),
                       "found masks in colours, expected a class map with colours");
    }
    out.mask_classes = classes;
    scene.segmentation_classes =
        colors ? labels_by_role(classes) : values_by_role(classes, train_ids);
    const bool road =
        std::any_of(classes.classes.begin(), classes.classes.end(),
                    [](const MaskClass& c) { return role_of_class(c.name) == MaskRole::kRoad; });
    if (!road) throw InputError(class_map, "found no class of the road, expected one named road");
  }
  out.found.push_back(fmt::format("{} masks of {} frames, classes {}", count, scene.frames.size(),
                                  printable(class_map, 64)));
}

void put_own_poses(Scene& scene, const fs::path& file, double scale, OwnImport& out) {
  const PoseFile read = read_poses(file);
  std::size_t count = 0;
  const auto put = [&](SceneFrame& frame, SE3 pose) {
    pose.set_translation(scale * pose.translation());
    frame.world_from_camera = pose;
    ++count;
  };
  const bool named = std::all_of(read.poses.begin(), read.poses.end(),
                                 [](const TimedPose& p) { return !p.name.empty(); }) &&
                     read.form != "kapture";
  const bool timed = std::all_of(read.poses.begin(), read.poses.end(),
                                 [](const TimedPose& p) { return std::isfinite(p.time_s); });
  if (named) {
    std::map<std::string, const TimedPose*> by_name;
    for (const TimedPose& pose : read.poses) {
      by_name[fs::path(pose.name).filename().string()] = &pose;
      by_name.emplace(fs::path(pose.name).stem().string(), &pose);
    }
    for (SceneFrame& frame : scene.frames) {
      auto at = by_name.find(frame.image.filename().string());
      if (at == by_name.end()) at = by_name.find(frame.image.stem().string());
      // "frame-000000.color.png" has "frame-000000.pose.txt".
      if (at == by_name.end()) at = by_name.find(frame.image.stem().stem().string());
      if (at != by_name.end()) put(frame, at->second->world_from_body());
    }
    if (count == 0) {
      throw InputError(
          file.string(),
          fmt::format(
              "found poses of {} images (the first is {}), none of which is among the frames",
              read.poses.size(), printable(read.poses.front().name)));
    }
  } else if (timed && read.form != "kapture") {
    std::vector<TimedPose> sorted = read.poses;
    std::stable_sort(sorted.begin(), sorted.end(),
                     [](const TimedPose& a, const TimedPose& b) { return a.time_s < b.time_s; });
    for (SceneFrame& frame : scene.frames) {
      if (!frame.time_s) continue;
      const auto place = place_in(sorted, *frame.time_s, 1.0);
      if (!place) continue;
      const SE3 a = sorted[place->first].world_from_body();
      if (place->second == 0.0) {
        put(frame, a);
        continue;
      }
      const SE3 b = sorted[place->first + 1].world_from_body();
      put(frame, SE3(a.rotation().slerp(place->second, b.rotation()),
                     (1.0 - place->second) * a.translation() + place->second * b.translation()));
    }
    require_some(count, scene, sorted, file, "poses", "");
  } else {
    const int last = scene.frames.back().id;
    const bool by_place = read.poses.size() == scene.frames.size();
    if (!by_place && last >= static_cast<int>(read.poses.size())) {
      throw InputError(
          file.string(),
          fmt::format("found {} poses, expected one for each of the {} images, or a row for "
                      "each frame up to {}",
                      read.poses.size(), scene.frames.size(), last));
    }
    for (std::size_t i = 0; i < scene.frames.size(); ++i) {
      const std::size_t row = by_place ? i : static_cast<std::size_t>(scene.frames[i].id);
      put(scene.frames[i], read.poses[row].world_from_body());
    }
  }
  out.found.push_back(
      fmt::format("poses of {} of {} frames from {} ({}), taken as the camera's, in metres", count,
                  scene.frames.size(), printable(file.filename().string(), 64), read.form));
  if (count < scene.frames.size()) {
    out.missing.push_back(
        fmt::format("poses of {} frames: known poses are used where all frames of a run have one",
                    scene.frames.size() - count));
  }
}

constexpr double kLongestGap = 3.0;  // s, between speeds

std::size_t put_speeds(Scene& scene, const std::vector<SpeedSample>& samples, double gap) {
  std::size_t count = 0;
  for (SceneFrame& frame : scene.frames) {
    if (!frame.time_s) continue;
    const auto place = place_in(samples, *frame.time_s, gap);
    if (!place) continue;
    const auto& [at, share] = *place;
    const SpeedSample &a = samples[at], &b = samples[share > 0.0 ? at + 1 : at];
    frame.speed = (1.0 - share) * a.speed + share * b.speed;
    // Samples of one receiver have their errors in common.
    frame.speed_sigma = std::max(a.sigma, b.sigma);
    ++count;
  }
  return count;
}

void put_own_speeds(Scene& scene, const fs::path& file, const std::string& offset, OwnImport& out) {
  std::size_t count = 0;
  if (is_oxts(file)) {
    put_oxts_speeds(scene, read_oxts(file), &count);
    if (count == 0)
      throw InputError(file.string(),
                       "found no record of one of the frames, expected their numbers");
    out.found.push_back(
        fmt::format("speeds of {} of {} frames (KITTI oxts)", count, scene.frames.size()));
    return;
  }
  SpeedLog log = read_speeds(file);
  double shift = 0.0;
  if (offset == "first") {
    if (!scene.frames.front().time_s)
      throw UsageError(
          "--speed-offset first: the frames have no times, expected --rate or --times");
    shift = *scene.frames.front().time_s - log.samples.front().time_s;
  } else if (!offset.empty()) {
    char* end = nullptr;
    shift = std::strtod(offset.c_str(), &end);
    if (*end != 0 || !std::isfinite(shift)) {
      throw UsageError(
          fmt::format("--speed-offset {}: expected seconds, or first", printable(offset)));
    }
  }
  for (SpeedSample& sample : log.samples) sample.time_s += shift;
  if (offset.empty()) {
    shift = gps_time_shift(log.samples, scene, log.leap_seconds, kLongestGap);
    for (SpeedSample& sample : log.samples) sample.time_s += shift;
  }
  count = put_speeds(scene, log.samples, kLongestGap);
  require_some(count, scene, log.samples, file, "speeds",
               "; --speed-offset moves the log (first: its start is the first frame)");
  out.found.push_back(fmt::format("speeds of {} of {} frames from {} ({})", count,
                                  scene.frames.size(), printable(file.filename().string(), 64),
                                  log.form));
}

void put_own_up(Scene& scene, const fs::path& file, double sigma, OwnImport& out) {
  std::vector<Attitude> rows;
  if (is_oxts(file)) {
    for (const OxtsRecord& record : read_oxts(file)) {
      Attitude one;
      one.frame = record.number;
      one.roll = record.roll;
      one.pitch = record.pitch;
      rows.push_back(one);
    }
  } else {
    rows = read_attitudes(file);
  }
  std::size_t count = 0;
  const auto put = [&](SceneFrame& frame, double roll, double pitch) {
    const Eigen::Vector3d up = up_in_camera(roll, pitch);
    if (const char* wrong = why_not_up(up)) {
      throw InputError(
          file.string(),
          fmt::format("found roll {:.1f} and pitch {:.1f} degrees for frame {}, by "
                      "which up points {} in the camera, expected a camera that "
                      "stands upright (roll positive with the left side up, pitch with "
                      "the front down)",
                      roll * 180.0 / M_PI, pitch * 180.0 / M_PI, frame.id, wrong));
    }
    frame.up = up;
    frame.up_sigma = sigma;
    ++count;
  };
  if (rows.front().frame >= 0) {
    std::map<int, const Attitude*> by_frame;
    for (const Attitude& row : rows) by_frame[row.frame] = &row;
    for (SceneFrame& frame : scene.frames) {
      if (const auto at = by_frame.find(frame.id); at != by_frame.end())
        put(frame, at->second->roll, at->second->pitch);
    }
    if (count == 0)
      throw InputError(file.string(), "found no row of one of the frames, expected their ids");
  } else {
    for (SceneFrame& frame : scene.frames) {
      if (!frame.time_s) continue;
      const auto place = place_in(rows, *frame.time_s, 1.0);
      if (!place) continue;
      const Attitude& a = rows[place->first];
      const Attitude& b = rows[place->second > 0.0 ? place->first + 1 : place->first];
      put(frame, a.roll + place->second * (b.roll - a.roll),
          a.pitch + place->second * (b.pitch - a.pitch));
    }
    require_some(count, scene, rows, file, "roll and pitch", "");
  }
  out.found.push_back(
      fmt::format("gravity in {} of {} frames, for a camera that looks along the vehicle's axis",
                  count, scene.frames.size()));
}

}  // namespace camber
