#pragma once

#include <vector>

#include "camber/synth/detail/ego_motion.h"
#include "camber/synth/detail/sequence.h"
#include "camber/synth/synth_world.h"

namespace camber {

/// What a car is but for where it drives.
struct CarChoice {
  int track = 1;
  CarModel model;
  bool moving = false;
  GroundKind ground = GroundKind::kRoad;
};

/// Puts a car on the ground at one pose of its origin a frame.
SynthCar make_synth_car(const RoadModel& road, const CarChoice& choice,
                        const std::vector<PathPose>& poses, Sequence* random);

/// Places cars: one that drives ahead if the options ask for it, then others, moving and parked,
/// clear of each other and of the camera at every frame. Fewer than asked for where there is no
/// room.
std::vector<SynthCar> place_cars(const WorldOptions& options, const RoadModel& road,
                                 const EgoMotion& motion);

}  // namespace camber
