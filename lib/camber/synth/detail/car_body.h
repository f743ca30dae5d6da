#pragma once

#include "camber/synth/car_family.h"

namespace camber {

/// Keypoints and mesh of a car with the given proportions; see CarModel.
CarModel build_car_body(CarClass car_class, const CarProportions& proportions);

}  // namespace camber
