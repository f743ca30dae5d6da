#pragma once

#include <Eigen/Core>
#include <string>

#include "camber/motion/road_borders.h"
#include "camber/road/ground_field.h"

namespace camber {

/// What the constant width of the road says of a ground field.
struct WidthStatements {
  /// Empty where nothing is said; reason says why.
  GroundField::MetricStatements statements;
  std::string reason;
  int places = 0;         ///< along the road, at which its width takes part
  int refused = 0;        ///< places whose width is another
  double width = 0.0;     ///< m, where it is seen nearest
  double farthest = 0.0;  ///< m, of what takes part
  /// Mean square of the changes of width, in standard deviations, before and after.
  double misfit_before = 0.0, misfit_after = 0.0;
};

/// Widths across the road at up to two dozen distances, and that each differs little from the next
/// nearer one: a change of the logarithm of the width is a random walk of 1 % over 10 m. Places of
/// like width, within three standard deviations, make chains; the longest one speaks, so that
/// mouths of side streets, bays and a border taken for another do not act.
/// @param metres_per_unit  of the field, with the relative standard deviation scale_sigma.
/// @param inflation  factor on the field's covariance, as for GroundField::condition.
WidthStatements width_statements(const GroundField& field, const PinholeCamera& camera,
                                 const RoadBorders& borders, double metres_per_unit,
                                 double scale_sigma, const Eigen::MatrixXd& shared_covariance,
                                 double inflation);

}  // namespace camber
