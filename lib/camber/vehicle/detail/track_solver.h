#pragma once

// One vehicle of several views: its start, its hypotheses, its answer.

#include <memory>
#include <optional>

#include "camber/vehicle/detail/association.h"
#include "camber/vehicle/detail/vehicle_posterior.h"

namespace camber::internal {

/// One vehicle being solved.
struct TrackSolution {
  Track views;   ///< that agree on the heading
  int lead = 0;  ///< the one that is known best
  std::unique_ptr<VehiclePosterior> posterior;
  VehicleState moving, parked;
  bool is_parked = false;  ///< by the evidence
  const VehicleState& answer() const { return is_parked ? parked : moving; }
  const TrackView& lead_view() const { return views[static_cast<std::size_t>(lead)]; }
};

/// Chooses the views of a track that can be joined and starts from their single fits.
/// @return nothing if fewer than `least_views` are left.
std::optional<TrackSolution> start_track(const PinholeCamera& camera,
                                         const std::vector<TrackFrame>& frames, const Track& track,
                                         const VehicleFitOptions& options, double scale_sigma,
                                         std::size_t least_views);

/// Registers the views between their images and solves both hypotheses.
void solve_track(const std::vector<TrackFrame>& frames, const VehiclePrior& prior,
                 TrackSolution* solution);

/// Both hypotheses (moving, parked) from where they are; the one of greater evidence.
void choose_hypothesis(TrackSolution* solution);

/// Leaves estimates ([frame][detection]) as they are where the solution is not reliable.
void write_track(const std::vector<TrackFrame>& frames, const VehiclePrior& prior,
                 const TrackSolution& solution,
                 std::vector<std::vector<VehicleEstimate>>* estimates);

}  // namespace camber::internal
