#include "camber/road/road_surface.h"

#include <algorithm>
#include <cmath>

#include "camber/road/plan_polygon.h"

namespace camber {
namespace {

/// Curvature that an unseen continuation of a road may have, 1/m (a vertical curve of 60 m radius,
/// the sharpest that roads are built with). It sets how fast an extrapolation loses its certainty.
constexpr double kUnseenCurvature = 1.0 / 60.0;

PlanPolygon in_plan(const std::vector<Eigen::Vector3d>& boundary, const GroundAxes& axes) {
  PlanPolygon polygon;
  polygon.reserve(boundary.size());
  for (const Eigen::Vector3d& corner : boundary) polygon.push_back(axes(corner));
  return polygon;
}

/// Whether vehicles can stand on a patch.
bool is_ground(const PlanePatch& patch) {
  return patch.kind != PatchKind::kOther && patch.status != Status::kFailed &&
         patch.status != Status::kNotRun;
}

/// @param distance  of the place from the patch's boundary, m; 0: inside.
SurfaceQuery answer(const PlanePatch* patch, const Eigen::Vector3d& place, double distance,
                    const Eigen::Vector3d& unit_up) {
  SurfaceQuery out;
  if (!patch) {
    out.status = Status::kFailed;
    out.reason = "not covered";
    return out;
  }
  out.status = patch->status;
  out.reason = patch->reason;
  out.patch = patch->id;
  out.plane = patch->plane;
  const Plane& plane = patch->plane.plane;
  out.point = place - plane.signed_distance(place) / plane.normal.dot(unit_up) * unit_up;
  double variance =
      patch->plane.height_variance(out.point) + patch->unmodelled_sigma * patch->unmodelled_sigma;
  if (distance > 0.0) {
    const double tilt = kUnseenCurvature * distance;
    const double sag = 0.5 * tilt * distance;
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
  double best_distance = std::max(0.0, reach), best_climb = 0.0;
  for (const PlanePatch& patch : patches) {
    if (!is_ground(patch)) continue;
    const double slant = patch.plane.plane.normal.dot(unit_up);
    if (!(std::abs(slant) > 1e-3)) continue;
    const double distance = distance_to_polygon(in_plan(patch.boundary, axes), flat);
    const double climb = std::abs(patch.plane.plane.signed_distance(place) / slant);
    // Nearest in plan; among patches over one another the one nearest in height.
    if (distance > best_distance) continue;
    if (best && distance == best_distance && climb >= best_climb) continue;
    best = &patch;
    best_distance = distance;
    best_climb = climb;
  }
  return answer(best, place, best_distance, unit_up);
}

SurfaceQuery RoadSurface::query_ray(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction,
                                    double reach) const {
  const Eigen::Vector3d unit_up = up.normalized();
  const GroundAxes axes(unit_up);
  const PlanePatch* best = nullptr;
  Eigen::Vector3d place = origin;
  double best_distance = std::max(0.0, reach), best_along = 0.0;
  for (const PlanePatch& patch : patches) {
    if (!is_ground(patch) || !(std::abs(patch.plane.plane.normal.dot(unit_up)) > 1e-3)) continue;
    const double along =
        -patch.plane.plane.signed_distance(origin) / patch.plane.plane.normal.dot(direction);
    if (!(along > 0.0) || !std::isfinite(along)) continue;
    const Eigen::Vector3d hit = origin + along * direction;
    const double distance = distance_to_polygon(in_plan(patch.boundary, axes), axes(hit));
    if (distance > best_distance) continue;
    if (best && distance == best_distance && along >= best_along) continue;
    best = &patch;
    best_distance = distance;
    best_along = along;
    place = hit;
  }
  return answer(best, place, best_distance, unit_up);
}

}  // namespace camber
