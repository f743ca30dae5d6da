#include "camber/road/cut_surface.h"

#include <algorithm>
#include <set>

namespace camber {

using Eigen::Vector3d;

std::vector<Vector3d> cut_polygon(const std::vector<Vector3d>& polygon, const PlanBounds& bounds) {
  struct Side {
    Eigen::Index axis;
    double sign, limit;  // inside: sign * x[axis] >= sign * limit
  };
  std::vector<Vector3d> out = polygon;
  for (const Side& side : {Side{0, 1.0, bounds.x0}, Side{0, -1.0, bounds.x1},
                           Side{1, 1.0, bounds.y0}, Side{1, -1.0, bounds.y1}}) {
    const auto depth = [&](const Vector3d& x) { return side.sign * (x[side.axis] - side.limit); };
    const std::vector<Vector3d> before = std::move(out);
    out.clear();
    for (std::size_t i = 0; i < before.size(); ++i) {
      const Vector3d &a = before[i], &b = before[(i + 1) % before.size()];
      const double da = depth(a), db = depth(b);
      if (da >= 0.0) out.push_back(a);
      if ((da > 0.0 && db < 0.0) || (da < 0.0 && db > 0.0))
        out.push_back(a + da / (da - db) * (b - a));
    }
  }
  if (out.size() < 3) out.clear();
  return out;
}

void cut_surface(const PlanBounds& bounds, const std::vector<int>& labels, RoadSurface* surface) {
  const std::set<int> kept(labels.begin(), labels.end());
  std::vector<PlanePatch>& patches = surface->patches;
  patches.erase(std::remove_if(patches.begin(), patches.end(),
                               [&](PlanePatch& patch) {
                                 if (kept.count(patch.id) == 0) return true;
                                 patch.boundary = cut_polygon(patch.boundary, bounds);
                                 return patch.boundary.empty();
                               }),
                patches.end());
  const auto gone = [&](int id) { return surface->find(id) == nullptr; };
  std::vector<PatchLink>& links = surface->links;
  links.erase(std::remove_if(links.begin(), links.end(),
                             [&](const PatchLink& link) { return gone(link.a) || gone(link.b); }),
              links.end());
  if (gone(surface->ego_patch)) surface->ego_patch = -1;
}

}  // namespace camber
