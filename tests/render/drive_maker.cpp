#include "drive_maker.h"

#include <cmath>

#include "camber/road/strip_surface.h"

namespace camber::test {
namespace {

constexpr double kStep = 0.7, kRadius = 90.0, kGrade = 0.05, kHeight = 1.5;  // m

/// The foot of the camera at a length of the line, strip frame (x ahead at the start, y left).
Eigen::Vector3d foot_at(double s) {
  const double a = s / kRadius;
  return {kRadius * std::sin(a), kRadius * (1.0 - std::cos(a)), kGrade * s};
}

/// Along the road there, up off it.
Eigen::Matrix3d axes_at(double s) {
  const double a = s / kRadius;
  const Eigen::Vector3d ahead = Eigen::Vector3d(std::cos(a), std::sin(a), kGrade).normalized();
  const Eigen::Vector3d left = Eigen::Vector3d(-std::sin(a), std::cos(a), 0.0);
  Eigen::Matrix3d out;
  out << ahead, left, ahead.cross(left);
  return out;
}

/// A camera that looks along the road: x right, y down, z ahead.
SE3 strip_from_camera(double s) {
  const Eigen::Matrix3d axes = axes_at(s);
  Eigen::Matrix3d turn;
  turn << -axes.col(1), -axes.col(2), axes.col(0);
  return SE3(turn, foot_at(s) + kHeight * axes.col(2));
}

VehicleEstimate car_at(const SE3& camera_from_strip, double s, double lateral, int id, int track) {
  VehicleEstimate car;
  car.id = id;
  car.track = track;
  car.vehicle_class = "car";
  car.status = Status::kOk;
  const Eigen::Matrix3d axes = axes_at(s);
  Eigen::Matrix3d turn;  // x to the front, y up, z to the right
  turn << axes.col(0), axes.col(2), -axes.col(1);
  car.pose.camera_from_vehicle = camera_from_strip * SE3(turn, foot_at(s) + lateral * axes.col(1));
  car.pose.dimensions = {4.4, 1.5, 1.8};
  return car;
}

}  // namespace

PicturedDrive::PicturedDrive() {
  camera = {320, 120, 190.0, 190.0, 159.5, 50.0};
  const SE3 strip_from_world = strip_from_camera(0.0);
  std::vector<Eigen::Vector3d> feet;
  DriveTrackLine parked{2, "car", true, {4.4, 1.5, 1.8}, {}};
  DriveTrackLine moving{5, "car", false, {4.4, 1.5, 1.8}, {}};
  for (int k = 0; k < 60; ++k) {
    const double s = kStep * k;
    feet.push_back(foot_at(s));
    DriveFrame frame;
    frame.id = 100 + k;
    frame.time_s = 0.1 * k;
    frame.world_from_camera = strip_from_world.inverse() * strip_from_camera(s);
    frame.covariance = 1e-6 * k * Eigen::Matrix<double, 6, 6>::Identity();
    frame.s = {s, 0.01 * s};
    frame.height = {kHeight, 0.01};
    frame.speed = {7.0, 0.1};
    frame.grade = {std::atan(kGrade), 0.002};
    frame.bank = {0.0, 0.002};
    frame.status = k == 30 ? Status::kWeak : Status::kOk;
    if (k == 30) frame.reason = "the picture of frame 129";
    VehicleFrame seen;
    seen.id = frame.id;
    const SE3 camera_from_strip = strip_from_camera(s).inverse();
    if (s < 20.0) seen.vehicles.push_back(car_at(camera_from_strip, 30.0, -4.0, 7, 2));
    seen.vehicles.push_back(car_at(camera_from_strip, s + 15.0, 0.2, 1, 5));
    for (const VehicleEstimate& car : seen.vehicles) {
      DriveTrackLine& track = car.track == 2 ? parked : moving;
      track.places.push_back(
          {frame.id, *frame.world_from_camera * car.pose.camera_from_vehicle.translation()});
    }
    vehicles.frames.push_back(std::move(seen));
    drive.frames.push_back(std::move(frame));
  }
  tracks = {parked, moving};
  vehicles.method = "joint";
  drive.length = drive.frames.back().s.value;
  drive.length_sigma = 0.5;
  drive.common_sigma = 0.01;
  drive.height = {kHeight, 0.01};
  drive.pitch = drive.roll = {0.0, 0.001};
  drive.windows = {{100, 150, 35.0, 0.4}, {110, 159, 34.3, 0.4}};
  strip.strip_from_world = strip_from_world;
  strip.line = DrivenLine(feet);
  for (double s = 0.25; s < strip.line.length() + 20.0; s += 0.5) {
    for (double lateral = -4.75; lateral < 5.0; lateral += 0.5) {
      StripCell cell;
      cell.s = s;
      cell.lateral = lateral;
      cell.point = foot_at(s) + lateral * axes_at(s).col(1);
      cell.sigma = 0.02;
      cell.label = 1;
      cell.color = {120, 120, 118};
      strip.cells.push_back(cell);
    }
  }
  StripPatches where;
  surface = strip_surface(strip, {}, &where);
  stations = where.stations;
  // The surface of a drive is in its world.
  const SE3 world_from_strip = strip_from_world.inverse();
  surface.frame = "camera";
  surface.up = world_from_strip.rotation() * surface.up;
  for (PlanePatch& patch : surface.patches) {
    patch.plane = patch.plane.transformed(world_from_strip);
    for (Eigen::Vector3d& x : patch.boundary) x = world_from_strip * x;
  }
  for (Eigen::Vector3d& x : surface.driven_line) x = world_from_strip * x;
}

DriveContent PicturedDrive::content() const {
  DriveContent out;
  out.drive = &drive;
  out.strip = &strip;
  out.surface = &surface;
  out.vehicles = &vehicles;
  out.stations = stations;
  out.tracks = tracks;
  out.camera = camera;
  out.title = "made drive";
  return out;
}

}  // namespace camber::test
