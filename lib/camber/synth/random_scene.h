#pragma once

#include <cstdint>

#include "camber/synth/synthesise.h"

namespace camber {

/// Options of scene number `number`, drawn from one distribution over everything that can be made:
///
/// - drive: 20 % turn at a corner, left or right (radius 6 to 15 m, 20 to 40 degrees a second, 2 to
///   8 m/s; stem 40, crossing 25, side street 20, bend 15 %); 25 % in a bend (radius 40 to 150 m,
///   log-uniform); the others along the road's own shape
/// - road: level 20 %, else evenly the steep kinds (at corners and in bends without the banked one
///   and the steep hill); half width 3.3 to 3.9 m, 12 % 2.2 to 2.8, 10 % 3.9 to 5.5
/// - roadside: kerbs and pavements on one or both sides 50 % (corners 80 %), 4 to 20 cm high;
///   elsewhere verges, half of them 5 to 19 cm above the road, the others within 3 cm; the right
///   edge 0.9 to 2 m from the camera in 60 %
/// - camera: field of view 40 to 110 degrees, 640 to 1280 columns, rows 0.30 to 0.62 of them,
///   0.9 to 3 m high, pitch -6 to 2, yaw -2 to 2, roll -4 to 4 degrees, 0.8 to 2.2 m before the
///   rear axle; drawn again where the lowest row meets level road beyond 10 m
/// - motion: 0.1 to 1.2 camera heights a frame (log-uniform), 0.8 to 22 m/s, in bends at most
///   4 m/s^2 across; 10 frames a second, five frames
/// - traffic: up to 7 cars; 25 % with a car 5 to 18 m ahead at constant distance
/// - surface: varied asphalt 80 % (contrast 0.3 to 1.15, log-uniform), self-similar 12 % and
///   repeating 8 % (0.5 to 1.3); 20 % wet (0.3 to 1)
/// - markings: none 35 % (narrow roads always), centre line 20 %, all 45 %
/// - weather: cloudiness 0 to 1 (wet: from 0.5), sun 25 to 62 degrees high, haze 300 to 3,000 m;
///   lights on in 70 % of the wet ones
/// - sensor: noise 0.6 to 3 grey levels (log-uniform), blur 0.4 to 0.9 px, exposure changes of 1 to
///   6 % (30 %: 6 to 20 %), vignetting 0 to 0.35, two samples a pixel and direction
///
/// Every number is a scene of its own; even and odd ones are alike. `seed` gives another series.
/// Same number and seed, same scene.
SynthOptions random_scene_options(std::uint64_t number, std::uint64_t seed = 0);

}  // namespace camber
