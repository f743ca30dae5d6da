#pragma once

#include "camber/road/fit_road_surface.h"
#include "camber/road/segment_ground.h"

namespace camber::tools {

/// What the plugin pcl exports, camber_pcl(): --engine pcl of patches and ground.
struct PclFunctions {
  RoadSurfaceFit (*fit_road_surface)(const RoadCloud& cloud, const RoadSurfaceOptions& options);
  GroundSegmentation (*segment_ground)(const RoadCloud& cloud, const GroundOptions& options);
};

}  // namespace camber::tools
