#pragma once

// Which way round a vehicle stands: starts of every heading, mirrored names, and the agreement of
// the views of one vehicle.

#include <limits>
#include <vector>

#include "camber/vehicle/detail/vehicle_posterior.h"

namespace camber::internal {

/// A state with its minus log posterior.
struct Hypothesis {
  VehicleState state;
  double cost = std::numeric_limits<double>::infinity();
};

/// The rotation of a vehicle on a plane, its front turned by `yaw` about the normal.
Eigen::Matrix3d rotation_at(const Plane& plane, double yaw);

/// Where a vehicle of this height may be: at the distance that its height in the image implies, and
/// on the plane below its box.
std::vector<Eigen::Vector3d> position_guesses(const PinholeCamera& camera, const Plane& plane,
                                              double height, const Box2& box);

/// The best headings with the mean vehicle (a posterior of one view without coefficients), best
/// first.
std::vector<Hypothesis> coarse_starts(VehiclePosterior& coarse, const Box2& box, int num_yaws);

/// The best start of each heading, at most three, refined with all coefficients; best first.
std::vector<Hypothesis> with_coefficients(VehiclePosterior& posterior,
                                          const std::vector<Hypothesis>& starts);

/// Every heading of a half turn by the box alone, the better one of two positions each.
std::vector<Hypothesis> box_hypotheses(VehiclePosterior& posterior, const Box2& box, int num_yaws);

VehicleDetection with_sides_swapped(const VehicleDetection& detection);

/// One view of a vehicle refined with the heading of its own fit and with the opposite one.
struct HeadingPair {
  Hypothesis own, turned;
};
HeadingPair refine_both_headings(VehiclePosterior& posterior, const VehicleState& own);

}  // namespace camber::internal
