#include "camber/vehicle/paper/start_on_plane.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "camber/vehicle/detail/keypoint_visibility.h"
#include "camber/vehicle/detail/vehicle_answer.h"
#include "camber/vehicle/shape_prior.h"

namespace camber::paper {
namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr std::size_t kLeastKeypoints = 6;

/// Pose of an upright vehicle on a plane: in-plane axes, place and yaw about the normal.
struct OnPlane {
  Eigen::Vector3d ahead, right, up, foot;
  double yaw = 0.0;

  OnPlane(const Plane& plane, const Eigen::Vector3d& at) : up(plane.normal), foot(plane.foot(at)) {
    UncertainPlane::make_axes(up, Eigen::Vector3d(0.0, 0.0, 1.0), &ahead, &right);
    right = ahead.cross(up);
  }
  Eigen::Matrix3d rotation() const {
    Eigen::Matrix3d out;
    out.col(0) = std::cos(yaw) * ahead + std::sin(yaw) * right;
    out.col(1) = up;
    out.col(2) = out.col(0).cross(up);
    return out;
  }
};

/// Where the vehicle is by its box: on the plane below the box's centre, which is half its height
/// above the plane. Where that place is not within a factor of two of the distance that its height
/// in the image implies (a plane that is seen edge-on), at that distance.
Eigen::Vector3d place_by_box(const PinholeCamera& camera, const Plane& plane, double height,
                             const Box2& box) {
  constexpr double kNearest = 2.0, kFarthest = 200.0, kFactor = 2.0;  // m, m
  const double by_size =
      std::clamp(camera.fy * height / std::max(box.height(), 1.0), kNearest, kFarthest);
  const Eigen::Vector3d ray = camera.ray(box.center());
  Plane raised = plane;
  raised.offset -= 0.5 * height;
  const auto hit = raised.intersect_ray(ray);
  const bool plausible = hit && hit->z() > by_size / kFactor && hit->z() < by_size * kFactor;
  return (plausible ? *hit : Eigen::Vector3d(by_size * ray)) - 0.5 * height * plane.normal;
}

std::vector<WeighedKeypoint> usable_keypoints(const VehicleDetection& detection,
                                              const StartOptions& options) {
  const Weights& w = options.weights;
  double highest = 0.0;
  bool confident = !detection.keypoints.empty();
  for (const KeypointObservation& k : detection.keypoints) {
    confident &= std::isfinite(k.confidence);
    highest = std::max(highest, std::isfinite(k.confidence) ? k.confidence : 0.0);
  }
  confident &= highest > 0.0;
  std::vector<WeighedKeypoint> out;
  for (int i = 0; i < static_cast<int>(detection.keypoints.size()); ++i) {
    const KeypointObservation& k = detection.keypoints[static_cast<std::size_t>(i)];
    if (!k.pixel.allFinite() || !internal::in_keypoint_set(options.keypoint_set, i)) continue;
    WeighedKeypoint keypoint;
    keypoint.index = i;
    keypoint.pixel = k.pixel;
    keypoint.seen = !confident || k.confidence >= w.seen_confidence * highest;
    out.push_back(keypoint);
  }
  return out;
}

/// @param depth  of the vehicle, m.
void weigh(const Weights& w, const PinholeCamera& camera, const Box2& box, double depth,
           std::vector<WeighedKeypoint>* keypoints) {
  constexpr double kCells = 64.0, kLeastCell = 0.2;  // a side of the box; px
  const Eigen::Vector2d cell(std::max(box.width() / kCells, kLeastCell),
                             std::max(box.height() / kCells, kLeastCell));
  for (WeighedKeypoint& k : *keypoints) {
    const double cells = k.seen ? w.keypoint_seen : w.keypoint_hidden;
    k.sigma_px = {std::hypot(cells * cell.x(), w.keypoint_place * camera.fx / depth),
                  std::hypot(cells * cell.y(), w.keypoint_place * camera.fy / depth)};
  }
}

/// Adjusts place and yaw on the plane to the keypoints: reweighted Gauss-Newton with Huber's loss.
/// @return cost; infinite behind the camera.
double adjust_on_plane(const PinholeCamera& camera, const KeypointMatrix& shape,
                       const std::vector<WeighedKeypoint>& keypoints, double huber, int iterations,
                       OnPlane* pose) {
  double cost = 0.0;
  for (int iteration = 0;; ++iteration) {
    const Eigen::Matrix3d rotation = pose->rotation();
    Eigen::Matrix3d hessian = 1e-9 * Eigen::Matrix3d::Identity();
    Eigen::Vector3d gradient = Eigen::Vector3d::Zero();
    cost = 0.0;
    for (const WeighedKeypoint& k : keypoints) {
      const Eigen::Vector3d arm = rotation * shape.col(k.index), x = arm + pose->foot;
      if (!(x.z() > 0.5)) return std::numeric_limits<double>::infinity();
      const Eigen::Vector2d r(
          (camera.fx * x.x() / x.z() + camera.cx - k.pixel.x()) / k.sigma_px.x(),
          (camera.fy * x.y() / x.z() + camera.cy - k.pixel.y()) / k.sigma_px.y());
      Eigen::Matrix<double, 2, 3> by_x;
      by_x << camera.fx / x.z(), 0.0, -camera.fx * x.x() / (x.z() * x.z()), 0.0, camera.fy / x.z(),
          -camera.fy * x.y() / (x.z() * x.z());
      by_x.row(0) /= k.sigma_px.x();
      by_x.row(1) /= k.sigma_px.y();
      Eigen::Matrix3d moves;
      moves << pose->ahead, pose->right, arm.cross(pose->up);  // yaw turns the front to the right
      const Eigen::Matrix<double, 2, 3> j = by_x * moves;
      const double norm = r.norm();
      const double weight = norm > huber ? huber / norm : 1.0;
      cost += norm > huber ? huber * (norm - 0.5 * huber) : 0.5 * norm * norm;
      hessian += weight * j.transpose() * j;
      gradient += weight * j.transpose() * r;
    }
    if (iteration == iterations) return cost;
    Eigen::Vector3d step = -hessian.ldlt().solve(gradient);
    const double reach = 0.3 * pose->foot.norm();
    step *= std::min({1.0, 0.3 / std::max(std::abs(step[2]), 1e-12),
                      reach / std::max(step.head<2>().norm(), 1e-12)});
    if (!step.allFinite()) return std::numeric_limits<double>::infinity();
    pose->foot += step[0] * pose->ahead + step[1] * pose->right;
    pose->yaw += step[2];
  }
}

/// The yaw under which the keypoints agree best with the mean vehicle on its plane.
double best_yaw(const PinholeCamera& camera, const KeypointMatrix& shape, const OnPlane& by_box,
                const std::vector<WeighedKeypoint>& keypoints, const StartOptions& options) {
  constexpr int kCoarse = 4, kFine = 12;  // iterations
  OnPlane best = by_box;
  double least = std::numeric_limits<double>::infinity();
  for (int i = 0; i < options.num_headings; ++i) {
    OnPlane pose = by_box;
    pose.yaw = 2.0 * kPi * i / options.num_headings;
    const double cost =
        adjust_on_plane(camera, shape, keypoints, options.weights.huber, kCoarse, &pose);
    if (cost < least) {
      least = cost;
      best = pose;
    }
  }
  adjust_on_plane(camera, shape, keypoints, options.weights.huber, kFine, &best);
  return best.yaw;
}

VehicleStart start_on_plane(const PinholeCamera& camera, const VehicleDetection& detection,
                            const SupportPlane& support, const StartOptions& options,
                            const VehiclePrior& prior) {
  VehicleStart out;
  VehicleEstimate& vehicle = out.vehicle;
  vehicle.id = detection.id;
  vehicle.vehicle_class = detection.vehicle_class;
  vehicle.track = detection.track;
  vehicle.box = detection.box;
  vehicle.plane = support.plane.plane;
  vehicle.plane_source = support.source;
  if (!(detection.box.area() > 0.0) || !std::isfinite(detection.box.area())) {
    vehicle.status = Status::kFailed;
    vehicle.reason = "the detection box has no area";
    return out;
  }
  const SizePrior size = prior.size(detection.vehicle_class);
  const Dimensions mean{size.mean[0], size.mean[1], size.mean[2]};
  OnPlane pose(support.plane.plane,
               place_by_box(camera, support.plane.plane, mean.height, detection.box));
  if (prior.has_shape(detection.vehicle_class)) {
    out.keypoints = usable_keypoints(detection, options);
  }
  if (out.keypoints.size() < kLeastKeypoints) {
    out.keypoints.clear();
    vehicle.status = Status::kWeak;
    vehicle.reason = "placed by its box, heading unknown";
  } else {
    const KeypointMatrix shape = prior.shape(detection.vehicle_class).keypoints(mean);
    weigh(options.weights, camera, detection.box, pose.foot.z(), &out.keypoints);
    pose.yaw = best_yaw(camera, shape, pose, out.keypoints, options);
    const Eigen::Vector3d eye = pose.rotation().transpose() * -pose.foot;
    for (WeighedKeypoint& k : out.keypoints) {
      k.seen &= internal::shown_to(eye, k.index, shape.col(k.index));
    }
    weigh(options.weights, camera, detection.box, pose.foot.z(), &out.keypoints);
    vehicle.status = Status::kOk;
  }
  internal::Form form;
  form.size << mean.length, mean.width, mean.height;
  internal::write_pose_and_form(prior, {pose.rotation(), pose.foot}, form, &vehicle);
  return out;
}

}  // namespace

void StartOptions::validate() const {
  weights.validate();
  if (num_headings < 4 || num_headings > 360) {
    throw std::invalid_argument(fmt::format("num_headings: {}, must be in [4, 360]", num_headings));
  }
}

std::vector<VehicleStart> starts_on_planes(const PinholeCamera& camera,
                                           const std::vector<VehicleDetection>& detections,
                                           const std::vector<SupportPlane>& supports,
                                           const StartOptions& options) {
  options.validate();
  camera.validate();
  if (detections.size() != supports.size()) {
    throw std::invalid_argument(
        fmt::format("supports: {}, detections: {}", supports.size(), detections.size()));
  }
  const VehiclePrior& prior = options.prior ? *options.prior : shipped_vehicle_prior();
  std::vector<VehicleStart> out;
  for (std::size_t i = 0; i < detections.size(); ++i) {
    out.push_back(start_on_plane(camera, detections[i], supports[i], options, prior));
  }
  return out;
}

}  // namespace camber::paper
