#pragma once

#include "camber/synth/car_family.h"
#include "camber/synth/detail/sequence.h"

namespace camber {

/// Replaces a car's body by the polyhedron whose corners are its keypoints, after each pair of them
/// has been moved by itself: flanks in flat pieces, panes and lids flat or slightly crowned across,
/// skirts below. Wheels stay, and come out or in to be flush with their arches. The origin is put
/// where CarModel has it.
///
/// A network that has only seen bodies that are smooth between the keypoints takes their places
/// from the rest of the car; here nothing but the corner itself shows where it is.
/// @param size  standard deviation of the displacement along an axis, m
void facet_body(double size, Sequence* random, CarModel* model);

}  // namespace camber
