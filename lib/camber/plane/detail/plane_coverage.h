#pragma once

#include <Eigen/Core>

#include "camber/plane/plane_solver.h"

namespace camber::detail {

/// Refines a candidate, re-estimates its noise (unless `fixed_noise`), finds the part of the plane
/// that the points cover evenly, and refines inside it. Outside it and towards its edges points
/// count less: noise along viewing rays carries points out over an edge on one side only, and
/// beyond a crease the next plane begins. Both would tilt the fit. With fewer than 600 inliers the
/// window widens, and below 400 it is open.
/// @param again  the candidate has been refined so on a part of these points already: its window
/// and its noise are found again, the plane is left as it is
void refine_and_window(PointArrays* points, const Eigen::Vector3d& up, double least_noise,
                       bool fixed_noise, PlaneCandidate* candidate, bool again = false);

}  // namespace camber::detail
