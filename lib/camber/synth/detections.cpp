#include "camber/synth/detections.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "camber/core/random.h"
#include "camber/synth/detail/noise.h"

namespace camber {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr int kHalf = kNumKeypoints / 2;

/// Whether a keypoint is inside what the files show and hidden by no more than 6 cm of anything.
bool keypoint_visible(const SynthWorld& world, int frame, const ViewCamera& view,
                      const Eigen::Vector3d& in_camera, const Eigen::Vector2d& pixel) {
  if (!view.shows(pixel)) return false;
  const SE3& pose = world.views[frame].world_from_camera;
  const Eigen::Vector3d direction = pose.rotation() * in_camera;
  const WorldHit hit = cast_ray(world, frame, pose.translation(), direction);
  return (1.0 - hit.distance) * in_camera.norm() < 0.06;
}

}  // namespace

Box2 full_box(const SynthCar& car, int frame, const SE3& world_from_camera,
              const PinholeCamera& camera) {
  const SE3 camera_from_vehicle = world_from_camera.inverse() * car.world_from_vehicle[frame];
  Box2 box{kInfinity, kInfinity, -kInfinity, -kInfinity};
  for (const Eigen::Vector3d& vertex : car.model.mesh.vertices) {
    const auto pixel = camera.project(camera_from_vehicle * vertex);
    if (!pixel) continue;
    box.x1 = std::min(box.x1, pixel->x());
    box.y1 = std::min(box.y1, pixel->y());
    box.x2 = std::max(box.x2, pixel->x());
    box.y2 = std::max(box.y2, pixel->y());
  }
  return box;
}

std::vector<TruthVehicle> true_vehicles(const SynthWorld& world, int frame, const ViewCamera& view,
                                        const ViewTruth& truth) {
  std::vector<TruthVehicle> out;
  const SE3& world_from_camera = world.views[frame].world_from_camera;
  const SE3 camera_from_world = world_from_camera.inverse();
  for (std::size_t i = 0; i < world.cars.size(); ++i) {
    const SynthCar& car = world.cars[i];
    TruthVehicle vehicle;
    vehicle.pose = {camera_from_world * car.world_from_vehicle[frame], car.model.dimensions};
    const auto corners = vehicle.pose.corners();
    if (corners.row(2).minCoeff() < 0.5) continue;
    vehicle.box = full_box(car, frame, world_from_camera, view.camera());
    const double inside = view.shown(vehicle.box).share;
    if (!(inside > 0.0)) continue;
    vehicle.id = car.track;
    vehicle.vehicle_class = car.model.car_class == CarClass::kVan ? "van" : "car";
    vehicle.plane = car.ground_plane[frame].plane.transformed(camera_from_world);
    for (const Eigen::Vector3d& keypoint : car.model.keypoints) {
      vehicle.keypoints.push_back(vehicle.pose.camera_from_vehicle * keypoint);
    }
    vehicle.moving = car.moving;
    vehicle.truncation = std::clamp(1.0 - inside, 0.0, 1.0);
    vehicle.occlusion =
        truth.outline_pixels[i] > 0
            ? 1.0 - static_cast<double>(truth.visible_pixels[i]) / truth.outline_pixels[i]
            : 1.0;
    out.push_back(std::move(vehicle));
  }
  return out;
}

namespace {

/// A keypoint as the simulated network places it in the detection's box.
/// @param base  first index of its random numbers
KeypointObservation simulate_keypoint(const SynthWorld& world, int frame, const ViewCamera& view,
                                      const TruthVehicle& vehicle, int k, const Box2& box,
                                      const DetectorModel& model, const CounterRandom& random,
                                      std::uint64_t base) {
  const PinholeCamera& camera = view.camera();
  const double crop_x = box.width() / 64.0, crop_y = box.height() / 64.0;
  const auto pixel = camera.project(vehicle.keypoints[k]);
  const Eigen::Vector2d truth = pixel.value_or(box.center());
  const bool visible = pixel && keypoint_visible(world, frame, view, vehicle.keypoints[k], truth);
  const Eigen::Vector2d wobble(random.normal(base), random.normal(base + 1));
  Eigen::Vector2d crop((truth.x() - box.x1) / crop_x, (truth.y() - box.y1) / crop_y);
  double confidence = 0.0;
  if (visible) {
    // Some keypoints are harder than others, and the network half knows it.
    const double hard = std::exp(0.35 * random.normal(base + 2));
    const Eigen::Vector2d error = model.keypoint_error * hard * wobble;
    confidence = 0.92 - 0.10 * hard - 0.04 * error.norm() + 0.06 * random.normal(base + 3);
    if (random.uniform(base + 4) < model.outlier_share) {
      const auto mirrored = camera.project(vehicle.keypoints[(k + kHalf) % kNumKeypoints]);
      if (random.uniform(base + 5) < 0.5 && mirrored) {
        crop = {(mirrored->x() - box.x1) / crop_x, (mirrored->y() - box.y1) / crop_y};
      } else {
        crop = {random.uniform(base + 6, 0.0, 64.0), random.uniform(base + 7, 0.0, 64.0)};
      }
      confidence -= 0.25 * random.uniform(base + 8);
    }
    crop += error;
    confidence = std::clamp(confidence, 0.05, 1.0);
  } else {
    crop += 5.0 * wobble;
    crop = crop.cwiseMax(0.0).cwiseMin(64.0);
    confidence = 0.03 * std::abs(random.normal(base + 3));
    if (random.uniform(base + 4) < 0.06) confidence = random.uniform(base + 5, 0.2, 0.6);
  }
  crop = (2.0 * crop).array().round() / 2.0;
  return {{box.x1 + crop_x * crop.x(), box.y1 + crop_y * crop.y()}, confidence};
}

/// Nothing where the vehicle is missed.
std::optional<VehicleDetection> simulate_detection(const SynthWorld& world, int frame,
                                                   const ViewCamera& view,
                                                   const TruthVehicle& vehicle,
                                                   const DetectorModel& model) {
  const CounterRandom random(model.seed, 0x44455400u +
                                             1000003u * static_cast<std::uint64_t>(frame) +
                                             static_cast<std::uint64_t>(vehicle.id));
  // A detection is lost at random, and surely once it is hidden, cut off or tiny.
  const double hidden = std::max(0.0, (vehicle.occlusion - 0.35) / 0.4);
  if (vehicle.occlusion > 0.75 || vehicle.truncation > 0.6 || vehicle.box.height() < 9.0) return {};
  if (random.uniform(0) < model.miss_share + 0.4 * hidden) return {};

  VehicleDetection detection;
  detection.vehicle_class = vehicle.vehicle_class;
  const PinholeCamera& camera = view.camera();
  const Box2 clipped = view.shown(vehicle.box).box;
  const double spread = std::clamp(0.02 * clipped.height(), 0.4, 2.0);
  detection.box =
      Box2{clipped.x1 + spread * random.normal(1), clipped.y1 + spread * random.normal(2),
           clipped.x2 + spread * random.normal(3), clipped.y2 + spread * random.normal(4)}
          .clipped(camera.width, camera.height);
  detection.score = std::clamp(
      0.99 - 0.25 * vehicle.occlusion - 1.2 / clipped.height() - 0.03 * random.uniform(5), 0.3,
      1.0);
  for (int k = 0; k < kNumKeypoints; ++k) {
    const std::uint64_t base = 100 + 20 * static_cast<std::uint64_t>(k);
    detection.keypoints.push_back(
        simulate_keypoint(world, frame, view, vehicle, k, detection.box, model, random, base));
  }
  return detection;
}

/// Now and then a box where nothing is.
std::optional<VehicleDetection> simulate_false_detection(int frame, const PinholeCamera& camera,
                                                         const DetectorModel& model) {
  const CounterRandom random(model.seed, 0x46414C53u + 7919u * static_cast<std::uint64_t>(frame));
  if (random.uniform(0) >= model.false_boxes) return {};
  VehicleDetection detection;
  const double height = random.uniform(1, 0.08, 0.25) * camera.height;
  const double width = height * random.uniform(2, 0.9, 1.8);
  const double x = random.uniform(3, 0.0, camera.width - width);
  const double y = random.uniform(4, 0.35, 0.6) * camera.height;
  detection.box = Box2{x, y, x + width, y + height}.clipped(camera.width, camera.height);
  detection.score = random.uniform(5, 0.3, 0.6);
  for (int k = 0; k < kNumKeypoints; ++k) {
    const std::uint64_t base = 100 + 4 * static_cast<std::uint64_t>(k);
    detection.keypoints.push_back({{random.uniform(base, detection.box.x1, detection.box.x2),
                                    random.uniform(base + 1, detection.box.y1, detection.box.y2)},
                                   0.35 * random.uniform(base + 2)});
  }
  return detection;
}

}  // namespace

std::vector<VehicleDetection> simulate_detections(const SynthWorld& world, int frame,
                                                  const ViewCamera& view,
                                                  const std::vector<TruthVehicle>& vehicles,
                                                  const DetectorModel& model) {
  std::vector<VehicleDetection> out;
  for (const TruthVehicle& vehicle : vehicles) {
    auto detection = simulate_detection(world, frame, view, vehicle, model);
    if (detection) out.push_back(std::move(*detection));
  }
  auto wrong = simulate_false_detection(frame, view.camera(), model);
  if (wrong) out.push_back(std::move(*wrong));

  // Highest score first, as a detector hands them out; ids in that order.
  std::stable_sort(
      out.begin(), out.end(),
      [](const VehicleDetection& a, const VehicleDetection& b) { return a.score > b.score; });
  // Numbers as a detector would print them.
  const auto round_to = [](double x, double parts) { return std::round(x * parts) / parts; };
  for (std::size_t i = 0; i < out.size(); ++i) {
    VehicleDetection& d = out[i];
    d.id = static_cast<int>(i);
    d.box = {round_to(d.box.x1, 100.0), round_to(d.box.y1, 100.0), round_to(d.box.x2, 100.0),
             round_to(d.box.y2, 100.0)};
    d.score = round_to(d.score, 1000.0);
    for (KeypointObservation& keypoint : d.keypoints) {
      keypoint.pixel = {round_to(keypoint.pixel.x(), 100.0), round_to(keypoint.pixel.y(), 100.0)};
      keypoint.confidence = round_to(keypoint.confidence, 1000.0);
    }
  }
  return out;
}

std::vector<std::uint8_t> simulate_segmentation(const std::vector<std::uint8_t>& labels, int width,
                                                int height, std::uint64_t seed, int frame) {
  const CounterRandom random(seed, 0x53454700u + static_cast<std::uint64_t>(frame));
  const auto noise_seed = static_cast<std::uint32_t>(random.bits(0));
  const auto class_of = [](std::uint8_t label) {
    switch (static_cast<TruthLabel>(label)) {
      case TruthLabel::kRoad:
        return SegmentationClass::kRoad;
      case TruthLabel::kPavement:
        return SegmentationClass::kPavement;
      case TruthLabel::kCar:
        return SegmentationClass::kVehicle;
      default:
        return SegmentationClass::kOther;
    }
  };
  std::vector<std::uint8_t> out(static_cast<std::size_t>(width) * height);
  const auto displaced = [&](float u, float v, std::uint32_t s) {
    return 2.6f * gradient_noise({u / 11.0f, v / 11.0f}, s) +
           1.6f * gradient_noise({u / 4.0f, v / 4.0f}, s + 1);
  };
  for (int v = 0; v < height; ++v) {
    for (int u = 0; u < width; ++u) {
      const auto fu = static_cast<float>(u), fv = static_cast<float>(v);
      const int su = std::clamp(u + static_cast<int>(std::lround(displaced(fu, fv, noise_seed))), 0,
                                width - 1);
      const int sv = std::clamp(
          v + static_cast<int>(std::lround(displaced(fu, fv, noise_seed + 7))), 0, height - 1);
      out[static_cast<std::size_t>(v) * width + u] =
          static_cast<std::uint8_t>(class_of(labels[static_cast<std::size_t>(sv) * width + su]));
    }
  }
  // Wrong regions: blobs in the lower two thirds where road and pavement are mixed up or the road
  // is lost.
  const int blobs = 3 + static_cast<int>(random.below(1, 4));
  for (int i = 0; i < blobs; ++i) {
    const std::uint64_t base = 10 + 10 * static_cast<std::uint64_t>(i);
    const double cu = random.uniform(base, 0.0, width),
                 cv = random.uniform(base + 1, 0.4, 1.0) * height;
    const double a = random.uniform(base + 2, 0.008, 0.03) * width,
                 b = a * random.uniform(base + 3, 0.15, 0.5);
    const bool lost = random.uniform(base + 4) < 0.3;
    const int reach = static_cast<int>(std::ceil(1.5 * a));
    for (int v = std::max(0, static_cast<int>(cv) - reach);
         v < std::min(height, static_cast<int>(cv) + reach); ++v) {
      for (int u = std::max(0, static_cast<int>(cu) - reach);
           u < std::min(width, static_cast<int>(cu) + reach); ++u) {
        const double r =
            std::hypot((u - cu) / a, (v - cv) / b) +
            0.4 * gradient_noise({static_cast<float>(u) / 9.0f, static_cast<float>(v) / 9.0f},
                                 noise_seed + 20);
        if (r > 1.0) continue;
        std::uint8_t& value = out[static_cast<std::size_t>(v) * width + u];
        const auto current = static_cast<SegmentationClass>(value);
        if (current == SegmentationClass::kRoad) {
          value = static_cast<std::uint8_t>(lost ? SegmentationClass::kOther
                                                 : SegmentationClass::kPavement);
        } else if (current == SegmentationClass::kPavement) {
          value = static_cast<std::uint8_t>(lost ? SegmentationClass::kOther
                                                 : SegmentationClass::kRoad);
        }
      }
    }
  }
  return out;
}

}  // namespace camber
