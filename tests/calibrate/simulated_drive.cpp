#include "calibrate/simulated_drive.h"

#include <algorithm>
#include <cmath>

#include "camber/core/random.h"

namespace camber::test {
namespace {

using Eigen::Vector3d;

/// Camera from world: x right, y down, z forward; the world is the level road at the first frame's
/// foot.
std::vector<SE3> poses_of(const SimulatedDriveOptions& o) {
  const CounterRandom random(o.seed, 1);
  std::vector<SE3> out;
  Vector3d place(0.0, -o.height, 0.0);
  double heading = 0.0;  // to the right
  for (int k = 0; k < o.key_frames; ++k) {
    const auto i = static_cast<std::uint64_t>(k);
    const double pitch = o.pitch + o.shake * random.normal(2 * i);
    const double roll = o.roll + o.shake * random.normal(2 * i + 1);
    // Columns of world_from_camera are the camera's axes. Rotations about y (down) turn to the
    // right, about x (right) up.
    const Eigen::Quaterniond world_from_camera =
        rotation_from_vector(Vector3d(0, heading + o.yaw, 0)) *
        rotation_from_vector(Vector3d(pitch, 0, 0)) * rotation_from_vector(Vector3d(0, 0, roll));
    out.push_back(SE3(world_from_camera, place).inverse());
    const double half = heading + 0.5 * o.turn;
    place += o.step * Vector3d(std::sin(half), 0.0, std::cos(half));
    heading += o.turn;
  }
  return out;
}

}  // namespace

SimulatedDrive simulate_drive(const SimulatedDriveOptions& o) {
  SimulatedDrive out;
  out.camera_from_world = poses_of(o);
  const CounterRandom random(o.seed, 2), noise(o.seed, 3);
  std::uint64_t draw = 0, noisy = 0;
  for (int p = 0; p < o.points; ++p) {
    // About one of the cameras: on the road, or on what stands beside it.
    const auto about = random.below(draw++, out.camera_from_world.size());
    const SE3 world_from_camera = out.camera_from_world[about].inverse();
    const bool road = random.uniform(draw++) < 0.3;
    const double ahead = random.uniform(draw++, 4.0, road ? 25.0 : 60.0);
    const double side = random.uniform(draw++) < 0.5 ? -1.0 : 1.0;
    const double aside = side * random.uniform(draw++, road ? 0.0 : 4.0, road ? 6.0 : 25.0);
    Vector3d forward = world_from_camera.rotation() * Vector3d::UnitZ();
    forward.y() = 0.0;
    forward.normalize();
    const Vector3d right(forward.z(), 0.0, -forward.x());
    Vector3d point = world_from_camera.translation() + ahead * forward + aside * right;
    point.y() = road ? 0.0 : -random.uniform(draw++, 0.0, 8.0);
    FeatureTrack track;
    for (std::size_t k = 0; k < out.camera_from_world.size(); ++k) {
      const Vector3d at = out.camera_from_world[k] * point;
      const auto pixel = at.z() > 2.0 ? o.lens.pixel(at) : std::nullopt;
      const bool inside = pixel && pixel->x() >= 0 && pixel->y() >= 0 &&
                          pixel->x() <= o.lens.width - 1 && pixel->y() <= o.lens.height - 1;
      if (!inside || at.norm() > 70.0) {
        if (track.pixels.empty()) continue;
        break;
      }
      if (track.pixels.empty()) track.first = k;
      track.pixels.push_back(*pixel + o.pixel_sigma * Eigen::Vector2d(noise.normal(2 * noisy),
                                                                      noise.normal(2 * noisy + 1)));
      ++noisy;
    }
    if (track.pixels.size() < 2) continue;
    out.tracks.push_back(std::move(track));
    out.points.push_back(point);
  }
  return out;
}

std::vector<CalibrationWindow> true_windows(const SimulatedDrive& drive, std::size_t count) {
  std::vector<CalibrationWindow> out;
  for (std::size_t first = 0; first + count <= drive.camera_from_world.size(); first += count - 1) {
    CalibrationWindow window;
    window.first = first;
    window.reference = count / 2;
    const SE3 world_from_reference = drive.camera_from_world[first + window.reference].inverse();
    double longest = 0.0;
    for (std::size_t k = 0; k < count; ++k) {
      window.frame_from_reference.push_back(drive.camera_from_world[first + k] *
                                            world_from_reference);
      longest = std::max(longest, window.frame_from_reference.back().translation().norm());
    }
    for (SE3& pose : window.frame_from_reference) {
      pose.set_translation(pose.translation() / longest);
    }
    for (std::size_t t = 0; t < drive.tracks.size(); ++t) {
      const FeatureTrack& track = drive.tracks[t];
      WindowPoint point;
      for (std::size_t k = 0; k < count; ++k) {
        const std::size_t key = first + k;
        if (key < track.first || key >= track.first + track.pixels.size()) continue;
        point.seen.push_back({static_cast<int>(k), track.pixels[key - track.first]});
      }
      if (point.seen.size() < 3) continue;
      const Vector3d at = world_from_reference.inverse() * drive.points[t] / longest;
      point.direction = at.normalized();
      point.inverse_distance = 1.0 / at.norm();
      window.points.push_back(std::move(point));
    }
    out.push_back(std::move(window));
  }
  return out;
}

}  // namespace camber::test
