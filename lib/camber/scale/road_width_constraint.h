#pragma once

#include <string>

#include "camber/geometry/pinhole_camera.h"
#include "camber/road/road_posterior.h"
#include "camber/scale/road_edge_detection.h"
#include "camber/scale/scale_noise.h"

namespace camber {

/// What the nearly constant width of the road measures of it.
struct RoadWidthConstraint {
  Constraint constraint;  ///< "road_width"; empty: nothing is measured, see reason
  std::string reason;
  int places = 0;         ///< along the road, at which its width takes part
  int rejected = 0;       ///< places whose width is another
  double width = 0.0;     ///< m, where it is seen nearest
  double farthest = 0.0;  ///< m, of what takes part
  /// Mean square of the changes of width, in standard deviations, before and after.
  double misfit_before = 0.0, misfit_after = 0.0;
};

/// Widths across the road at up to two dozen distances, and that each differs little from the next
/// nearer one: a change of the logarithm of the width is a random walk of 1 % over 10 m. Places of
/// like width, within three standard deviations, make chains; the longest one is taken, so that
/// mouths of side streets, bays and an edge taken for another do not act.
RoadWidthConstraint road_width_constraint(const RoadPosterior& road, const PinholeCamera& camera,
                                          const RoadEdges& edges, const ScaleNoise& noise = {});

}  // namespace camber
