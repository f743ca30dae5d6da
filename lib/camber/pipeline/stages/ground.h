#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "camber/motion/correspondences.h"
#include "camber/motion/motion.h"
#include "camber/motion/triangulation.h"
#include "camber/photometric/direct_ground.h"
#include "camber/photometric/plane_search.h"
#include "camber/photometric/road_sweep.h"
#include "camber/pipeline/stages/load.h"
#include "camber/road/ground_field.h"
#include "camber/scale/ego_plane.h"

namespace camber {

/// Points of the ground, up to scale (longest baseline 1), reference camera.
struct GroundPoints {
  std::vector<std::uint8_t> is_ground;   ///< one a grid point of the correspondences
  std::vector<std::uint8_t> is_roadway;  ///< one a grid point: carries the ego plane
  TriangulatedPoints points;             ///< of the ground
  TriangulatedPoints others;             ///< where no mask shows it: of what is taken for no ground
};

/// What shows where the near road is.
enum class NearRoadSource {
  kMatches,
  kPassing,  ///< what passes on it, a plane; of the matches only those that lie on it are taken
  kSpeed,    ///< such a plane by the given speed and the given height of the camera
};

/// The ground ahead as far as it is found, up to scale (longest baseline 1), reference camera.
struct Ground {
  GroundPoints seen;
  EgoPlane ego;                      ///< the tangent plane under the camera
  double metres_per_baseline = 1.0;  ///< by the camera's height, or by known poses
  std::shared_ptr<const GroundField> field;
  PlaneSearchResult search;  ///< of the near road, from no start
  /// Of the logarithm of the camera's height in baselines: the most by which roads that were seen
  /// from other starts, on which as many points agree, differ from this one; 0 where there are
  /// none.
  double alternative_spread = 0.0;
  /// By what passes on the road, where that was looked at.
  std::optional<RoadSweepResult> passing = std::nullopt;
  NearRoadSource near_road = NearRoadSource::kMatches;
};

/// Blocks of an image, row by row.
struct RejectedBlocks {
  static constexpr int kWide = 128, kHigh = 24;  ///< px
  int columns = 0;
  std::vector<std::uint8_t> rejected;  ///< non-zero: yes; empty: none is

  int rows() const { return static_cast<int>(rejected.size()) / columns; }
  bool at(double u, double v) const;
  /// Share of the blocks that a box touches which are rejected.
  double share(const Box2& box) const;
};

/// A ground and the motion that belongs to it.
struct PhotometricGround {
  Ground ground;          ///< its field by the matches alone
  MotionEstimate motion;  ///< refined where accepted
  /// By matches and intensities; null where not accepted, see rejection.
  std::shared_ptr<const GroundField> field;
  DirectEvidence evidence;  ///< of held-out pixels for that field
  std::string rejection;
  /// Blocks of the image in which the intensities are left out: pixels that took no part agree less
  /// with them than without.
  RejectedBlocks rejected_blocks;
  /// By which the logarithm of the scale would change with intensities that contradict the motion
  /// of the matches; nothing where they do not.
  std::optional<double> rejected_log_scale = std::nullopt;
  /// Share of the points near the driven path that agreed with the ego plane's road before the
  /// refinement.
  double agreeing_before = 1.0;
};

namespace stages {

struct GroundOptions {
  double unknown_camera_height = 1.65;  ///< m, taken where none is known: the unit of the result
  /// Correlation of the plane search from which it starts a ground that no match shows, 0 to 1.
  double searched_correlation = 0.6;
  int num_threads = 0;  ///< <= 0: see resolve_num_threads
};

/// Searches for the length of the baselines in camera heights on the intensities of the near road,
/// with the images next to the reference; where the driven corridor does not fix it, of one twice
/// as wide. It needs no matches on the ground: those may agree on a wrong depth where the road
/// moves fast.
PlaneSearchResult search_plane(const LoadedFrames& frames, const MotionEstimate& motion,
                               const GroundOptions& options);

/// How much better the intensities of the near road agree with the search's baselines than with
/// others, at any curvature and roll: a difference of normalised cross-correlations.
/// @param height  of the camera above the ego plane that is asked about, baselines.
double lead_over(const LoadedFrames& frames, const MotionEstimate& motion,
                 const PlaneSearchResult& search, double height, int num_threads);

/// Triangulates the ground: what the masks show, or what grows from the near road.
/// @param before  of an earlier round, whose extent is kept where no road grows; may be null.
/// @throws NoAnswerError where no road grows and there was none before.
GroundPoints triangulate(const LoadedFrames& frames, const Correspondences& matches,
                         const MotionEstimate& motion, const GroundPoints* before,
                         const GroundOptions& options);

/// The first ground: by the plane search where that is informative, and by the points.
/// @param start  the near road to begin with in place of either.
/// @throws NoAnswerError where there is no plane under the camera.
Ground first_ground(const LoadedFrames& frames, const Correspondences& matches,
                    const MotionEstimate& motion, GroundPoints points,
                    const PlaneSearchResult& search, const GroundOptions& options,
                    const std::optional<RoadHypothesis>& start = std::nullopt);

/// Fits the tangent plane under the camera and the ground field.
/// @param before  of an earlier round: the field starts from its field, and its ego plane stays
///                where no new one is found.
Ground ground(const LoadedFrames& frames, const Correspondences& matches,
              const MotionEstimate& motion, GroundPoints points, const Ground& before,
              const GroundOptions& options);

/// Refines the motion and the ground on the intensities of all images; accepted where the pixels
/// left out of it agree better than before.
PhotometricGround refine_photometrically(const LoadedFrames& frames, const Correspondences& matches,
                                         const MotionEstimate& motion, const Ground& before,
                                         const GroundOptions& options);

/// Ground seen in the reference image, one byte a pixel.
std::vector<std::uint8_t> ground_pixels(const LoadedFrames& frames, const Correspondences& matches,
                                        const Ground& ground);

}  // namespace stages
}  // namespace camber
