#pragma once

#include "camber/pipeline/stages/assemble.h"
#include "camber/pipeline/stages/paper_ground.h"

namespace camber::stages {

/// The results of a run by the paper's method: the triangulated road points, the ego patch, the
/// patches under vehicles with the planes that the joint problem ended with, and the vehicles.
/// Links join patches within reach of equation 8.
/// @param matches, seen  of the ground; empty for a single image.
AssembledRoad assemble_paper(const LoadedFrames& frames, const Correspondences& matches,
                             const MotionEstimate& motion, const GroundPoints& seen,
                             const PaperGround& ground, const PlacedVehicles& placed,
                             VehicleMethod method);

}  // namespace camber::stages
