#pragma once

#include <Eigen/Core>
#include <cstdint>

#include "camber/geometry/se3.h"
#include "camber/synth/car_family.h"
#include "camber/synth/detail/sequence.h"
#include "camber/synth/road_model.h"
#include "camber/synth/synth_mesh.h"

namespace camber {

/// A frequent colour of cars, linear reflectance.
Eigen::Vector3f draw_car_paint(Sequence* random);

/// A car's mesh as shading wants it, vehicle frame: one object a CarMaterial, corners smoothed over
/// edges of less than 35 degrees, texture coordinates in metres seen from the side, front or top.
SynthMesh make_car_mesh(const CarModel& model, const Eigen::Vector3f& paint, std::uint32_t seed);

/// Stands a car with its four wheels on the ground: the plane of the wheels' feet is fitted to the
/// heights of the surface below them. @return world_from_vehicle
/// @param place, heading of the vehicle's origin in plan (m, rad); station a guess of the place's
SE3 seat_car(const RoadModel& road, const CarModel& model, const Eigen::Vector2d& place,
             double station, double heading);

}  // namespace camber
