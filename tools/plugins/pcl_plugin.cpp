// Patches and ground by the Point Cloud Library, which brings many shared libraries.

#include "pcl_plugin.h"

#include "camber/road/pcl/morphological_ground.h"
#include "camber/road/pcl/region_growing.h"
#include "plugin.h"

namespace {

camber::RoadSurfaceFit patches(const camber::RoadCloud& cloud,
                               const camber::RoadSurfaceOptions& options) {
  return camber::fit_road_surface_pcl(cloud, options);
}

const camber::tools::PclFunctions kFunctions{patches, camber::segment_ground_pcl};

}  // namespace

CAMBER_EXPORT const camber::tools::PclFunctions* camber_pcl();
CAMBER_EXPORT const camber::tools::PclFunctions* camber_pcl() { return &kFunctions; }
