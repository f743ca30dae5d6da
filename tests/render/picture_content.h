#pragma once

#include <Eigen/Core>
#include <array>
#include <cmath>

#include "camber/render/pictures.h"

namespace camber::test {

/// Keypoints of a plain saloon in its own frame: x front, y up, z right, wheels on y = 0, m.
inline std::array<Eigen::Vector3d, kNumKeypoints> plain_car() {
  // x, y of the left side's rows 0 to 17, then half the width.
  constexpr double kSide[18][3] = {{-1.3, 0.32, 0.80}, {1.3, 0.32, 0.80},  {1.70, 0.30, 0.85},
                                   {1.50, 0.62, 0.85}, {1.10, 0.62, 0.85}, {0.90, 0.25, 0.85},
                                   {-0.9, 0.25, 0.85}, {-1.1, 0.62, 0.85}, {-1.5, 0.62, 0.85},
                                   {-1.7, 0.30, 0.85}, {-2.1, 0.30, 0.80}, {-2.1, 0.95, 0.80},
                                   {-1.5, 1.00, 0.75}, {-0.9, 1.42, 0.60}, {0.20, 1.42, 0.60},
                                   {0.90, 0.95, 0.75}, {2.00, 0.75, 0.75}, {2.10, 0.30, 0.80}};
  std::array<Eigen::Vector3d, kNumKeypoints> out;
  for (int i = 0; i < 18; ++i) {
    out[i] = {kSide[i][0], kSide[i][1], -kSide[i][2]};
    out[i + 18] = {kSide[i][0], kSide[i][1], kSide[i][2]};
  }
  return out;
}

/// A vehicle of 4.4 x 1.8 x 1.5 m with its bottom centre at `bottom` in a level camera.
inline VehicleEstimate make_vehicle(int id, const Eigen::Vector3d& bottom, double yaw) {
  VehicleEstimate v;
  v.id = id;
  v.vehicle_class = "car";
  v.status = Status::kOk;
  v.pose.camera_from_vehicle = SE3(rotation_from_rotation_y(yaw), bottom);
  v.pose.dimensions = {4.4, 1.8, 1.5};
  const auto model = plain_car();
  for (int i = 0; i < kNumKeypoints; ++i) v.keypoints[i] = v.pose.camera_from_vehicle * model[i];
  v.plane = Plane::through(bottom, {0.0, -1.0, 0.0});
  v.covariance.topLeftCorner<3, 3>() = Eigen::Vector3d(0.04, 0.01, 0.25).asDiagonal();
  return v;
}

/// Everything a picture can show: a road that climbs by 8 % from a level camera 1.65 m above it.
struct PictureScene {
  PinholeCamera camera{1242, 375, 721.5, 721.5, 609.6, 172.9};
  RoadCloud cloud;
  RoadSurface surface;
  VehicleDocument vehicles;
  RunDocument run;
  SceneTruth truth;

  static double road_y(double z) { return 1.65 - 0.08 * z; }

  PictureScene() {
    cloud.frame = CloudFrame::kCamera;
    for (int row = 0; row < 120; ++row) {
      for (int column = 0; column < 40; ++column) {
        const double x = -5.0 + 0.25 * column, z = 4.0 + 0.3 * row;
        cloud.points.emplace_back(static_cast<float>(x), static_cast<float>(road_y(z)),
                                  static_cast<float>(z));
      }
    }
    PlanePatch ego;
    ego.id = 0;
    ego.status = Status::kOk;
    ego.plane.plane = {{0.0, -1.0, 0.0}, 1.65};
    ego.boundary = {{-3, 1.4, 3}, {3, 1.4, 3}, {3, 0.85, 10}, {-3, 0.85, 10}};
    surface.patches.push_back(ego);
    surface.ego_patch = 0;
    vehicles.method = "joint";
    VehicleFrame frame;
    frame.id = 7;
    frame.vehicles = {make_vehicle(1, {-2.0, road_y(14.0), 14.0}, -M_PI / 2),
                      make_vehicle(2, {2.0, road_y(25.0), 25.0}, 0.3)};
    vehicles.frames.push_back(frame);
    for (int i = 0; i < 3; ++i) {
      run.cameras.push_back({6 + i, SE3(Eigen::Quaterniond::Identity(), {0, 0, i - 1.0})});
    }
    TruthFrame true_frame;
    true_frame.id = 7;
    for (const VehicleEstimate& vehicle : frame.vehicles) {
      TruthVehicle t;
      t.id = vehicle.id;
      t.pose = vehicle.pose;
      t.pose.camera_from_vehicle.set_translation(vehicle.pose.bottom_center() +
                                                 Eigen::Vector3d(0.5, 0.0, 1.0));
      true_frame.vehicles.push_back(t);
    }
    truth.frames.push_back(true_frame);
  }

  PictureContent content() const {
    PictureContent c;
    c.cloud = &cloud;
    c.surface = &surface;
    c.vehicles = &vehicles;
    c.run = &run;
    c.camera = &camera;
    c.truth = &truth;
    c.frame = 7;
    c.title = "a road that climbs";
    return c;
  }
};

}  // namespace camber::test
