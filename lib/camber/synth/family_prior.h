#pragma once

#include <cstdint>

#include "camber/vehicle/shape_prior.h"

namespace camber {

struct FamilyPriorOptions {
  std::uint64_t seed = 1;
  int samples = 4000;  ///< cars, and as many vans, > 1
  int num_coefficients = 20;
  /// m, each axis: how far apart two people (or networks) put the same keypoint of a car; >= 0.
  double annotation_sigma = 0.03;
  /// m, each axis, of displacements that neighbouring keypoints share: how far bodies of other
  /// makers depart from the family's lines; >= 0. Correlated as exp(-d^2 / (2 design_reach^2)) of
  /// the distance d between two keypoints.
  double design_sigma = 0.08;
  double design_reach = 0.8;  ///< m, > 0
  /// Relative spread of a car's length, width and height, each by itself, beyond the catalogues':
  /// model years, trims, loads, tyres; >= 0.
  double size_sigma = 0.06;
  /// Relative spread of the box round the same car: roof rails, mirrors, mouldings, and how boxes
  /// are drawn; >= 0.
  double box_sigma = 0.03;
  void validate() const;  ///< throws std::invalid_argument
};

/// The vehicle prior of the parametric car family: a shape "car" learnt from its hatchbacks,
/// saloons, estates and SUVs as frequent as on the road, a shape "van", and the published sizes of
/// the other classes. Same options, same prior.
VehiclePrior learn_family_prior(const FamilyPriorOptions& options);

}  // namespace camber
