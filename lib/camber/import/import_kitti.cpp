#include "camber/import/import_kitti.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cctype>
#include <cmath>
#include <map>
#include <set>

#include "camber/cloud/cloud_io.h"
#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "camber/core/lower_case.h"
#include "camber/core/made_folder.h"
#include "camber/import/detail/own_data.h"
#include "camber/import/formats/frame_files.h"
#include "camber/import/import_common.h"
#include "camber/import/kitti_keypoints.h"
#include "camber/import/kitti_labels.h"
#include "camber/import/text_rows.h"
#include "camber/scene/json_reader.h"
#include "camber/scene/validate_scene.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

using Projection = KittiCalibration::Projection;

/// The camera that a path like .../image_02/0009 belongs to.
std::optional<int> camera_of_folder(const fs::path& folder) {
  const fs::path whole = fs::absolute(folder).lexically_normal();
  std::optional<int> out;
  for (const fs::path& part : whole) {  // the last match wins
    const std::string name = part.string();
    if (name.rfind("image_", 0) != 0) continue;
    const std::string digits = name.substr(6);
    if (digits.size() == 1 && digits[0] >= '0' && digits[0] <= '3') out = digits[0] - '0';
    if (digits.size() == 2 && digits[0] == '0' && digits[1] >= '0' && digits[1] <= '3') {
      out = digits[1] - '0';
    }
  }
  return out;
}

// ---- calibration --------------------------------------------------------------------------------

template <int Rows, int Columns>
Eigen::Matrix<double, Rows, Columns> read_matrix(const TextRows& text, const TextRow& row,
                                                 std::size_t first, const std::string& key) {
  if (row.words.size() - first != Rows * Columns) {
    text.fail(row, fmt::format("found {} numbers for {}, expected {}", row.words.size() - first,
                               key, Rows * Columns));
  }
  Eigen::Matrix<double, Rows, Columns> out;
  for (int i = 0; i < Rows * Columns; ++i) {
    out(i / Columns, i % Columns) =
        text.number(row, row.words[first + static_cast<std::size_t>(i)], "a number of " + key);
  }
  return out;
}

template <class T>
void put_once(const TextRows& text, const TextRow& row, const std::string& key,
              std::optional<T>& to, const T& value) {
  if (to) text.fail(row, fmt::format("found {} a second time, expected it once", key));
  to = value;
}

/// R and T of one of KITTI raw's files, which name neither of the two frames.
struct RawTransform {
  fs::path file;
  std::optional<Eigen::Matrix3d> rotation;
  std::optional<Eigen::Vector3d> translation;
  bool of_camera = false;  // with delta_f and delta_c: calib_velo_to_cam.txt
};

void read_calibration_file(const fs::path& path, KittiCalibration& out, RawTransform& raw) {
  const TextRows text(path);
  raw.file = path;
  std::size_t bare_rows = 0;
  for (const TextRow& row : text.rows()) {
    double ignored = 0.0;
    if (parse_number(row.words[0].text, &ignored)) {
      if (bare_rows >= out.projections.size()) {
        text.fail(row, "found a fifth row of numbers, expected at most P0 to P3");
      }
      const std::string key = fmt::format("P{}", bare_rows);
      put_once(text, row, key, out.projections[bare_rows], read_matrix<3, 4>(text, row, 0, key));
      ++bare_rows;
      continue;
    }
    // "P2: 1 2 ...", "P2:1 2 ...", and "R_rect 1 2 ..." of the tracking benchmark.
    TextRow numbers = row;
    std::string key(row.words[0].text);
    std::size_t first = 1;
    if (const auto colon = key.find(':'); colon != std::string::npos) {
      if (colon + 1 < key.size()) {
        numbers.words[0].text.remove_prefix(colon + 1);
        numbers.words[0].column += static_cast<int>(colon + 1);
        first = 0;
      }
      key.resize(colon);
    }
    const auto index_after = [&](const char* prefix, std::size_t digits) -> int {
      const std::string start = prefix;
      if (key.size() != start.size() + digits || key.rfind(start, 0) != 0) return -1;
      if (digits == 2 && key[start.size()] != '0') return -1;
      const int index = key.back() - '0';
      return index >= 0 && index <= 3 ? index : -1;
    };
    const int projection = std::max(index_after("P", 1), index_after("P_rect_", 2));
    if (projection >= 0) {
      put_once(text, row, key, out.projections[static_cast<std::size_t>(projection)],
               read_matrix<3, 4>(text, numbers, first, key));
    } else if (key == "R0_rect" || key == "R_rect" || key == "R_rect_00") {
      put_once(text, row, key, out.rectification, read_matrix<3, 3>(text, numbers, first, key));
    } else if (key == "Tr_velo_to_cam" || key == "Tr_velo_cam") {
      put_once(text, row, key, out.camera0_from_laser,
               read_matrix<3, 4>(text, numbers, first, key));
    } else if (key == "Tr") {
      put_once(text, row, key, out.rectified_from_laser,
               read_matrix<3, 4>(text, numbers, first, key));
    } else if (key == "R") {
      put_once(text, row, key, raw.rotation, read_matrix<3, 3>(text, numbers, first, key));
    } else if (key == "T") {
      put_once(text, row, key, raw.translation, read_matrix<3, 1>(text, numbers, first, key));
    } else if (key == "delta_f" || key == "delta_c") {
      raw.of_camera = true;
    } else if (key == "Tr_imu_to_velo" || key == "Tr_imu_velo") {
      put_once(text, row, key, out.laser_from_imu, read_matrix<3, 4>(text, numbers, first, key));
    }
  }
}

void check_rotation(const Eigen::Matrix3d& r, const std::string& file, const std::string& key) {
  const double error = (r.transpose() * r - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff();
  if (error <= 1e-3 && r.determinant() > 0.0) return;
  throw InputError(file, key, "found a matrix that is no rotation, expected one");
}

// ---- labels -------------------------------------------------------------------------------------

double occlusion_share(int code) {
  switch (code) {
    case 1:
      return 0.3;
    case 2:
      return 0.8;
    case 3:
      return 1.0;
    default:
      return 0.0;
  }
}

/// @param skipped counts rows without a 3D box.
std::vector<TruthVehicle> truth_of(const FrameLabels& frame, const std::vector<KittiLabel>& labels,
                                   const PinholeCamera& camera, const Eigen::Vector3d& offset,
                                   int* skipped) {
  std::set<int> tracks;
  for (const KittiLabel& label : labels) {
    if (label.track >= 0 && !tracks.insert(label.track).second) {
      throw InputError(frame.file.string(), fmt::format("line {}", label.line),
                       fmt::format("found track {} a second time in frame {}, expected it once",
                                   label.track, label.frame));
    }
  }
  const std::vector<int> ids = ids_of(labels);
  std::vector<TruthVehicle> out;
  for (std::size_t i = 0; i < labels.size(); ++i) {
    const KittiLabel& label = labels[i];
    if (!label.has_box3()) {
      ++*skipped;
      continue;
    }
    TruthVehicle vehicle;
    vehicle.id = ids[i];
    vehicle.vehicle_class = lower_case(label.type);
    vehicle.box = label.box;
    vehicle.pose.camera_from_vehicle =
        SE3(rotation_from_rotation_y(label.rotation_y), label.location + offset);
    vehicle.pose.dimensions = {label.length, label.width, label.height};
    vehicle.occlusion = occlusion_share(label.occluded);
    const bool flag_alone = label.frame >= 0 && label.truncated == 1.0;
    vehicle.truncation = flag_alone ? projected_truncation(vehicle.pose, camera)
                                    : std::clamp(label.truncated, 0.0, 1.0);
    out.push_back(std::move(vehicle));
  }
  return out;
}

TruthFrame& truth_frame(SceneTruth& truth, int id) {
  for (TruthFrame& frame : truth.frames) {
    if (frame.id == id) return frame;
  }
  truth.frames.emplace_back();
  truth.frames.back().id = id;
  return truth.frames.back();
}

int camera_index(const KittiImportOptions& options) {
  if (options.camera) return *options.camera;
  const std::optional<int> camera = camera_of_folder(options.images);
  if (!camera) {
    throw UsageError(
        fmt::format("--images {}: the path names no camera, expected a folder like "
                    "image_02 in it, or --camera 0 to 3",
                    options.images.string()));
  }
  return *camera;
}

/// Keypoints of the named file for the scene's detections.
void put_keypoints(const KittiImportOptions& options, Scene* scene, const LogSink& warn) {
  fs::path folder = fs::absolute(options.images).lexically_normal();
  if (!folder.has_filename()) folder = folder.parent_path();
  std::optional<int> sequence = options.sequence;
  if (!sequence) sequence = frame_number(folder.filename());
  const KeypointMatches matches = put_kitti_keypoints(read_kitti_keypoints(options.keypoints),
                                                      sequence, options.keypoints, scene);
  if (!warn) return;
  if (matches.placed == 0) {
    warn(fmt::format("{}: no keypoints for a detection of these frames",
                     options.keypoints.string()));
  } else if (matches.left_over > 0) {
    warn(fmt::format("{}: {} of {} keypoint sets meet no detection", options.keypoints.string(),
                     matches.left_over, matches.placed + matches.left_over));
  }
}

std::vector<fs::path> calibration_files(const KittiImportOptions& options) {
  if (!options.calibration.empty()) return options.calibration;
  fs::path folder = fs::absolute(options.images).lexically_normal();
  if (!folder.has_filename()) folder = folder.parent_path();
  const fs::path beside = folder.parent_path() / "calib.txt";
  std::error_code error;
  if (!fs::exists(beside, error)) {
    throw UsageError(
        fmt::format("no --calib is given and there is no {}, expected a KITTI "
                    "calibration file",
                    beside.string()));
  }
  return {beside};
}

}  // namespace

KittiCalibration::Camera KittiCalibration::camera(int index) const {
  const std::string key = fmt::format("P{}", index);
  if (index < 0 || index > 3)
    throw std::invalid_argument("camera " + std::to_string(index) + ", expected 0 to 3");
  const std::optional<Projection>& projection = projections[static_cast<std::size_t>(index)];
  if (!projection) {
    std::string there;
    for (int i = 0; i < 4; ++i) {
      if (projections[static_cast<std::size_t>(i)])
        there += fmt::format("{}P{}", there.empty() ? "" : ", ", i);
    }
    throw InputError(file, fmt::format("found {}, expected {} (camera {} of the images)",
                                       there.empty() ? "no projection" : there, key, index));
  }
  const Projection& p = *projection;
  const bool rectified = p(0, 0) > 0 && p(1, 1) > 0 && p(0, 1) == 0 && p(1, 0) == 0 &&
                         p(2, 0) == 0 && p(2, 1) == 0 && p(2, 2) == 1;
  if (!rectified) {
    throw InputError(file, key,
                     fmt::format("found the 3 x 3 part [{} {} {}; {} {} {}; {} {} {}], "
                                 "expected [fx 0 cx; 0 fy cy; 0 0 1] of a rectified camera",
                                 p(0, 0), p(0, 1), p(0, 2), p(1, 0), p(1, 1), p(1, 2), p(2, 0),
                                 p(2, 1), p(2, 2)));
  }
  Camera out{p(0, 0), p(1, 1), p(0, 2), p(1, 2), {}};
  out.offset.z() = p(2, 3);
  out.offset.x() = (p(0, 3) - p(0, 2) * p(2, 3)) / p(0, 0);
  out.offset.y() = (p(1, 3) - p(1, 2) * p(2, 3)) / p(1, 1);
  return out;
}

Eigen::Matrix4d KittiCalibration::camera_from_laser(int index) const {
  Eigen::Matrix4d rectified = Eigen::Matrix4d::Identity();
  if (rectified_from_laser) {
    rectified.topRows<3>() = *rectified_from_laser;
    check_rotation(rectified.topLeftCorner<3, 3>(), file, "Tr");
  } else if (camera0_from_laser && rectification) {
    check_rotation(camera0_from_laser->leftCols<3>(), file, "Tr_velo_to_cam");
    check_rotation(*rectification, file, "R0_rect");
    rectified.topRows<3>() = *rectification * *camera0_from_laser;
  } else {
    throw InputError(file,
                     fmt::format("found no {}, expected R0_rect and Tr_velo_to_cam (or Tr) to "
                                 "place laser scans",
                                 camera0_from_laser ? "R0_rect" : "Tr_velo_to_cam"));
  }
  rectified.topRightCorner<3, 1>() += camera(index).offset;
  return rectified;
}

std::optional<Eigen::Vector3d> KittiCalibration::antenna(int index) const {
  if (!laser_from_imu || !(rectified_from_laser || (camera0_from_laser && rectification)))
    return std::nullopt;
  const Eigen::Vector3d in_laser = laser_from_imu->col(3);
  return Eigen::Vector3d((camera_from_laser(index) * in_laser.homogeneous()).head<3>());
}

KittiCalibration read_kitti_calibration(const std::vector<fs::path>& files) {
  if (files.empty()) throw std::invalid_argument("read_kitti_calibration: no file is given");
  KittiCalibration out;
  std::vector<RawTransform> raw;
  for (const fs::path& file : files) {
    out.file += (out.file.empty() ? "" : ", ") + file.string();
    RawTransform one;
    read_calibration_file(file, out, one);
    if (one.rotation && one.translation) raw.push_back(std::move(one));
  }
  // The inertial unit's file is known by its name, else by what the laser's has and it has not.
  const bool one_of_camera =
      std::any_of(raw.begin(), raw.end(), [](const auto& r) { return r.of_camera; });
  for (const RawTransform& one : raw) {
    const std::string name = lower_case(one.file.filename().string());
    const bool imu =
        name.find("imu") != std::string::npos ||
        (name.find("velo_to_cam") == std::string::npos && one_of_camera && !one.of_camera);
    std::optional<Projection>& to = imu ? out.laser_from_imu : out.camera0_from_laser;
    if (to) {
      throw InputError(one.file.string(),
                       fmt::format("found R and T of {} a second time, expected them once",
                                   imu ? "an inertial unit" : "a laser"));
    }
    to.emplace();
    *to << *one.rotation, *one.translation;
  }
  return out;
}

std::vector<SE3> read_kitti_poses(const fs::path& path) {
  const TextRows text(path);
  std::vector<SE3> out;
  for (const TextRow& row : text.rows()) {
    const Projection m = read_matrix<3, 4>(text, row, 0, "a pose (3 x 4, row by row)");
    const Eigen::Matrix3d r = m.leftCols<3>();
    const double error = (r.transpose() * r - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff();
    if (!(error <= 1e-3) || !(r.determinant() > 0.0)) {
      text.fail(row, "found a matrix whose 3 x 3 part is no rotation, expected a rigid pose");
    }
    out.emplace_back(r, m.col(3));
  }
  return out;
}

void KittiImportOptions::validate() const {
  const auto positive = [](double value, const char* what) {
    if (!(value > 0.0) || !std::isfinite(value)) {
      throw std::invalid_argument(fmt::format("{} {}, expected a positive number", what, value));
    }
  };
  validate_camera_height(camera_height);
  positive(frame_rate, "frame_rate");
  positive(up_sigma, "up_sigma");
  positive(gnss.sigma, "gnss.sigma");
  positive(gnss.heading_sigma, "gnss.heading_sigma");
  if (camera && (*camera < 0 || *camera > 3)) {
    throw std::invalid_argument(fmt::format("camera {}, expected 0 to 3", *camera));
  }
  if (poses_camera && (*poses_camera < 0 || *poses_camera > 3)) {
    throw std::invalid_argument(fmt::format("poses_camera {}, expected 0 to 3", *poses_camera));
  }
  if (detections_from_labels && labels.empty()) {
    throw std::invalid_argument("detections_from_labels without labels, expected a label file");
  }
  if (detections_from_labels && !detections.empty()) {
    throw std::invalid_argument("both detections and detections_from_labels, expected one of them");
  }
  if (classes.empty()) throw std::invalid_argument("classes is empty, expected at least one type");
  if (!keypoints.empty() && detections.empty() && !detections_from_labels) {
    throw std::invalid_argument("keypoints without detections, expected boxes that they belong to");
  }
}

namespace {

/// times.txt of the odometry layout (beside the images' folder) or timestamps.txt of the raw one
/// (beside image_02/data, or in the images' folder); empty: none.
fs::path times_beside(const fs::path& images) {
  fs::path folder = fs::absolute(images).lexically_normal();
  if (!folder.has_filename()) folder = folder.parent_path();
  for (const fs::path& file :
       {folder.parent_path() / "times.txt", folder.parent_path() / "timestamps.txt",
        folder / "timestamps.txt"}) {
    std::error_code error;
    if (fs::is_regular_file(file, error)) return file;
  }
  return {};
}

/// Gives the frames their own times: row i is that of the i-th image where there is one for each,
/// else of frame i. Dates count from the first row.
void put_kitti_times(const KittiImportOptions& options, const std::map<int, fs::path>& images,
                     const LogSink& warn, Scene* scene) {
  const fs::path file = options.times.empty() ? times_beside(options.images) : options.times;
  if (file.empty()) return;
  const std::vector<ListedTime> times = read_frame_times(file);
  const bool by_order = times.size() == images.size();
  const auto last = static_cast<std::size_t>(scene->frames.back().id);
  if (!by_order && times.size() <= last) {
    const std::string found = fmt::format(
        "found {} times, expected one for each of the {} images, or at least {} so "
        "that row i is frame i",
        times.size(), images.size(), last + 1);
    if (!options.times.empty()) throw InputError(file.string(), found);
    if (warn) warn(fmt::format("{}: {}; it is not used", file.string(), found));
    return;
  }
  constexpr double kLongestDrive = 1e8;  // s; more are seconds since 1970
  const double zero = std::abs(times.front().time_s) > kLongestDrive ? times.front().time_s : 0.0;
  const SceneFrame* before = nullptr;
  for (SceneFrame& frame : scene->frames) {
    const std::size_t row =
        by_order ? static_cast<std::size_t>(std::distance(images.begin(), images.find(frame.id)))
                 : static_cast<std::size_t>(frame.id);
    frame.time_s = times[row].time_s - zero;
    if (before && !(*frame.time_s > *before->time_s)) {
      throw InputError(
          file.string(),
          fmt::format("found {:.6f} s of frame {} after {:.6f} s of frame {}, expected "
                      "ascending times",
                      *frame.time_s, frame.id, *before->time_s, before->id));
    }
    before = &frame;
  }
}

}  // namespace

Scene import_kitti(const KittiImportOptions& options, const LogSink& warn) {
  options.validate();
  const int index = camera_index(options);
  const std::map<int, fs::path> images =
      numbered_files(options.images, {".png", ".jpg", ".jpeg"}, "images");
  const KittiCalibration calibration = read_kitti_calibration(calibration_files(options));
  const KittiCalibration::Camera camera = calibration.camera(index);

  Scene scene;
  fs::path folder = fs::absolute(options.images).lexically_normal();
  if (!folder.has_filename()) folder = folder.parent_path();
  scene.name = options.name.empty() ? folder.parent_path().filename().string() : options.name;
  scene.camera.fx = camera.fx;
  scene.camera.fy = camera.fy;
  scene.camera.cx = camera.cx;
  scene.camera.cy = camera.cy;
  scene.height_above_road = options.camera_height;
  if (options.height_sigma) scene.height_sigma = *options.height_sigma;
  scene.frame_rate = options.frame_rate;
  for (const auto& [number, file] : images) {
    SceneFrame frame;
    frame.id = number;
    frame.time_s = number / options.frame_rate;
    frame.image = file;
    scene.frames.push_back(std::move(frame));
  }
  const std::vector<int> selected = keep_frames(scene, options.frames);
  put_kitti_times(options, images, warn, &scene);
  measure_images(scene);
  if (const std::string off_centre = off_centre_camera(scene.camera); warn && !off_centre.empty()) {
    warn(calibration.file + ": found no " + off_centre.substr(2));
  }
  if (options.reference_frame) {
    if (!scene.find_frame(*options.reference_frame)) {
      throw UsageError(fmt::format("reference frame {} is not among the frames {} to {}",
                                   *options.reference_frame, selected.front(), selected.back()));
    }
    scene.reference_frame = options.reference_frame;
  }

  std::set<std::string> classes;
  for (const std::string& name : options.classes) classes.insert(lower_case(name));
  SceneTruth truth;
  if (!options.labels.empty()) {
    int skipped = 0;
    const auto labels = read_frame_labels(options.labels, scene.frames, "label files", warn);
    for (SceneFrame& frame : scene.frames) {
      TruthFrame& true_frame = truth_frame(truth, frame.id);
      const auto at = labels.find(frame.id);
      if (at == labels.end()) continue;
      const std::vector<KittiLabel> vehicles = vehicles_among(at->second.labels, classes);
      true_frame.vehicles = truth_of(at->second, vehicles, scene.camera, camera.offset, &skipped);
      if (options.detections_from_labels) frame.vehicles = detections_of(vehicles);
    }
    if (options.detections_from_labels) scene.detections_source = "truth_boxes";
    if (skipped > 0 && warn) {
      warn(fmt::format("{}: {} row{} without a 3D box left out of the truth",
                       options.labels.string(), skipped, skipped == 1 ? "" : "s"));
    }
  }
  if (!options.detections.empty()) {
    put_detections(scene, options.detections, classes, warn);
  }
  if (!options.keypoints.empty()) put_keypoints(options, &scene, warn);
  if (!options.poses.empty()) {
    const std::vector<SE3> poses = read_kitti_poses(options.poses);
    // Row i belongs to the i-th image where there is one for each, else to frame i.
    const bool by_order = poses.size() == images.size();
    if (!by_order && poses.size() <= static_cast<std::size_t>(selected.back())) {
      throw InputError(options.poses.string(),
                       fmt::format("found {} poses, expected one for each of the {} images, or at "
                                   "least {} so that row i is frame i",
                                   poses.size(), images.size(), selected.back() + 1));
    }
    const Eigen::Vector3d of_poses = options.poses_camera
                                         ? calibration.camera(*options.poses_camera).offset
                                         : Eigen::Vector3d(Eigen::Vector3d::Zero());
    const SE3 posed_from_camera(Eigen::Quaterniond::Identity(),
                                Eigen::Vector3d(of_poses - camera.offset));
    for (const SceneFrame& frame : scene.frames) {
      const std::size_t row =
          by_order ? static_cast<std::size_t>(std::distance(images.begin(), images.find(frame.id)))
                   : static_cast<std::size_t>(frame.id);
      truth_frame(truth, frame.id).world_from_camera = poses[row] * posed_from_camera;
    }
  }
  if (!truth.frames.empty()) scene.truth = std::move(truth);
  OwnImport sensors;
  sensors.scene = std::move(scene);
  if (!options.up.empty()) put_own_up(sensors.scene, options.up, options.up_sigma, sensors);
  if (!options.gnss.file.empty()) {
    GnssOptions gnss = options.gnss;
    if (const auto place = calibration.antenna(index); place && gnss.antenna.isZero(0.0))
      gnss.antenna = *place;
    put_gnss(sensors.scene, gnss, sensors);
  }
  return std::move(sensors.scene);
}

Scene import_kitti_to(const KittiImportOptions& options, const fs::path& manifest,
                      const LogSink& warn) {
  Scene scene = import_kitti(options, warn);
  if (options.velodyne.empty()) {
    write_scene(scene, manifest);
    return scene;
  }
  const auto scans = numbered_files(options.velodyne, {".bin", ".pcd"}, "laser scans");
  std::vector<int> ids;
  for (const SceneFrame& frame : scene.frames) ids.push_back(frame.id);
  const int reference = choose_reference_frame(scene, ids);
  const auto scan = scans.find(reference);
  if (scan == scans.end()) {
    throw InputError(options.velodyne.string(),
                     fmt::format("found no scan of frame {}, expected one (or another reference "
                                 "frame)",
                                 reference));
  }
  const KittiCalibration calibration = read_kitti_calibration(calibration_files(options));
  const Eigen::Matrix4d camera_from_laser = calibration.camera_from_laser(camera_index(options));
  const RoadCloud laser = read_cloud(scan->second);
  std::vector<int> finite;
  for (std::size_t i = 0; i < laser.size(); ++i) {
    if (laser.points[i].allFinite()) finite.push_back(static_cast<int>(i));
  }
  RoadCloud cloud = laser.select(finite);
  for (Eigen::Vector3f& point : cloud.points) {
    const Eigen::Vector3d x = cloud.origin + point.cast<double>();
    point = (camera_from_laser.topLeftCorner<3, 3>() * x + camera_from_laser.topRightCorner<3, 1>())
                .cast<float>();
  }
  cloud.origin.setZero();
  cloud.frame = CloudFrame::kCamera;
  cloud.metric = true;

  if (!scene.truth) scene.truth.emplace();
  scene.reference_frame = reference;
  scene.truth->cloud_frame = reference;
  const fs::path folder =
      (manifest.has_parent_path() ? manifest.parent_path() : fs::path(".")) / "truth";
  scene.truth->cloud = folder / fmt::format("scan_{:06}.ply", reference);
  check_output_file(manifest);  // its folder is the caller's
  MadeFolder made(folder);
  AtomicFiles files;
  write_cloud(cloud, files.stage(scene.truth->cloud));
  write_scene(scene, files.stage(manifest));
  files.commit();
  made.keep();
  return scene;
}

}  // namespace camber
