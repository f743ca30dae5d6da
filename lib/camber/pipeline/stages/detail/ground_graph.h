#pragma once

// The consistency graph of a run's planes.

#include <vector>

#include "camber/geometry/pinhole_camera.h"
#include "camber/pipeline/stages/vehicles.h"

namespace camber::stages::detail {

/// The planes under detections.
struct DetectedGround {
  const std::vector<TrackFrame>* views = nullptr;   ///< with their supports; null: no detections
  const std::vector<LocalPlane>* planes = nullptr;  ///< those that are functions of the road
  const std::vector<TrackView>* at = nullptr;       ///< of which detection each is, ascending
  LocalPlaneOptions local;
};

/// Planes that are no functions of the road stand by themselves. Of very many detections those of
/// the tallest boxes take part.
/// @param factorised  false: the joint covariance of all planes in the graph's place.
GroundGraph ground_graph(const RoadPosterior& road, const SurfacePlan& plan,
                         const DetectedGround& detected, bool factorised = true);

}  // namespace camber::stages::detail
