#include "camber/road/road_surface.h"

#include "camber/road/surface_lookup.h"

namespace camber {

std::string_view to_string(PatchKind kind) {
  switch (kind) {
    case PatchKind::kRoad:
      return "road";
    case PatchKind::kPavement:
      return "pavement";
    case PatchKind::kGround:
      return "ground";
    case PatchKind::kOther:
      break;
  }
  return "other";
}

const PlanePatch* RoadSurface::find(int id) const {
  for (const PlanePatch& patch : patches) {
    if (patch.id == id) return &patch;
  }
  return nullptr;
}

SurfaceQuery RoadSurface::query(const Eigen::Vector3d& place, double reach) const {
  return SurfaceLookup(*this).query(place, reach);
}

SurfaceQuery RoadSurface::query_ray(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction,
                                    double reach) const {
  return SurfaceLookup(*this).query_ray(origin, direction, reach);
}

}  // namespace camber
