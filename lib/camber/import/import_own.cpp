#include "camber/import/import_own.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <set>
#include <stdexcept>

#include "camber/core/errors.h"
#include "camber/core/read_file.h"
#include "camber/import/detail/own_data.h"
#include "camber/import/formats/calibration.h"
#include "camber/import/formats/frame_files.h"
#include "camber/import/import_common.h"
#include "camber/scene/validate_scene.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

constexpr double kPi = 3.14159265358979323846;

std::vector<double> listed_times(const Scene& scene, const fs::path& path) {
  const std::vector<ListedTime> listed = read_frame_times(path);
  const bool by_name = std::any_of(listed.begin(), listed.end(),
                                   [](const ListedTime& t) { return !t.name.empty(); });
  std::vector<double> out;
  if (!by_name) {
    if (listed.size() != scene.frames.size()) {
      throw InputError(path.string(),
                       fmt::format("found {} times, expected one for each of the {} images",
                                   listed.size(), scene.frames.size()));
    }
    for (const ListedTime& t : listed) out.push_back(t.time_s);
    return out;
  }
  std::map<std::string, double> by_names;
  for (const ListedTime& t : listed) {
    by_names[t.name] = t.time_s;
    by_names.emplace(fs::path(t.name).stem().string(), t.time_s);
  }
  for (const SceneFrame& frame : scene.frames) {
    auto at = by_names.find(frame.image.filename().string());
    if (at == by_names.end()) at = by_names.find(frame.image.stem().string());
    if (at == by_names.end()) {
      throw InputError(path.string(),
                       fmt::format("found no time of {}, expected one for each image",
                                   printable(frame.image.filename().string())));
    }
    out.push_back(at->second);
  }
  return out;
}

std::vector<double> named_times(const Scene& scene) {
  std::vector<double> out;
  for (const SceneFrame& frame : scene.frames) {
    const auto time = time_from_name(frame.image.filename().string());
    if (!time) {
      throw InputError(
          frame.image.string(),
          "found no time in the file's name, expected seconds, a whole number of 13, 16 "
          "or 19 digits (ms, us, ns), or a date with a time of day");
    }
    out.push_back(*time);
  }
  return out;
}

/// Frames in the order of their times, which must differ; ids from 0 where that changes the order.
void put_times(Scene& scene, const std::vector<double>& times, const std::string& source,
               OwnImport& out) {
  for (std::size_t i = 0; i < times.size(); ++i) scene.frames[i].time_s = times[i];
  const auto earlier = [](const SceneFrame& a, const SceneFrame& b) { return a.time_s < b.time_s; };
  if (!std::is_sorted(scene.frames.begin(), scene.frames.end(), earlier)) {
    std::stable_sort(scene.frames.begin(), scene.frames.end(), earlier);
    for (std::size_t i = 0; i < scene.frames.size(); ++i) scene.frames[i].id = static_cast<int>(i);
    out.found.push_back("the names are not in the order of time: frames numbered from 0 by time");
  }
  for (std::size_t i = 1; i < scene.frames.size(); ++i) {
    if (*scene.frames[i].time_s > *scene.frames[i - 1].time_s) continue;
    throw InputError(source,
                     fmt::format("found the same time {} for {} and {}, expected times that differ",
                                 *scene.frames[i].time_s,
                                 printable(scene.frames[i - 1].image.filename().string()),
                                 printable(scene.frames[i].image.filename().string())));
  }
  if (times.size() < 2) return;
  const double span = *scene.frames.back().time_s - *scene.frames.front().time_s;
  out.found.push_back(fmt::format("times over {:.3f} s, {:.3g} frames a second on average", span,
                                  static_cast<double>(times.size() - 1) / span));
}

}  // namespace

void OwnDataOptions::validate() const {
  const auto positive = [](const std::optional<double>& value, const char* what) {
    if (value && !(*value > 0.0 && std::isfinite(*value))) {
      throw std::invalid_argument(fmt::format("{} {}, expected a positive number", what, *value));
    }
  };
  positive(camera.fx, "fx");
  positive(camera.fy, "fy");
  positive(times.rate, "rate");
  if (height) validate_camera_height(*height);
  positive(height_sigma, "height_sigma");
  positive(pose_scale, "pose_scale");
  positive(up_sigma, "up_sigma");
  positive(gnss.sigma, "gnss.sigma");
  positive(gnss.heading_sigma, "gnss.heading_sigma");
  positive(camera.fov_sigma_deg, "fov_sigma");
  if (camera.fov_sigma_deg && !camera.fov_deg) {
    throw std::invalid_argument("found fov_sigma without a field of view, expected both");
  }
  if (camera.fov_deg && !(*camera.fov_deg > 0.0 && *camera.fov_deg < 180.0)) {
    throw std::invalid_argument(
        fmt::format("fov {}, expected degrees above 0 and below 180", *camera.fov_deg));
  }
  const int cameras =
      (camera.calibration.empty() ? 0 : 1) + (camera.fx ? 1 : 0) + (camera.fov_deg ? 1 : 0);
  if (cameras > 1) {
    throw std::invalid_argument(
        "found several of a calibration, fx and a field of view, expected one");
  }
  if (!camera.fx && (camera.fy || camera.cx || camera.cy) && !camera.fov_deg) {
    throw std::invalid_argument("found fy, cx or cy without fx, expected fx beside them");
  }
  const int timings =
      (times.rate ? 1 : 0) + (times.list.empty() ? 0 : 1) + (times.from_names ? 1 : 0);
  if (timings > 1) {
    throw std::invalid_argument(
        "found several sources of times, expected one of rate, list and names");
  }
}

std::vector<std::string> missing_in(const Scene& scene) {
  const auto any = [&](auto&& has) {
    return std::any_of(scene.frames.begin(), scene.frames.end(), has);
  };
  std::vector<std::string> out;
  const bool speed = any([](const SceneFrame& f) { return f.speed.has_value(); });
  const bool poses = !any([](const SceneFrame& f) { return !f.world_from_camera; });
  if (!scene.height_above_road && !speed && !poses && scene.markings_m.empty()) {
    out.emplace_back("no camera height, speed or poses: the result is up to scale (--height)");
  }
  if (scene.frames.size() < 2) {
    out.emplace_back("only one frame: nothing has parallax, the road cannot be found");
  }
  if (!any([](const SceneFrame& f) { return !f.vehicles.empty(); })) {
    out.emplace_back(
        "no boxes: vehicles are what the shipped detector finds (--detections takes those of any)");
  }
  if (!any([](const SceneFrame& f) { return !f.segmentation.empty() || !f.road_mask.empty(); })) {
    out.emplace_back("no masks: the road is found by geometry alone");
  }
  if (!scene.frame_rate && any([](const SceneFrame& f) { return !f.time_s; })) {
    out.emplace_back("no times: 10 frames a second are assumed where it matters (--rate)");
  }
  return out;
}

void put_calibration(Scene& scene, const CameraCalibration& camera, const std::string& form,
                     bool rectified, const fs::path& path, OwnImport& out) {
  scene.distortion = lens_of(camera, rectified, scene.camera.width, scene.camera.height, path);
  scene.camera = scene.distortion.raw;
  const LensModel model = scene.distortion.model;
  scene.camera_sigma = camera.sigma;
  if (!(scene.camera_sigma.focal > 0.0)) scene.camera_sigma.focal = kCalibratedFocalSigma;
  out.found.push_back(fmt::format(
      "camera {}({}): fx {:.6g} fy {:.6g} cx {:.6g} cy {:.6g}, {}",
      camera.name.empty() ? "" : printable(camera.name, 64) + " ", form, scene.camera.fx,
      scene.camera.fy, scene.camera.cx, scene.camera.cy,
      model == LensModel::kNone ? std::string("no distortion") : to_string(model) + " distortion"));
  if (!camera.note.empty()) out.found.back() += "; " + camera.note;
}

std::string off_centre_camera(const PinholeCamera& camera) {
  if (std::abs(camera.cx - 0.5 * (camera.width - 1)) <= 0.25 * camera.width) return "";
  return fmt::format(
      "a principal point near the middle: cx {:.6g} in images of {} pixels is that of images of "
      "another size, or of a part of them",
      camera.cx, camera.width);
}

void put_camera(Scene& scene, const OwnCamera& camera, OwnImport& out) {
  const int width = scene.camera.width, height = scene.camera.height;
  if (!camera.calibration.empty()) {
    const CalibrationFile file = read_calibration(camera.calibration);
    put_calibration(scene, choose_camera(file, camera.name, camera.calibration, width, height),
                    file.form, camera.rectified, camera.calibration, out);
    return;
  }
  const bool guessed = !camera.fx && !camera.fov_deg && camera.guess;
  if (!camera.fx && !camera.fov_deg && !guessed) {
    throw UsageError(
        "the camera is not given: expected --calib FILE, or --fx --fy --cx --cy, or --fov");
  }
  PinholeCamera& c = scene.camera;
  const std::optional<double> fov_deg = guessed ? kGuessedFovDeg : camera.fov_deg;
  c.fx = fov_deg ? 0.5 * width / std::tan(*fov_deg * kPi / 360.0) : *camera.fx;
  c.fy = camera.fy.value_or(c.fx);
  c.cx = camera.cx.value_or(0.5 * (width - 1));
  c.cy = camera.cy.value_or(0.5 * (height - 1));
  const double fov_sigma = camera.fov_sigma_deg.value_or(kFovSigmaDeg) * kPi / 180.0;
  scene.camera_sigma.focal = guessed   ? kGuessedFocalSigma
                             : fov_deg ? fov_sigma / std::sin(*fov_deg * kPi / 180.0)
                                       : kTypedFocalSigma;
  out.camera_guessed = guessed;
  if (guessed) {
    out.missing.push_back(fmt::format(
        "the camera: it is guessed, a field of view of {:.0f} degrees and {:.0f} % of doubt about "
        "the focal length (--calib, or --fov)",
        kGuessedFovDeg, 100.0 * kGuessedFocalSigma));
  } else {
    out.found.push_back(
        fmt::format("camera as given: fx {:.6g} +- {:.2g} % fy {:.6g} cx {:.6g} cy "
                    "{:.6g}",
                    c.fx, 100.0 * scene.camera_sigma.focal, c.fy, c.cx, c.cy));
  }
  out.missing.emplace_back(
      "no distortion: if the lens bends straight lines the road is off by decimetres (--calib)");
}

void finish_import(const OwnDataOptions& options, OwnImport& out) {
  Scene& scene = out.scene;
  scene.height_above_road = options.height;
  if (options.height) scene.height_sigma = options.height_sigma.value_or(kTypedHeightSigma);
  if (options.height) {
    out.found.push_back(
        fmt::format("camera {} +- {} m above the road", *options.height, scene.height_sigma));
  }
  const std::string off_centre = off_centre_camera(file_camera(scene));
  if (!off_centre.empty()) out.missing.push_back(off_centre);
  if (!options.detections.file.empty()) put_own_detections(scene, options.detections, out);
  if (!options.masks.empty()) {
    if (options.class_map.empty()) {
      throw UsageError("masks need a class map: expected --class-map with a name or a file");
    }
    put_own_masks(scene, options.masks, options.class_map, out);
  }
  if (!options.poses.empty()) put_own_poses(scene, options.poses, options.pose_scale, out);
  if (!options.speed.empty()) put_own_speeds(scene, options.speed, options.speed_offset, out);
  if (!options.up.empty()) put_own_up(scene, options.up, options.up_sigma, out);
  if (!options.gnss.file.empty() || !options.gnss.points.empty())
    put_gnss(scene, options.gnss, out);
  const std::vector<int> selected = keep_frames(scene, options.frames);
  if (options.reference_frame) {
    if (!scene.find_frame(*options.reference_frame)) {
      throw UsageError(fmt::format("reference frame {} is not among the frames {} to {}",
                                   *options.reference_frame, selected.front(), selected.back()));
    }
    scene.reference_frame = options.reference_frame;
  }
  take_out_lens(scene, out);
  const std::vector<std::string> lacks = missing_in(scene);
  out.missing.insert(out.missing.begin(), lacks.begin(), lacks.end());
}

void number_frames(Scene& scene, OwnImport& out) {
  std::set<int> seen;
  bool numbered = true;
  for (const SceneFrame& frame : scene.frames) {
    const std::optional<int> number = frame_number(frame.image);
    numbered = numbered && number && *number <= 2000000000 && seen.insert(*number).second;
  }
  for (std::size_t i = 0; i < scene.frames.size(); ++i) {
    scene.frames[i].id = numbered ? *frame_number(scene.frames[i].image) : static_cast<int>(i);
  }
  std::stable_sort(scene.frames.begin(), scene.frames.end(),
                   [](const SceneFrame& a, const SceneFrame& b) { return a.id < b.id; });
  if (scene.frames.size() < 2) return;
  out.found.push_back(numbered
                          ? "frames numbered as their files"
                          : fmt::format("frames numbered from 0 in natural order of the names, "
                                        "{} to {}",
                                        printable(scene.frames.front().image.filename().string()),
                                        printable(scene.frames.back().image.filename().string())));
}

void put_rate(Scene& scene, double rate, OwnImport& out) {
  scene.frame_rate = rate;
  std::vector<SceneFrame>& frames = scene.frames;
  int step = 0;
  for (std::size_t i = 1; i < frames.size(); ++i) {
    step = std::gcd(step, frames[i].id - frames[i - 1].id);
  }
  std::size_t next = 0;  // frames one step after the one before
  for (std::size_t i = 1; i < frames.size(); ++i) {
    next += frames[i].id - frames[i - 1].id == step ? 1 : 0;
  }
  const bool numbers = frames.size() > 1 && 2 * next > frames.size() - 1;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    const double steps =
        numbers ? (frames[i].id - frames.front().id) / step : static_cast<double>(i);
    frames[i].time_s = steps / rate;
  }
  if (numbers && next < frames.size() - 1) {
    const int span = (frames.back().id - frames.front().id) / step + 1;
    out.found.push_back(fmt::format("times by the numbers of the files, which leave out {} of {}",
                                    span - static_cast<int>(frames.size()), span));
  }
}

OwnImport import_images(const std::vector<std::string>& places, const OwnDataOptions& options,
                        const LogSink&) {
  options.validate();
  OwnImport out;
  Scene& scene = out.scene;
  for (const fs::path& file : list_images(places)) {
    SceneFrame frame;
    frame.image = file;
    scene.frames.push_back(std::move(frame));
  }
  number_frames(scene, out);
  fs::path folder = fs::absolute(scene.frames.front().image).lexically_normal().parent_path();
  scene.name = options.name.empty() ? folder.filename().string() : options.name;
  if (options.times.rate) {
    put_rate(scene, *options.times.rate, out);
  } else if (!options.times.list.empty()) {
    put_times(scene, listed_times(scene, options.times.list), options.times.list.string(), out);
  } else if (options.times.from_names) {
    put_times(scene, named_times(scene), places.front(), out);
  }
  measure_images(scene);
  put_camera(scene, options.camera, out);
  finish_import(options, out);
  return out;
}

}  // namespace camber
