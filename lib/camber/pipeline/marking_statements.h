#pragma once

#include <Eigen/Core>
#include <string>

#include "camber/motion/lane_markings.h"
#include "camber/road/ground_field.h"

namespace camber {

/// What painted markings of known size say of a ground field.
struct MarkingStatements {
  /// Empty where nothing is said; reason says why.
  GroundField::MetricStatements statements;
  std::string reason;
  int dashes = 0;         ///< strokes that take part
  int crossings = 0;      ///< pedestrian crossings that take part
  double farthest = 0.0;  ///< m, of what takes part
  /// Logarithm of the scale that the markings and the ground agree on, over the scale given.
  double scale_change = 0.0;
  /// Mean square of what the markings miss the ground by, in standard deviations, before and after.
  double misfit_before = 0.0, misfit_after = 0.0;
};

/// Joins strokes to broken lines, from the nearest on: the next stroke lies a period ahead (or a
/// whole number of them, where those between are hidden), within three standard deviations of where
/// the ground, with what the strokes before say of it, puts it. Lengths between strokes' middles,
/// of near strokes and across crossings are then statements on the field.
/// @param metres_per_unit  of the field, with the relative standard deviation scale_sigma.
/// @param inflation  factor on the field's covariance, as for GroundField::condition.
MarkingStatements marking_statements(const GroundField& field, const PinholeCamera& camera,
                                     const LaneMarkings& markings, const LaneMarkingSizes& sizes,
                                     double metres_per_unit, double scale_sigma,
                                     const Eigen::MatrixXd& shared_covariance, double inflation);

}  // namespace camber
