#include "camber/pipeline/kitti_boxes.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <fstream>
#include <limits>
#include <map>
#include <set>
#include <sstream>
#include <stdexcept>

#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "camber/core/lower_case.h"

namespace camber {

namespace {

constexpr double kPi = 3.14159265358979323846;

bool is_vehicle(const KittiLabel& label) {
  const std::string type = lower_case(label.type);
  return type == "car" || type == "van" || type == "truck" || type == "bus";
}

/// @param frame  of the object form's rows.
int frame_of(const KittiLabel& label, int frame) { return label.frame >= 0 ? label.frame : frame; }

/// Share of the projected box outside the image; 1 if it reaches behind the camera.
double truncation_of(const OrientedBox& box, const PinholeCamera& camera) {
  const auto corners = box.corners();
  Box2 whole{1e12, 1e12, -1e12, -1e12};
  for (Eigen::Index i = 0; i < corners.cols(); ++i) {
    if (!(corners(2, i) > 0.1)) return 1.0;
    const Eigen::Vector2d p = *camera.project(corners.col(i));
    whole = {std::min(whole.x1, p.x()), std::min(whole.y1, p.y()), std::max(whole.x2, p.x()),
             std::max(whole.y2, p.y())};
  }
  return std::clamp(1.0 - whole.clipped(camera.width, camera.height).area() / whole.area(), 0.0,
                    1.0);
}

}  // namespace

Eigen::Matrix3d rotation_of(double rotation_y, const BoxTilt& tilt) {
  const Eigen::Matrix3d level = rotation_from_rotation_y(rotation_y);
  const Eigen::Vector3d front =
      std::cos(tilt.pitch) * level.col(0) + std::sin(tilt.pitch) * level.col(1);
  const Eigen::Vector3d up = level.col(2).cross(front);
  Eigen::Matrix3d out;
  out.col(0) = front;
  out.col(2) = std::cos(tilt.roll) * level.col(2) - std::sin(tilt.roll) * up;
  out.col(1) = out.col(2).cross(front);
  return out;
}

BoxTilt tilt_of(const Eigen::Matrix3d& camera_from_vehicle) {
  const Eigen::Vector3d front = camera_from_vehicle.col(0), right = camera_from_vehicle.col(2);
  const Eigen::Matrix3d level = rotation_from_rotation_y(rotation_y(camera_from_vehicle));
  BoxTilt out;
  out.pitch = std::asin(std::clamp(-front.y(), -1.0, 1.0));
  const Eigen::Vector3d up = level.col(2).cross(front);
  out.roll = std::atan2(-right.dot(up), right.dot(level.col(2)));
  return out;
}

std::filesystem::path tilt_file(const std::filesystem::path& labels) {
  std::filesystem::path out = labels;
  return out.replace_extension(".tilt.csv");
}

std::string LiftedBox::sources() const {
  std::string out;
  const auto add = [&](bool used, const char* name) {
    if (used) out += (out.empty() ? "" : "+") + std::string(name);
  };
  add(by_detector, "detector");
  add(by_box, "box");
  add(by_surface, "surface");
  return out;
}

void write_tilts(const std::vector<LiftedBox>& boxes, const std::filesystem::path& path) {
  std::string out =
      "row,frame,track,pitch,roll,status,patch,depth_factor,sigma_depth,reason,"
      "sources\n";
  for (std::size_t i = 0; i < boxes.size(); ++i) {
    const LiftedBox& b = boxes[i];
    std::string reason = b.reason;
    std::replace(reason.begin(), reason.end(), ',', ';');
    out += fmt::format("{},{},{},{:.9g},{:.9g},{},{},{:.6f},{:.4f},{},{}\n", i, b.label.frame,
                       b.label.track, b.tilt.pitch, b.tilt.roll, to_string(b.status), b.patch,
                       b.depth_factor, b.sigma_depth, reason, b.sources());
  }
  write_file_atomically(path, out);
}

std::vector<BoxTilt> read_tilts(const std::filesystem::path& path, std::size_t rows) {
  std::ifstream in(path);
  if (!in || std::filesystem::is_directory(path)) {
    throw InputError(path.string(), "cannot be read");
  }
  std::vector<BoxTilt> out(rows);
  std::string line;
  for (int number = 1; std::getline(in, line); ++number) {
    const auto fail = [&](const std::string& what) {
      throw InputError(path.string(), fmt::format("line {}", number), what);
    };
    if (number == 1) {
      if (line.rfind("row,frame,track,pitch,roll", 0) != 0) {
        fail("found \"" + line.substr(0, 40) + "\", expected \"row,frame,track,pitch,roll,...\"");
      }
      continue;
    }
    if (line.empty()) continue;
    std::istringstream text(line);
    double values[5];
    for (int i = 0; i < 5; ++i) {
      std::string field;
      std::getline(text, field, ',');
      std::size_t used = 0;
      try {
        values[i] = std::stod(field, &used);
      } catch (const std::exception&) {
        used = 0;
      }
      if (used == 0 || used != field.size() || !std::isfinite(values[i])) {
        fail("found \"" + field + "\", expected a number");
      }
    }
    if (values[0] < 0.0 || values[0] >= static_cast<double>(rows) ||
        values[0] != std::floor(values[0])) {
      fail(fmt::format("found row {}, expected one of the {} rows of the label file", values[0],
                       rows));
    }
    out[static_cast<std::size_t>(values[0])] = {values[3], values[4]};
  }
  return out;
}

Scene truth_from_kitti(const KittiLabelFile& labels, const KittiCalibration::Camera& camera,
                       int width, int height, int frame, const std::string& name) {
  constexpr double kOcclusion[] = {0.0, 0.3, 0.8, 1.0};
  Scene scene;
  scene.name = name;
  scene.camera = {width, height, camera.fx, camera.fy, camera.cx, camera.cy};
  scene.height_above_road = 1.65;
  std::map<int, TruthFrame> frames;
  int next = 0;
  for (const KittiLabel& label : labels.labels) {
    if (!is_vehicle(label) || !label.has_box3()) continue;
    TruthVehicle v;
    v.id = label.track >= 0 ? label.track : next++;
    v.vehicle_class = lower_case(label.type);
    v.box = label.box;
    v.pose.camera_from_vehicle =
        SE3(rotation_from_rotation_y(label.rotation_y), label.location + camera.offset);
    v.pose.dimensions = {label.length, label.width, label.height};
    v.occlusion = label.occluded >= 0 && label.occluded <= 3 ? kOcclusion[label.occluded] : 0.0;
    v.truncation = label.frame >= 0 && label.truncated == 1.0
                       ? truncation_of(v.pose, scene.camera)
                       : std::clamp(label.truncated, 0.0, 1.0);
    const int id = frame_of(label, frame);
    frames[id].id = id;
    frames[id].vehicles.push_back(std::move(v));
  }
  scene.truth.emplace();
  for (auto& [id, f] : frames) {
    SceneFrame empty;
    empty.id = id;
    scene.frames.push_back(empty);
    scene.truth->frames.push_back(std::move(f));
  }
  return scene;
}

VehicleDocument vehicles_from_kitti(const KittiLabelFile& labels,
                                    const KittiCalibration::Camera& camera, int frame,
                                    const std::vector<BoxTilt>& tilts, const std::string& method) {
  if (!tilts.empty() && tilts.size() != labels.labels.size()) {
    throw std::invalid_argument(
        fmt::format("tilts: {} for {} rows", tilts.size(), labels.labels.size()));
  }
  VehicleDocument out;
  out.method = method;
  std::map<int, VehicleFrame> frames;
  for (std::size_t i = 0; i < labels.labels.size(); ++i) {
    const KittiLabel& label = labels.labels[i];
    const int id = frame_of(label, frame);
    frames[id].id = id;
    if (!is_vehicle(label) || !label.has_box3()) continue;
    VehicleEstimate e;
    e.id = static_cast<int>(i);
    e.vehicle_class = lower_case(label.type);
    e.box = label.box;
    const Eigen::Matrix3d rotation =
        rotation_of(label.rotation_y, tilts.empty() ? BoxTilt{} : tilts[i]);
    e.pose.camera_from_vehicle = SE3(rotation, label.location + camera.offset);
    e.pose.dimensions = {label.length, label.width, label.height};
    // The wheels' plane; no uncertainty is stated.
    e.plane = Plane::through(e.pose.bottom_center(), rotation.col(1));
    e.plane_source = "given";
    e.covariance.setConstant(std::numeric_limits<double>::quiet_NaN());
    e.keypoints.fill(Eigen::Vector3d::Constant(std::numeric_limits<double>::quiet_NaN()));
    e.status = Status::kOk;
    frames[id].vehicles.push_back(std::move(e));
  }
  for (auto& [id, f] : frames) {
    (void)id;
    out.frames.push_back(std::move(f));
  }
  return out;
}

void add_empty_frames(const KittiLabelFile& labels, int frame, const SceneTruth& truth,
                      VehicleDocument* document) {
  int first = std::numeric_limits<int>::max(), last = std::numeric_limits<int>::min();
  for (const KittiLabel& label : labels.labels) {
    first = std::min(first, frame_of(label, frame));
    last = std::max(last, frame_of(label, frame));
  }
  std::set<int> there;
  for (const VehicleFrame& one : document->frames) there.insert(one.id);
  for (const TruthFrame& one : truth.frames) {
    const bool covered = labels.labels.empty() || (one.id >= first && one.id <= last);
    if (covered && there.insert(one.id).second) document->frames.push_back({one.id, {}});
  }
}

std::vector<LiftedBox> kitti_from_vehicles(const VehicleDocument& document, const Scene& scene,
                                           const Eigen::Vector3d& offset) {
  std::vector<LiftedBox> out;
  for (const VehicleFrame& frame : document.frames) {
    const SceneFrame* seen = scene.find_frame(frame.id);
    for (const VehicleEstimate& v : frame.vehicles) {
      if (v.status == Status::kFailed || v.status == Status::kNotRun) continue;
      LiftedBox row;
      KittiLabel& label = row.label;
      label.frame = frame.id;
      label.type = v.vehicle_class.empty() ? "Car" : v.vehicle_class;
      label.type[0] =
          static_cast<char>(std::toupper(static_cast<unsigned char>(label.type.front())));
      label.box = v.box;
      label.height = v.pose.dimensions.height;
      label.width = v.pose.dimensions.width;
      label.length = v.pose.dimensions.length;
      label.location = v.pose.bottom_center() - offset;
      const Eigen::Matrix3d rotation = v.pose.camera_from_vehicle.rotation_matrix();
      label.rotation_y = rotation_y(rotation);
      label.alpha = std::remainder(
          label.rotation_y - std::atan2(label.location.x(), label.location.z()), 2.0 * kPi);
      label.score = 1.0;
      label.track = v.track;
      if (seen) {
        for (const VehicleDetection& d : seen->vehicles) {
          if (d.id != v.id) continue;
          if (label.track < 0) label.track = d.track;
          label.score = d.score;
        }
      }
      row.tilt = tilt_of(rotation);
      row.status = v.status;
      row.reason = v.reason;
      if (v.plane_source.rfind("patch ", 0) == 0) row.patch = std::stoi(v.plane_source.substr(6));
      const Eigen::Vector3d ray = v.pose.center().normalized();
      row.sigma_depth = std::sqrt(std::max(ray.dot(v.covariance.topLeftCorner<3, 3>() * ray), 0.0));
      out.push_back(std::move(row));
    }
  }
  return out;
}

}  // namespace camber
