#include "camber/drive/drive_frames.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <utility>

#include "camber/core/median.h"

namespace camber {
namespace {

/// The camera over the road by one window: pitch is positive where the optical axis rises against
/// the road, roll where its right side is down.
struct OverRoad {
  DriveNumber height, pitch, roll;
};

OverRoad over_road(const UncertainPlane& ego, double scale_sigma) {
  const Eigen::Vector3d& n = ego.plane.normal;
  const double height = ego.plane.offset;
  const double turn = std::sqrt(std::max(ego.covariance(0, 0), ego.covariance(1, 1)));
  const double own = std::sqrt(std::max(0.0, ego.covariance(2, 2)));
  return {{height, std::hypot(own, scale_sigma * height)},
          {std::atan2(n.z(), -n.y()), turn},
          {std::atan2(-n.x(), -n.y()), turn}};
}

/// The median over all windows. Neighbouring windows' errors are alike: the spread counts for a
/// fifth of their number.
DriveNumber middle(std::vector<double> values) {
  constexpr double kAlike = 5.0;
  if (values.empty()) return {};
  const double effective = std::max(1.0, static_cast<double>(values.size()) / kAlike);
  const double median = upper_median(values);
  for (double& v : values) v = std::abs(v - median);
  return {median, kSigmaFromMad * upper_median(&values) / std::sqrt(effective)};
}

void put_mounting(const std::vector<WindowMeasurement>& windows,
                  const std::map<int, double>& scale_factors, double common, DriveDocument* out) {
  std::vector<double> height, pitch, roll;
  for (const WindowMeasurement& w : windows) {
    const auto factor = scale_factors.find(w.reference);
    if (!w.ego || factor == scale_factors.end()) continue;
    const OverRoad over = over_road(*w.ego, w.scale_sigma);
    height.push_back(factor->second * over.height.value);
    pitch.push_back(over.pitch.value);
    roll.push_back(over.roll.value);
  }
  out->height = middle(std::move(height));
  out->height.sigma = std::hypot(out->height.sigma, common * out->height.value);
  out->pitch = middle(std::move(pitch));
  out->roll = middle(std::move(roll));
}

/// The road under a camera by the plane under another one, m.
EgoRoad carried(const WindowMeasurement& window, double factor, const TrajectoryPose& from,
                const TrajectoryPose& to) {
  UncertainPlane plane = *window.ego;
  plane.plane.offset *= factor;
  plane.centroid *= factor;
  return {plane.transformed(to.world_from_camera.inverse() * from.world_from_camera),
          window.scale_sigma};
}

/// Between two roads under one camera, by linear interpolation. The covariance is the nearer's:
/// their errors are alike.
EgoRoad between(const EgoRoad& before, const EgoRoad& after, double share_after) {
  EgoRoad out = share_after < 0.5 ? before : after;
  Plane& plane = out.plane.plane;
  plane.normal =
      ((1.0 - share_after) * before.plane.plane.normal + share_after * after.plane.plane.normal)
          .normalized();
  plane.offset =
      (1.0 - share_after) * before.plane.plane.offset + share_after * after.plane.plane.offset;
  const Eigen::Vector3d along = out.plane.axis1;
  UncertainPlane::make_axes(plane.normal, along, &out.plane.axis1, &out.plane.axis2);
  out.plane.centroid = -plane.offset * plane.normal;
  return out;
}

DriveFrame frame_of(const TrajectoryPose& pose, const EgoRoads& roads, const Eigen::Vector3d& up,
                    double common) {
  DriveFrame out;
  out.id = pose.frame;
  out.world_from_camera = pose.world_from_camera;
  out.covariance = pose.covariance;
  out.status = pose.status;
  out.reason = pose.reason;
  const auto road = roads.find(pose.frame);
  if (road == roads.end()) return out;
  const UncertainPlane& ego = road->second.plane;
  const OverRoad over = over_road(ego, road->second.scale_sigma);
  out.height = {over.height.value, std::hypot(over.height.sigma, common * over.height.value)};
  out.pitch = over.pitch;
  out.roll = over.roll;
  const Eigen::Quaterniond turn = pose.world_from_camera.rotation();
  const auto slope = [&](const Eigen::Vector3d& axis) {
    return std::asin(std::clamp((turn * axis).dot(up), -1.0, 1.0));
  };
  out.grade = {slope(ego.axis1), std::sqrt(ego.covariance(1, 1) + pose.covariance(0, 0))};
  out.bank = {slope(ego.axis2), std::sqrt(ego.covariance(0, 0) + pose.covariance(2, 2))};
  return out;
}

/// Speeds by the steps to the frames beside, m/s.
void put_speeds(const Trajectory& trajectory, std::vector<DriveFrame>* frames) {
  for (std::size_t k = 0; k < frames->size(); ++k) {
    const DriveFrame& before = (*frames)[k > 0 ? k - 1 : k];
    const DriveFrame& after = (*frames)[std::min(k + 1, frames->size() - 1)];
    const double span = after.time_s - before.time_s;
    if (!(span > 0.0)) continue;
    DriveFrame& frame = (*frames)[k];
    const double way = after.s.value - before.s.value;
    frame.speed = {
        way / span,
        std::hypot(trajectory.poses[k].beside_sigma, trajectory.common_sigma * way) / span};
  }
}

}  // namespace

EgoRoads ego_roads(const std::vector<WindowMeasurement>& windows, const Trajectory& trajectory,
                   const std::map<int, double>& scale_factors) {
  constexpr std::ptrdiff_t kFarthest = 4;  // frames, from a window's reference
  EgoRoads out;
  const auto place_of = [&](const TrajectoryPose* pose) { return pose - trajectory.poses.data(); };
  struct Known {
    std::ptrdiff_t place;
    const WindowMeasurement* window;
    double factor;
  };
  std::vector<Known> known;
  for (const WindowMeasurement& w : windows) {
    const TrajectoryPose* pose = w.ego ? trajectory.find(w.reference) : nullptr;
    const auto factor = scale_factors.find(w.reference);
    if (!pose || factor == scale_factors.end()) continue;
    known.push_back({place_of(pose), &w, factor->second});
    out[w.reference] = carried(w, factor->second, *pose, *pose);
  }
  std::size_t next = 0;  // the first at or after a frame
  for (const TrajectoryPose& pose : trajectory.poses) {
    const std::ptrdiff_t place = place_of(&pose);
    while (next < known.size() && known[next].place < place) ++next;
    if (out.count(pose.frame) > 0) continue;
    const Known* before = next > 0 ? &known[next - 1] : nullptr;
    const Known* after = next < known.size() ? &known[next] : nullptr;
    if (before && place - before->place > kFarthest) before = nullptr;
    if (after && after->place - place > kFarthest) after = nullptr;
    const auto road = [&](const Known& k) {
      return carried(*k.window, k.factor, trajectory.poses[static_cast<std::size_t>(k.place)],
                     pose);
    };
    if (before && after) {
      const auto span = static_cast<double>(after->place - before->place);
      out[pose.frame] =
          between(road(*before), road(*after), static_cast<double>(place - before->place) / span);
    } else if (before || after) {
      out[pose.frame] = road(before ? *before : *after);
    }
  }
  return out;
}

Eigen::Vector3d drive_up(const Scene& scene, const Trajectory& trajectory,
                         const std::vector<WindowMeasurement>& windows, bool* by_gravity) {
  Eigen::Vector3d gravity = Eigen::Vector3d::Zero(), normals = Eigen::Vector3d::Zero();
  for (const TrajectoryPose& pose : trajectory.poses) {
    const SceneFrame* frame = scene.find_frame(pose.frame);
    if (frame && frame->up) gravity += pose.world_from_camera.rotation() * *frame->up;
  }
  for (const WindowMeasurement& w : windows) {
    const TrajectoryPose* pose = w.ego ? trajectory.find(w.reference) : nullptr;
    if (pose) normals += pose->world_from_camera.rotation() * w.ego->plane.normal;
  }
  *by_gravity = gravity.norm() > 0.5;
  if (*by_gravity) return gravity.normalized();
  return normals.norm() > 0.5 ? Eigen::Vector3d(normals.normalized()) : Eigen::Vector3d(0, -1, 0);
}

std::vector<double> frame_times(const Scene& scene, const std::vector<int>& frame_ids) {
  const double rate = scene.frame_rate.value_or(10.0);
  std::vector<double> out;
  const bool known = scene.frame_rate ||
                     std::all_of(frame_ids.begin(), frame_ids.end(),
                                 [&](int id) { return scene.find_frame(id)->time_s.has_value(); });
  if (!known) return out;
  for (const int id : frame_ids) out.push_back(time_of(*scene.find_frame(id), rate));
  return out;
}

std::vector<Eigen::Vector3d> camera_feet(const Trajectory& trajectory, const EgoRoads& roads,
                                         const DriveDocument& mounting) {
  const bool known = std::isfinite(mounting.height.value);
  const double height = known ? mounting.height.value : 0.0;
  const Eigen::Vector3d mounted =
      known ? Eigen::Vector3d(-std::tan(mounting.roll.value), -1.0, std::tan(mounting.pitch.value))
                  .normalized()
            : Eigen::Vector3d(0, -1, 0);
  std::vector<Eigen::Vector3d> out;
  for (const TrajectoryPose& pose : trajectory.poses) {
    const auto road = roads.find(pose.frame);
    out.push_back(pose.world_from_camera *
                  (-height * (road != roads.end() ? road->second.plane.plane.normal : mounted)));
  }
  return out;
}

DriveDocument drive_document(const Scene& scene, const Trajectory& trajectory,
                             const std::vector<WindowMeasurement>& windows,
                             const std::map<int, double>& scale_factors, const EgoRoads& roads,
                             const Eigen::Vector3d& up) {
  DriveDocument out;
  out.metric = trajectory.metric;
  out.length = trajectory.whole.length;
  out.length_sigma = trajectory.whole.sigma();
  out.common_sigma = trajectory.common_sigma;
  put_mounting(windows, scale_factors, trajectory.common_sigma, &out);
  for (const Trajectory::Stretch& w : trajectory.windows) {
    out.windows.push_back({w.first, w.last, w.length, w.sigma()});
  }
  const double rate = scene.frame_rate.value_or(10.0);
  double s = 0.0;
  for (std::size_t k = 0; k < trajectory.poses.size(); ++k) {
    const TrajectoryPose& pose = trajectory.poses[k];
    DriveFrame frame = frame_of(pose, roads, up, trajectory.common_sigma);
    if (k > 0) {
      s += (pose.world_from_camera.translation() -
            trajectory.poses[k - 1].world_from_camera.translation())
               .norm();
    }
    frame.s = {s, std::hypot(pose.way_sigma, trajectory.common_sigma * s)};
    frame.time_s = time_of(*scene.find_frame(pose.frame), rate);
    out.frames.push_back(std::move(frame));
  }
  put_speeds(trajectory, &out.frames);
  return out;
}

}  // namespace camber
