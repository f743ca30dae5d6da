#pragma once

#include <Eigen/Core>
#include <vector>

#include "camber/core/random.h"
#include "camber/plane/detail/plane_sample.h"
#include "camber/plane/fit_plane.h"
#include "camber/plane/noise_model.h"

namespace camber::detail {

/// Planes that the sample of a cloud supports, found by MSAC: minimal samples, from all over the
/// cloud and from neighbourhoods in turn, each scored with an early exit and refined where it is
/// promising (Torr and Zisserman, "MLESAC", CVIU 2000; Chum, Matas and Kittler, "Locally optimized
/// RANSAC", DAGM 2003). Planes with less than 60 % of the best one's gain are pruned.
/// Same seed, same planes.
class PlaneHypotheses {
 public:
  /// @param sample  ordered; its scored points are weighed here for the noise
  PlaneHypotheses(const PlaneFitOptions& options, const NoiseModel& noise, PlaneSample* sample);

  /// Fills candidates(), the best first; false if there is no plane. Points on a line give the
  /// plane through them that is nearest to level.
  bool search();

  std::vector<PlaneCandidate>& candidates() { return candidates_; }
  int tried() const { return hypotheses_; }              ///< hypotheses scored
  double inlier_share() const { return inlier_share_; }  ///< of the best, 0 to 1
  /// Turns the normal to the up side; whether it is within the largest tilt.
  bool orient(PivotPlane* plane) const;

 private:
  bool search_samples();
  bool take_line();
  bool draw(std::uint64_t number, PivotPlane* plane) const;
  double cost(const PivotPlane& plane, double bound) const;
  void refine(PivotPlane* plane, double* cost_of_plane) const;
  bool describe(PlaneCandidate* candidate) const;
  PlaneCandidate* find(const PivotPlane& plane);
  void insert(const PlaneCandidate& candidate);

  const PlaneFitOptions& options_;
  const NoiseModel& noise_;
  PlaneSample& sample_;
  Eigen::Vector3d up_;
  CounterRandom random_;
  double nothing_ = 0.0;  // cost of no plane at all
  double best_gain_ = 0.0;
  std::vector<PlaneCandidate> candidates_;
  double inlier_share_ = 0.0;
  int hypotheses_ = 0;
};

}  // namespace camber::detail
