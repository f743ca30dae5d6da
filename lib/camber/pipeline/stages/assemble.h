#pragma once

#include <vector>

#include "camber/cloud/road_cloud.h"
#include "camber/pipeline/stages/ground.h"
#include "camber/pipeline/stages/judge.h"
#include "camber/pipeline/stages/load.h"
#include "camber/pipeline/stages/scale.h"
#include "camber/pipeline/stages/surface.h"
#include "camber/pipeline/stages/vehicles.h"
#include "camber/scene/results.h"

namespace camber {

/// What a run hands out: every plane, point and length by the last posterior of the road.
struct AssembledRoad {
  RoadCloud cloud;  ///< labels["patch"]; colours; sigmas along the viewing rays
  RoadSurface surface;
  VehicleDocument vehicles;
  RunDocument run;              ///< cameras, scale, constraints; no options, no timings
  double scale_by_focal = 1.0;  ///< ScaledRoad::scale_by_focal
};

namespace stages {

struct AssembleOptions {
  int num_threads = 0;  ///< <= 0: see resolve_num_threads
  ScaleNoise noise;     ///< as that of ScaleOptions
};

/// Writes all results by the judged road, which is that of `scaled` given the vehicles.
AssembledRoad assemble(const LoadedFrames& frames, const Correspondences& matches,
                       const PhotometricGround& ground, const ScaledRoad& scaled,
                       const SurfacePlan& plan, const PlacedVehicles& vehicles,
                       const JudgedRoad& judged, VehicleMethod method,
                       const AssembleOptions& options);

}  // namespace stages
}  // namespace camber
