#pragma once

// Message passing between vehicles over the planes that they stand on.

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "camber/vehicle/detail/vehicle_posterior.h"
#include "camber/vehicle/ground_message.h"

namespace camber::internal {

/// What is known of (plane, log scale) from a vehicle's normal equations without their priors: all
/// other parameters are eliminated.
/// @param pose_at  of the pose that touches the plane, among the parameters; the last of them is
///                 the log scale.
/// @return changes from where the normal equations were formed; nothing if they are not positive.
std::optional<GroundMessage> eliminate_to_ground(const NormalEquations& equations,
                                                 Eigen::Index pose_at, const ContactTerms& contact);

/// What a vehicle measures of the plane under one of its views and of the log scale: its posterior
/// (the shape integrated out) without their priors.
/// @param reference  the plane whose changes the message is about.
/// @return nothing where the state is no minimum.
std::optional<GroundMessage> ground_message(const VehiclePosterior& posterior,
                                            const VehicleState& state, int view,
                                            const UncertainPlane& reference);

/// One vehicle among several on a shared ground.
struct GroundNode {
  std::vector<Eigen::Index> rows;  ///< first row of each of its planes in the joint covariance
  std::size_t lead = 0;            ///< the plane that its message is about
  std::optional<GroundMessage> message;  ///< nothing: it takes the others' messages only
};

/// Mean and covariance of a vehicle's planes, 3 rows each, and the log scale, by the joint prior
/// and the messages of all other vehicles.
struct GroundCavity {
  Eigen::VectorXd mean;
  Eigen::MatrixXd covariance;
};

struct GroundPropagation {
  std::vector<GroundCavity> cavities;  ///< one a node
  std::vector<double> weights;         ///< robust, of each message, in (0, 1]; 0: no message
  /// Squared Mahalanobis distance of each message from its cavity; 0: no message.
  std::vector<double> squared_distances;
};

/// One round of expectation propagation over the ground planes (Minka, UAI 2001).
/// @param covariance  joint prior of all planes (3 rows each), mean 0; its last row the log scale.
/// @param gate        standard deviations from which on a message is down-weighted.
GroundPropagation propagate(const Eigen::MatrixXd& covariance, const std::vector<GroundNode>& nodes,
                            double gate);

}  // namespace camber::internal
