#pragma once

#include <optional>
#include <string>
#include <vector>

#include "camber/scale/scale_evidence.h"

namespace camber {

/// A road that was found, or proposed and not found, with its odds.
struct ScaleAlternative {
  double weight = 1.0;     ///< relative to the other alternatives, >= 0
  double log_scale = 0.0;  ///< of what the sources measure about it, over the road that was found
  /// False: what was found is no road, and the sources that hang on it know nothing.
  bool is_road = true;
};

/// The road that was found; that it is none; and, where roads from other starts are as well
/// supported, one that far to each side.
/// @param other_layer   probability that what was found is no road, in [0, 1].
/// @param alternative_spread  of the logarithm of the scale, >= 0; 0: there are no others.
std::vector<ScaleAlternative> scale_alternatives(double other_layer, double alternative_spread);

/// Parameters of the belief, beside those of each source (evidence_of).
struct ScaleBeliefNoise {
  /// Of the logarithm of the scale: beyond it is not; what knows nothing is uniform up to there.
  double reach = 2.302585092994046;
  double step = 0.002;  ///< of the grid over it
  /// Prior of the focal length: that it is not the given one, and the standard deviation of its
  /// logarithm then (assumed).
  double wrong_focal_length = 0.02, focal_length_spread = 0.5;
  double vehicles_by_focal_length = 0.5;  ///< what sizes' scales change by with the focal length's
  // Standard deviations of errors that sources share, of the logarithm of the scale.
  double height = 0.01;           ///< of the camera's height, beside what each source states of it
  double road_shape = 0.01;       ///< of the road between the camera and what is seen of it
  double size_population = 0.03;  ///< of all cars of a street off the size prior
};

/// What is to be thought of a scale: the density of the logarithm of the true one over the
/// result's.
struct ScaleBelief {
  double first = 0.0, step = 1.0;  ///< of the grid
  std::vector<double> density;     ///< per unit of the logarithm, at the grid's points; sums to 1
  double mode = 0.0;
  /// Half of the interval that holds 68.3 %, or a quarter of that which holds 95.4 %, whichever is
  /// more.
  double sigma = 0.0;
  double second_mode = 0.0;  ///< beyond the valley next to the mode; the mode where there is none
  double second_mass = 0.0;  ///< of all that is beyond the valleys, in [0, 1]
  /// What is wrong if the second mode is right: the cause of the source that it makes the least
  /// likely; nothing without a second mode.
  std::optional<EvidenceCause> cause;

  /// Natural logarithm of the density there, linear between the grid's points.
  double log_density(double log_scale) const;
};

/// The product of the sources, each a mixture of Student's distribution and of a uniform one, over
/// the alternatives, the focal length and the errors that sources have in common:
/// sum over k of w_k times the integral over f and c of p(f) p(c) prod_i p_ik(l | f, c). Errors
/// that are shared are not averaged away, and a source that is wrong is outvoted.
/// @param alternatives  with a positive sum of weights; none: the road that was found.
/// @throws std::invalid_argument for values that cannot be.
ScaleBelief scale_belief(const std::vector<ScaleEvidence>& evidence,
                         const std::vector<ScaleAlternative>& alternatives,
                         const ScaleBeliefNoise& noise);

}  // namespace camber
