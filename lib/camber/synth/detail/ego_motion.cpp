#include "camber/synth/detail/ego_motion.h"

#include <Eigen/Geometry>
#include <cmath>

#include "camber/core/random.h"

namespace camber {
namespace {

constexpr double kDegree = 3.14159265358979323846 / 180.0;
constexpr std::uint64_t kStream = 0x45474F00;

/// Axes right, down, forward (along a heading) of a camera that is level on the ground below it.
Eigen::Matrix3d level_axes(const Eigen::Vector3d& up, double heading) {
  const Eigen::Vector3d ahead(std::cos(heading), std::sin(heading), 0.0);
  const Eigen::Vector3d front =
      (ahead - up.dot(ahead) / up.z() * Eigen::Vector3d::UnitZ()).normalized();
  Eigen::Matrix3d axes;
  axes.col(0) = front.cross(up);
  axes.col(1) = -up;
  axes.col(2) = front;
  return axes;
}

}  // namespace

EgoMotion plan_ego_motion(const WorldOptions& options, const RoadModel& road) {
  const CounterRandom random(options.seed, kStream);
  const SceneFeatures& features = options.features;
  const RoadLayout& layout = road.layout();
  EgoMotion motion;
  motion.speed = options.speed;
  motion.camera_ahead = features.mounting.ahead_of_axle;
  const double drawn = 0.5 * layout.half_width - random.uniform(0, -0.2, 0.2);
  const double from_axis = features.roadside.edge_distance
                               ? layout.half_width - *features.roadside.edge_distance
                               : drawn;
  if (!features.corner.enabled) {
    const double drift = random.uniform(4, -0.004, 0.004);  // m sideways a metre
    motion.path = std::make_unique<LanePath>(road, -from_axis, drift);
    return motion;
  }
  const double street_from_axis = 0.5 * layout.junction->half_width;
  auto path = std::make_unique<CornerPath>(road, features.corner, from_axis, street_from_axis);
  motion.speed = features.corner.radius * features.corner.yaw_rate;
  const double driven = motion.speed * (options.num_frames - 1) / options.frame_rate;
  motion.begin = (features.corner.phase - 0.5) * path->turn_length() - 0.5 * driven;
  motion.path = std::move(path);
  return motion;
}

SynthView view_above_road(const RoadModel& road, const Eigen::Vector2d& place, double station,
                          double heading, const CameraAttitude& attitude) {
  SynthView view;
  view.ego_plane = road.local_plane(place, station, heading, 2.0, 1.5).plane;
  const Eigen::Vector3d up = view.ego_plane.normal;
  const Eigen::Matrix3d level = level_axes(up, heading);
  const Eigen::Matrix3d mount = (Eigen::AngleAxisd(attitude.yaw, Eigen::Vector3d::UnitY()) *
                                 Eigen::AngleAxisd(attitude.pitch, Eigen::Vector3d::UnitX()) *
                                 Eigen::AngleAxisd(attitude.roll, Eigen::Vector3d::UnitZ()))
                                    .toRotationMatrix();
  const Eigen::Vector3d foot =
      view.ego_plane.foot({place.x(), place.y(), road.height_at(place, station)});
  view.world_from_camera =
      SE3(Eigen::Matrix3d(level * mount), Eigen::Vector3d(foot + attitude.height * up));
  return view;
}

std::vector<SynthView> drive_camera(const WorldOptions& options, const RoadModel& road,
                                    const EgoMotion& motion) {
  const CounterRandom random(options.seed, kStream);
  const MountingOptions& mounting = options.features.mounting;
  const double mount_pitch = mounting.pitch.value_or(random.uniform(1, -0.8, 0.8) * kDegree);
  const double mount_yaw = mounting.yaw.value_or(random.uniform(2, -0.6, 0.6) * kDegree);
  const double mount_roll = mounting.roll.value_or(random.uniform(3, -0.4, 0.4) * kDegree);
  std::vector<SynthView> views;
  for (int f = 0; f < options.num_frames; ++f) {
    const PathPose axle = motion.path->at(motion.distance(f, options.frame_rate));
    const double heading = axle.heading;
    const Eigen::Vector2d at =
        axle.place + motion.camera_ahead * Eigen::Vector2d(std::cos(heading), std::sin(heading));
    const std::uint64_t k = 100 + 8 * static_cast<std::uint64_t>(f);
    CameraAttitude attitude;
    attitude.pitch = mount_pitch + 0.10 * kDegree * random.normal(k);
    attitude.yaw = mount_yaw + 0.04 * kDegree * random.normal(k + 1);
    attitude.roll = mount_roll + 0.06 * kDegree * random.normal(k + 2);
    attitude.height = options.camera_height + 0.003 * random.normal(k + 3);
    views.push_back(view_above_road(road, at, axle.station, heading, attitude));
  }
  return views;
}

}  // namespace camber
