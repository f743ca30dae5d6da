#pragma once

#include <Eigen/Core>
#include <utility>
#include <vector>

#include "camber/road/road_surface.h"

namespace camber::test {

/// A rectangle of road, z up, from x0 to x1 and y0 to y1, with slopes along x and y (rise over
/// run); its height at (x0, 0) is z0.
/// @param variances  of tilt, tilt and height
inline PlanePatch rectangle(int id, double x0, double x1, double y0, double y1, double z0,
                            double along, double across, const Eigen::Vector3d& variances) {
  PlanePatch patch;
  patch.id = id;
  patch.status = Status::kOk;
  const auto on = [&](double x, double y) {
    return Eigen::Vector3d(x, y, z0 + (x - x0) * along + y * across);
  };
  UncertainPlane& plane = patch.plane;
  plane.plane = Plane::through(on(x0, 0.0), Eigen::Vector3d(-along, -across, 1.0).normalized());
  plane.centroid = on(0.5 * (x0 + x1), 0.5 * (y0 + y1));
  UncertainPlane::make_axes(plane.plane.normal, Eigen::Vector3d::UnitX(), &plane.axis1,
                            &plane.axis2);
  plane.covariance = variances.asDiagonal();
  patch.boundary = {on(x0, y0), on(x1, y0), on(x1, y1), on(x0, y1)};
  return patch;
}

inline RoadSurface surface_of(std::vector<PlanePatch> patches) {
  RoadSurface surface;
  surface.frame = "z-up";
  surface.up = Eigen::Vector3d::UnitZ();
  surface.patches = std::move(patches);
  return surface;
}

}  // namespace camber::test
