#include "camber/synth/data_set_layout.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "camber/core/atomic_file.h"
#include "camber/import/import_synthia.h"
#include "camber/import/kitti_labels.h"
#include "camber/scene/results.h"
#include "camber/synth/synth_mesh.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

struct LayoutName {
  SceneLayout layout;
  std::string_view name;
};
constexpr LayoutName kLayouts[] = {{SceneLayout::kCamber, "camber"},
                                   {SceneLayout::kSynthiaSf, "synthia-sf"},
                                   {SceneLayout::kKittiTracking, "kitti-tracking"}};

constexpr double kPi = 3.14159265358979323846;

/// m, of KITTI's left colour camera from camera 0: x_in_camera2 = x_in_camera0 + this.
const Eigen::Vector3d kCamera2Offset(0.06, 0.0, 0.0);

std::string file_of(int frame, int digits) { return fmt::format("{:0{}d}.png", frame, digits); }

std::string kitti_number(int sequence) { return fmt::format("{:04d}", sequence); }

std::uint8_t synthia_class(std::uint8_t label) {
  switch (static_cast<TruthLabel>(label)) {
    case TruthLabel::kRoad:
      return kSynthiaRoad;
    case TruthLabel::kPavement:
      return kSynthiaSidewalk;
    case TruthLabel::kBuilding:
      return kSynthiaBuilding;
    case TruthLabel::kPole:
      return kSynthiaPole;
    case TruthLabel::kSign:
      return kSynthiaTrafficSign;
    case TruthLabel::kVegetation:
      return kSynthiaVegetation;
    case TruthLabel::kTerrain:
      return kSynthiaTerrain;
    case TruthLabel::kSky:
      return kSynthiaSky;
    case TruthLabel::kCar:
      return kSynthiaCar;
  }
  return kSynthiaVoid;
}

std::string kitti_type(const std::string& vehicle_class) {
  return vehicle_class == "van" ? "Van" : "Car";
}

/// KITTI's codes of how much is hidden: 0 at most a tenth, 1 partly, 2 largely.
int occlusion_code(double share) { return share <= 0.1 ? 0 : share <= 0.55 ? 1 : 2; }

std::string matrix_row(const char* key, const Eigen::Matrix<double, 3, 4>& m) {
  std::string out = std::string(key) + ":";
  for (int i = 0; i < 12; ++i) out += fmt::format(" {:.12e}", m(i / 4, i % 4));
  return out + "\n";
}

std::string kitti_calibration(const PinholeCamera& camera) {
  Eigen::Matrix<double, 3, 4> p0 = Eigen::Matrix<double, 3, 4>::Zero();
  p0.leftCols<3>() << camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1;
  Eigen::Matrix<double, 3, 4> p2 = p0;
  p2.col(3) = p0.leftCols<3>() * kCamera2Offset;
  return matrix_row("P0", p0) + matrix_row("P2", p2) + "R0_rect: 1 0 0 0 1 0 0 0 1\n";
}

/// The true vehicle that a detection is of: the largest overlap, at least one half.
const TruthVehicle* vehicle_of(const VehicleDetection& detection, const TruthFrame& truth,
                               const PinholeCamera& camera) {
  const TruthVehicle* best = nullptr;
  double largest = 0.5;
  for (const TruthVehicle& vehicle : truth.vehicles) {
    const double overlap =
        intersection_over_union(vehicle.box.clipped(camera.width, camera.height), detection.box);
    if (overlap < largest) continue;
    largest = overlap;
    best = &vehicle;
  }
  return best;
}

}  // namespace

std::vector<SceneLayout> all_scene_layouts() {
  std::vector<SceneLayout> out;
  for (const LayoutName& entry : kLayouts) out.push_back(entry.layout);
  return out;
}

std::string_view to_string(SceneLayout layout) {
  for (const LayoutName& entry : kLayouts) {
    if (entry.layout == layout) return entry.name;
  }
  return "";
}

SceneLayout scene_layout_from_string(std::string_view word) {
  for (const LayoutName& entry : kLayouts) {
    if (entry.name == word) return entry.layout;
  }
  throw std::invalid_argument(
      fmt::format("layout '{}', expected camber, synthia-sf or kitti-tracking", word));
}

std::vector<fs::path> DataSetLayout::folders() const {
  std::vector<fs::path> out = {"segmentation", "truth"};
  for (const fs::path& file : {image(0), depth(0), label(0), detections()}) {
    if (!file.empty()) out.push_back(file.parent_path());
  }
  if (layout == SceneLayout::kKittiTracking) {
    out.emplace_back("label_02");
    out.emplace_back("calib");
  }
  return out;
}

fs::path DataSetLayout::image(int frame) const {
  switch (layout) {
    case SceneLayout::kSynthiaSf:
      return fs::path(fmt::format("SEQ{}", sequence)) / "RGBLeft" / file_of(frame, 7);
    case SceneLayout::kKittiTracking:
      return fs::path("image_02") / kitti_number(sequence) / file_of(frame, 6);
    default:
      return fs::path("image") / file_of(frame, 6);
  }
}

fs::path DataSetLayout::depth(int frame) const {
  if (layout == SceneLayout::kSynthiaSf) {
    return fs::path(fmt::format("SEQ{}", sequence)) / "DepthLeft" / file_of(frame, 7);
  }
  return fs::path("truth/depth") / file_of(frame, 6);
}

fs::path DataSetLayout::label(int frame) const {
  if (layout == SceneLayout::kSynthiaSf) {
    return fs::path(fmt::format("SEQ{}", sequence)) / "GTLeft" / file_of(frame, 7);
  }
  return fs::path("truth/label") / file_of(frame, 6);
}

fs::path DataSetLayout::detections() const {
  switch (layout) {
    case SceneLayout::kSynthiaSf:
      return fs::path("detections") / fmt::format("SEQ{}.txt", sequence);
    case SceneLayout::kKittiTracking:
      return fs::path("detections_02") / (kitti_number(sequence) + ".txt");
    default:
      return {};
  }
}

Image synthia_depth_image(const ViewTruth& truth, int width, int height) {
  constexpr double kLargest = (1 << 24) - 1, kMetres = 1000.0;
  Image out{width, height, 3, {}};
  out.data.reserve(3 * truth.hits.size());
  for (const WorldHit& hit : truth.hits) {
    const auto value = static_cast<std::uint32_t>(
        std::lround(std::min(hit.distance, kMetres) / kMetres * kLargest));
    for (const int shift : {0, 8, 16}) {
      out.data.push_back(static_cast<std::uint8_t>(value >> shift & 255));
    }
  }
  return out;
}

Image synthia_label_image(const ViewTruth& truth, int width, int height, bool instance_ids) {
  Image out{width, height, 3, {}};
  out.data.reserve(3 * truth.hits.size());
  for (std::size_t i = 0; i < truth.hits.size(); ++i) {
    const int instance = instance_ids ? truth.hits[i].car + 1 : 0;
    out.data.push_back(synthia_class(truth.labels[i]));
    out.data.push_back(static_cast<std::uint8_t>(instance & 255));
    out.data.push_back(static_cast<std::uint8_t>(instance >> 8 & 255));
  }
  return out;
}

void write_kitti_detections(const Scene& scene, const fs::path& path) {
  KittiLabelFile file{KittiLabelForm::kTracking, {}};
  for (const SceneFrame& frame : scene.frames) {
    for (const VehicleDetection& detection : frame.vehicles) {
      KittiLabel label;
      label.frame = frame.id;
      label.type = kitti_type(detection.vehicle_class);
      label.box = detection.box;
      label.score = detection.score;
      file.labels.push_back(label);
    }
  }
  write_kitti_labels(file, path);
}

void write_kitti_tracking_files(const Scene& scene, int sequence, const fs::path& root) {
  const std::string number = kitti_number(sequence);
  KittiLabelFile file{KittiLabelForm::kTracking, {}};
  nlohmann::json cars = nlohmann::json::array();
  for (const TruthFrame& truth : scene.truth->frames) {
    for (const TruthVehicle& vehicle : truth.vehicles) {
      KittiLabel label;
      label.frame = truth.id;
      label.track = vehicle.id;
      label.type = kitti_type(vehicle.vehicle_class);
      label.box = vehicle.box.clipped(scene.camera.width, scene.camera.height);
      label.truncated = vehicle.truncation > 0.02 ? 1.0 : 0.0;
      label.occluded = occlusion_code(vehicle.occlusion);
      label.height = vehicle.pose.dimensions.height;
      label.width = vehicle.pose.dimensions.width;
      label.length = vehicle.pose.dimensions.length;
      label.location = vehicle.pose.bottom_center() - kCamera2Offset;
      label.rotation_y = rotation_y(vehicle.pose.camera_from_vehicle.rotation_matrix());
      label.alpha = std::remainder(
          label.rotation_y - std::atan2(label.location.x(), label.location.z()), 2.0 * kPi);
      file.labels.push_back(label);
    }
    const SceneFrame* frame = scene.find_frame(truth.id);
    for (const VehicleDetection& detection : frame->vehicles) {
      const TruthVehicle* vehicle = vehicle_of(detection, truth, scene.camera);
      if (!vehicle || detection.keypoints.empty()) continue;
      nlohmann::json rows = nlohmann::json::array();
      for (const KeypointObservation& k : detection.keypoints) {
        rows.push_back({k.pixel.x(), k.pixel.y(), k.confidence});
      }
      const Box2& box = detection.box;
      cars.push_back({{"sequence", sequence},
                      {"frame", truth.id},
                      {"track_id", vehicle->id},
                      {"bbox_xyxy", {box.x1, box.y1, box.x2, box.y2}},
                      {"keypoints_uv_confidence", rows}});
    }
  }
  write_kitti_labels(file, root / "label_02" / (number + ".txt"));
  write_file_atomically(root / "calib" / (number + ".txt"), kitti_calibration(scene.camera));
  write_json(cars, root / "keypoints.json");
}

}  // namespace camber
