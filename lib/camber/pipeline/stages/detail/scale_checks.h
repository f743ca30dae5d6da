#pragma once

#include <Eigen/Core>
#include <vector>

#include "camber/pipeline/stages/scale.h"
#include "camber/scale/lane_marking_detection.h"

namespace camber::stages::detail {

/// Of the sources, each alone, before the ground is conditioned on all of them.
void add_sources(const RoadPosterior& prior, const std::vector<Constraint>& constraints,
                 const ScaleNoise& noise, ScaledRoad* scaled);

/// What is compared with the result without taking part in it.
void add_checks(const LoadedFrames& frames, const Correspondences& matches,
                const PhotometricGround& ground, const GroundRaster& raster,
                const Eigen::Vector3d& travel, const ScaleOptions& options, ScaledRoad* scaled);

}  // namespace camber::stages::detail
