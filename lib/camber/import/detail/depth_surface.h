#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "camber/geometry/pinhole_camera.h"
#include "camber/geometry/plane.h"
#include "camber/import/vehicles_from_depth.h"

namespace camber {

// A vehicle's surface as a depth image shows it, and the ground that it stands on.

/// Points of a region with their normals, camera frame.
struct DepthSurface {
  std::vector<Eigen::Vector3d> points;   ///< m, one a pixel of the region, in its order
  std::vector<Eigen::Vector3d> normals;  ///< unit, towards the camera; zero where not known
  std::vector<double> areas;             ///< relative; 0 where there is no normal
};

/// What a silhouette ends at, as shares of the rows looked at.
struct SilhouetteEnds {
  double hidden_left = 0, hidden_right = 0;  ///< at something nearer
  double cut_left = 0, cut_right = 0;        ///< at the image's border
};

/// The quantile of a list that may be reordered; NaN for an empty one.
double take_quantile(std::vector<double> values, double share);

DepthSurface surface_of(const VehicleRegion& region, const DepthImage& depth,
                        const PinholeCamera& camera);

/// The ground beside a region: a robust plane of the ground's pixels around its lower part.
/// Nothing where there are fewer than 30.
std::optional<Plane> ground_beside(const VehicleRegion& region, const DepthSurface& surface,
                                   const LabelledDepth& image, const PinholeCamera& camera);

/// @param low  by pixel of the region: whether its row counts.
SilhouetteEnds silhouette_ends(const VehicleRegion& region, const DepthImage& depth,
                               const std::vector<bool>& low);

/// Share of a box's picture that something nearer hides, of what is not ground.
double hidden_share(const VehicleRegion& region, const OrientedBox& box, const LabelledDepth& image,
                    const PinholeCamera& camera);

/// Rectangle of a region's pixels.
Box2 box_of(const VehicleRegion& region, int width);

}  // namespace camber
