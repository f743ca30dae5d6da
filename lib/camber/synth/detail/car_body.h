#pragma once

#include "camber/synth/car_family.h"

namespace camber {

/// Keypoints and mesh of a car with the given proportions; see CarModel.
CarModel build_car_body(CarClass car_class, const CarProportions& proportions);

/// A closed dark box between the wheels of an axle, so that nobody sees through the arches.
/// @param wheel  the left one's centre; @param reach  half of its length, m; @param low, high  m
void add_axle_box(const Eigen::Vector3d& wheel, double reach, double low, double high,
                  TriangleMesh* mesh);

}  // namespace camber
