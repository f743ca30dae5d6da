#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

#include "camber/geometry/pinhole_camera.h"
#include "camber/image/image.h"
#include "camber/motion/motion.h"

namespace camber {

/// One image of a plane search.
struct PlaneSearchImage {
  const GrayImage* image = nullptr;
  /// One byte a pixel, row-major: non-zero where something stands or moves; null: nowhere.
  const std::vector<std::uint8_t>* ignored = nullptr;
};

/// The road under the camera as the search sees it: it touches the plane through the foot under the
/// camera, along the direction of travel, and bends evenly ahead.
struct RoadHypothesis {
  double log_baseline = 0.0;  ///< logarithm of the longest baseline over the camera's height
  double curvature = 0.0;     ///< vertical, 1/camera height, positive: a sag
  double roll = 0.0;          ///< rad, of the camera about the direction of travel
};

struct PlaneSearchOptions {
  double half_width = 0.75;  ///< of the corridor along the driven path, camera heights, > 0
  double reach = 10.0;       ///< ahead, camera heights, > 0
  double least_log_baseline = -4.0, greatest_log_baseline = 1.3;
  double max_curvature = 0.027;  ///< 1/camera height, >= 0
  double max_roll = 0.09;        ///< rad, >= 0
  /// Limits for an informative search: correlations, samples, and how far the logarithm may go for
  /// a correlation of 0.05 less.
  double least_correlation = 0.2;
  double least_lead = 0.2;  ///< of the best correlation over that of any other baseline
  int least_samples = 1000;
  double widest_interval = 0.16;
  /// Correlation from which on the best and one that it does not lead by that are both roads.
  double road_correlation = 0.6;
  int num_threads = 0;  ///< <= 0: see resolve_num_threads
};

struct PlaneSearchResult {
  RoadHypothesis best;
  double half_width = 0.0;   ///< of the corridor that was compared, camera heights
  double correlation = 0.0;  ///< of the best
  int samples = 0;           ///< compared there: one for nine pixels of each other image
  double rival = -1.0;       ///< correlation of the best baseline elsewhere, half the resolution
  double lead = 0.0;         ///< of the best over that, at the same resolution
  double interval = 0.0;     ///< width in the logarithm within 0.05 of the best correlation
  bool informative = false;  ///< the near road fixes the baseline
  bool ambiguous = false;    ///< another baseline fits the near road nearly as well
  /// Other maxima of the correlation, whose baselines are not the best one's: where a texture
  /// repeats one of them may be right. At half the resolution, best first.
  std::vector<RoadHypothesis> others;
};

/// Searches for the length of the baselines, in camera heights, with which the intensities of the
/// near road agree best, over the whole range that a drive can have (plane sweep; Collins, "A
/// Space-Sweep Approach to True Multi-Image Matching", CVPR 1996): it needs no start and no match.
/// Windows are compared by normalised cross-correlation. A start and a check, no measurement: where
/// the near road is out of view or without texture it is not informative.
class PlaneSearch {
 public:
  /// @param reference  index into the images.
  /// @throws std::invalid_argument for sizes that disagree. The images must outlive this.
  PlaneSearch(const PinholeCamera& camera, const std::vector<PlaneSearchImage>& images,
              std::size_t reference, const PlaneSearchOptions& options);
  ~PlaneSearch();

  PlaneSearchResult search(const MotionEstimate& motion) const;

  /// The best correlation of any curvature and roll with these baselines.
  /// @param log_baseline  logarithm of the longest baseline over the camera's height.
  double correlation_with_baseline(const MotionEstimate& motion, double log_baseline) const;

  /// Correlation of one hypothesis; *samples receives those of its result.
  double correlation(const MotionEstimate& motion, const RoadHypothesis& hypothesis,
                     int* samples = nullptr) const;

 private:
  struct Level;
  double correlation_at(const Level& level, const MotionEstimate& motion,
                        const RoadHypothesis& hypothesis, double level_windows, int* samples) const;
  std::vector<double> correlations(const Level& level, const MotionEstimate& motion,
                                   const std::vector<RoadHypothesis>& hypotheses) const;
  /// How many windows the corridor of a level road has in view.
  double corridor_windows(const Level& level, const MotionEstimate& motion) const;
  bool within(const RoadHypothesis& hypothesis) const;
  /// The best of several, if it is better than the best so far. @return whether it is.
  bool take_best(const Level& level, const MotionEstimate& motion,
                 const std::vector<RoadHypothesis>& tried, RoadHypothesis* best,
                 double* correlation) const;
  /// Hypotheses around one of them, with the correlations that are known.
  struct Lattice;
  using Place = std::array<int, 3>;  // steps of baseline, curvature and roll from its origin
  std::vector<double> correlations(const std::vector<Place>& places, Lattice* lattice) const;
  bool take_best(const std::vector<Place>& tried, Lattice* lattice, Place* best,
                 double* correlation) const;
  /// The best of all curvatures with baselines nearby.
  Place bend(Lattice* lattice) const;
  /// Climbs to a maximum of the correlation nearby.
  void climb(int rounds, Lattice* lattice, Place* best, double* correlation) const;
  /// The best hypotheses of the whole range at the coarsest resolution.
  std::vector<RoadHypothesis> sweep(const MotionEstimate& motion) const;

  PlaneSearchOptions options_;
  std::size_t reference_ = 0;
  std::vector<Level> levels_;  // finest first
};

/// Unit normal, up, of a hypothesis' road under the camera.
Eigen::Vector3d road_normal(const Eigen::Vector3d& travel, double roll);

/// Inverse depth, 1/camera height, of a hypothesis' road at a pixel; 0: the ray misses it.
/// @param travel  unit direction of travel, camera frame.
double road_inverse_depth(const PinholeCamera& camera, const Eigen::Vector3d& travel,
                          const RoadHypothesis& hypothesis, const Eigen::Vector2d& pixel);

}  // namespace camber
