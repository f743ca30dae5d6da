#pragma once

#include <Eigen/Core>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "camber/core/status.h"
#include "camber/geometry/plane.h"

namespace camber {

/// kGround: ground of which it is not known whether it is road.
enum class PatchKind { kRoad, kPavement, kGround, kOther };
std::string_view to_string(PatchKind kind);  ///< "road", "pavement", "ground", "other"

/// One planar piece of the road. Frame and unit are those of the RoadSurface that holds it.
struct PlanePatch {
  int id = 0;
  PatchKind kind = PatchKind::kRoad;
  Status status = Status::kNotRun;
  std::string reason;    ///< empty for kOk
  UncertainPlane plane;  ///< axis1 along the road where that is known
  int inliers = 0;
  double noise = 0.0;  ///< m, standard deviation of a point across it, if known
  /// m, standard deviation of the ground's height about the plane beyond `plane.covariance`: how
  /// far it bends away from the plane, and errors that the patch's points have in common.
  double unmodelled_sigma = 0.0;
  std::vector<Eigen::Vector3d> boundary;  ///< convex or simple polygon on the plane
  double grade = 0.0;                     ///< rad, slope along axis1, positive: climbs ahead
  double bank = 0.0;                      ///< rad, slope across, positive: left side up
  std::string refinement;                 ///< "accepted", "refused: reason", or empty: none tried
  /// Where `plane` holds what a vehicle on it measured: the plane by the ground alone.
  std::optional<UncertainPlane> without_vehicle;
};

/// Neighbourhood of two patches in the consistency graph; invalid links are kept with their reason.
struct PatchLink {
  int a = 0, b = 0;  ///< patch ids
  bool valid = true;
  std::string reason;
  double weight = 0.0;
  double distance = 0.0;     ///< m between the boundaries in the plan across up, 0: they meet
  double height_step = 0.0;  ///< m, b above a at the midpoint between the two
  double angle = 0.0;        ///< rad between the normals
  /// Of a solved graph: how far the two patches are from what the link lets expect, in standard
  /// deviations; NaN: not measured.
  double residual_sigma = std::numeric_limits<double>::quiet_NaN();
};

/// Answer of a surface query at one place.
struct SurfaceQuery {
  Status status = Status::kNotRun;  ///< kFailed: not covered (see reason)
  std::string reason;
  int patch = -1;                                   ///< id of the answering patch
  UncertainPlane plane;                             ///< the patch's plane
  Eigen::Vector3d point = Eigen::Vector3d::Zero();  ///< on the surface, above or below the place
  /// m, of the ground along the normal at `point`: of the plane, and of what it leaves out.
  double sigma_height = 0.0;
};

/// A road as planar patches, their neighbourhood and the driven line.
struct RoadSurface {
  /// What `up` is, and so what grades and banks are against.
  enum class Level { kCamera, kGravity };
  std::string frame = "camera";        ///< "camera", "z-up" or another name
  Eigen::Vector3d up{0.0, -1.0, 0.0};  ///< unit
  Level level = Level::kCamera;
  double level_sigma = 0.0;  ///< rad, standard deviation of `up` about each axis; 0: not stated
  bool metric = true;
  double scale_sigma = 0.0;  ///< relative standard deviation of the scale
  int ego_patch = -1;        ///< id of the ego patch, -1: none
  std::vector<PlanePatch> patches;
  std::vector<PatchLink> links;
  std::vector<Eigen::Vector3d> driven_line;  ///< foot points of the camera path on the road

  /// Not found: nullptr.
  const PlanePatch* find(int id) const;

  /// The surface above or below a place: the patch that contains it (seen along `up`) or, within
  /// `reach` metres of a boundary, the nearest, with the covariance grown by the extrapolation; of
  /// levels over one another the one nearest in height. None: kFailed, reason "not covered".
  SurfaceQuery query(const Eigen::Vector3d& place, double reach = 2.0) const;

  /// The patch that a ray meets: the nearest along the ray of those whose boundary holds the hit
  /// (seen along `up`) or, within `reach` metres, the one whose boundary is nearest to its hit; the
  /// covariance grows by the extrapolation. kFailed where it meets none.
  SurfaceQuery query_ray(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction,
                         double reach = 2.0) const;
};

/// "camera" or "gravity".
inline const char* to_string(RoadSurface::Level level) {
  return level == RoadSurface::Level::kGravity ? "gravity" : "camera";
}

}  // namespace camber
