#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <optional>
#include <vector>

#include "camber/drive/trajectory.h"
#include "camber/geometry/se3.h"
#include "camber/scene/scene.h"

namespace camber {

/// The positions of a GNSS receiver along a drive.
/// @param frame_ids  of the trajectory, ascending.
/// @param up         unit, world: the map's z.
MapPositions map_positions(const Scene& scene, const std::vector<int>& frame_ids,
                           const Eigen::Vector3d& up);

/// What positions measure of a drive's scale.
struct PositionScale {
  double log_scale = 0.0;  ///< logarithm of lengths on the map over those of the trajectory
  double sigma = 0.0;      ///< of it, by the receiver alone
  int stretches = 0;       ///< that were compared
};

/// Plan similarities of stretches of a trajectory to its positions (Umeyama, "Least-Squares
/// Estimation of Transformation Parameters Between Two Point Patterns", PAMI 1991), joined with
/// heavy tails. A stretch is long against the receiver's errors, and short against the drift of the
/// trajectory's heading. Errors of positions last for seconds: many in a stretch count no more than
/// two at its ends.
/// @return none where no stretch shows its scale to 30 %.
std::optional<PositionScale> scale_by_positions(const Trajectory& trajectory,
                                                const MapPositions& positions);

inline constexpr double kMostPositionSigmas = 3.0;

/// The drive's own scale joined with that of its positions, which know nothing of each other.
struct JoinedScale {
  double log_scale = 0.0;     ///< of the trajectory's lengths
  double common_sigma = 0.0;  ///< relative, of all lengths together
  /// How far the two are apart; NaN: the drive's own is in no metres.
  double disagreement_sigmas = 0.0;
};

/// Beyond kMostPositionSigmas nobody knows which of the two is wrong: the trajectory's scale
/// stands, as uncertain as they differ.
JoinedScale joined_scale(const Trajectory& trajectory, const PositionScale& positions);

}  // namespace camber
