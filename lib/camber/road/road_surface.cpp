#include "camber/road/road_surface.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace camber {
namespace {

/// Curvature that an unseen continuation of a road may have, 1/m (a vertical curve of 60 m radius,
/// the sharpest that roads are built with). It sets how fast an extrapolation loses its certainty.
constexpr double kUnseenCurvature = 1.0 / 60.0;

/// Two unit directions that span the plane across `up`.
struct GroundAxes {
  Eigen::Vector3d e1, e2;
  explicit GroundAxes(const Eigen::Vector3d& up) {
    const Eigen::Vector3d along =
        std::abs(up.z()) < 0.9 ? Eigen::Vector3d::UnitZ() : Eigen::Vector3d::UnitX();
    UncertainPlane::make_axes(up, along, &e1, &e2);
  }
  Eigen::Vector2d operator()(const Eigen::Vector3d& x) const { return {e1.dot(x), e2.dot(x)}; }
};

/// Distance in plan from a place to a polygon, m; 0 inside.
double distance_to_polygon(const std::vector<Eigen::Vector3d>& polygon, const GroundAxes& axes,
                           const Eigen::Vector2d& place) {
  if (polygon.empty()) return std::numeric_limits<double>::infinity();
  bool inside = false;
  double nearest = std::numeric_limits<double>::infinity();
  Eigen::Vector2d a = axes(polygon.back());
  for (const Eigen::Vector3d& corner : polygon) {
    const Eigen::Vector2d b = axes(corner);
    if ((a.y() > place.y()) != (b.y() > place.y()) &&
        place.x() < a.x() + (b.x() - a.x()) * (place.y() - a.y()) / (b.y() - a.y())) {
      inside = !inside;
    }
    const Eigen::Vector2d edge = b - a;
    const double length2 = edge.squaredNorm();
    const double share =
        length2 > 0.0 ? std::clamp((place - a).dot(edge) / length2, 0.0, 1.0) : 0.0;
    nearest = std::min(nearest, (place - a - share * edge).norm());
    a = b;
  }
  return inside ? 0.0 : nearest;
}

}  // namespace

std::string_view to_string(PatchKind kind) {
  switch (kind) {
    case PatchKind::kRoad:
      return "road";
    case PatchKind::kPavement:
      return "pavement";
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
  const Eigen::Vector3d unit_up = up.normalized();
  const GroundAxes axes(unit_up);
  const Eigen::Vector2d flat = axes(place);
  const PlanePatch* best = nullptr;
  double best_distance = std::max(reach, 0.0), best_climb = 0.0;
  for (const PlanePatch& patch : patches) {
    if (patch.kind == PatchKind::kOther || patch.status == Status::kFailed ||
        patch.status == Status::kNotRun) {
      continue;
    }
    const double slant = patch.plane.plane.normal.dot(unit_up);
    if (!(std::abs(slant) > 1e-3)) continue;
    const double distance = distance_to_polygon(patch.boundary, axes, flat);
    const double climb = std::abs(patch.plane.plane.signed_distance(place) / slant);
    // Nearest in plan; among patches over one another the one nearest in height.
    if (distance > best_distance) continue;
    if (best && distance == best_distance && climb >= best_climb) continue;
    best = &patch;
    best_distance = distance;
    best_climb = climb;
  }
  SurfaceQuery out;
  if (!best) {
    out.status = Status::kFailed;
    out.reason = "not covered";
    return out;
  }
  out.status = best->status;
  out.reason = best->reason;
  out.patch = best->id;
  out.plane = best->plane;
  const Plane& plane = best->plane.plane;
  out.point = place - plane.signed_distance(place) / plane.normal.dot(unit_up) * unit_up;
  double variance = best->plane.height_variance(out.point);
  if (best_distance > 0.0) {
    const double tilt = kUnseenCurvature * best_distance;
    const double sag = 0.5 * tilt * best_distance;
    out.plane.covariance(0, 0) += tilt * tilt;
    out.plane.covariance(1, 1) += tilt * tilt;
    out.plane.covariance(2, 2) += sag * sag;
    variance += sag * sag;
    if (out.status == Status::kOk) {
      out.status = Status::kWeak;
      out.reason = "extrapolated beyond the patch's boundary";
    }
  }
  out.sigma_height = std::sqrt(std::max(0.0, variance));
  return out;
}

}  // namespace camber
