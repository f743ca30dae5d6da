#pragma once

#include <optional>
#include <string>
#include <vector>

#include "camber/pipeline/stages/ground.h"
#include "camber/pipeline/stages/load.h"
#include "camber/pipeline/stages/scale.h"
#include "camber/road/local_plane.h"
#include "camber/road/road_surface.h"

namespace camber {

/// Where a patch of the surface lies: its plane is read off a road's posterior.
struct PatchFootprint {
  int id = 0;  ///< of the patch in the surface; the ego plane's is 0
  PatchKind kind = PatchKind::kRoad;
  Eigen::Vector2d contact{0, 0};  ///< px of the reference image: the middle of its near end
  Box2 around;                    ///< px: the ground points that are counted as its own
  LocalPlaneOptions local;        ///< its size
  LocalPlane plane;               ///< by the road that surface() was given
  double ahead = 0.0;             ///< m, of its boundary beyond its centroid
  int inliers = 0;                ///< ground points that carry it
  std::string unobserved;         ///< why the ground is hardly seen there; empty: it is
};

/// Which patches there are.
struct SurfacePlan {
  std::vector<PatchFootprint> road;  ///< along the direction of travel, nearest first
  /// [frame][detection]; nothing where a plane is given with the detection or where the ray to its
  /// bottom meets no ground.
  std::vector<std::vector<std::optional<PatchFootprint>>> under_vehicles;
};

namespace stages {

struct SurfaceOptions {
  double patch_length = 5.0;      ///< m, along the road, > 0
  double patch_half_width = 2.0;  ///< m, > 0
  double reach = 60.0;            ///< m ahead, > 0
  double worst_height = 0.5;      ///< m, standard deviation of a plane's that ends the road, > 0
  /// px, >= 0, of the angle between the line of sight and a plane: below it the road may fall away
  /// unseen, and what bridges a dip is no road. Drawn crests: nearly all planes below were wrong.
  double grazing_px = 6.5;
  /// Factor, > 0, on a detection's box in which ground points are counted for the plane under it
  /// (paper, section III-C: 1.9 to 2.0).
  double box_expansion = 1.95;
  LocalPlaneOptions under_vehicle;
  bool under_vehicles = true;  ///< false: the road alone has patches
  int num_threads = 0;         ///< <= 0: see resolve_num_threads
  void validate() const;       ///< throws std::invalid_argument
};

/// Decides which patches the surface has: pieces of road while the ground is seen, and the ground
/// under each detection of each frame.
/// @throws std::invalid_argument if options.validate() fails.
SurfacePlan surface(const LoadedFrames& frames, const Correspondences& matches,
                    const MotionEstimate& motion, const Ground& ground, const RoadPosterior& road,
                    const SurfaceOptions& options);

}  // namespace stages
}  // namespace camber
