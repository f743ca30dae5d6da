#pragma once

#include <vector>

#include "camber/synth/detail/ego_motion.h"
#include "camber/synth/synth_world.h"

namespace camber {

/// Places cars: one that drives ahead if the options ask for it, then others, moving and parked,
/// clear of each other and of the camera at every frame. Fewer than asked for where there is no
/// room.
std::vector<SynthCar> place_cars(const WorldOptions& options, const RoadModel& road,
                                 const EgoMotion& motion);

}  // namespace camber
