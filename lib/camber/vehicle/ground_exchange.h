#pragma once

// Inside of fit_tracks, not installed interface: what vehicles tell each other of their ground.

#include <Eigen/Core>
#include <optional>
#include <vector>

namespace camber::internal {

/// How a vehicle stands on its plane: e = M theta + error for a plane error theta (tilt, tilt,
/// height).
struct StanceTerms {
  Eigen::Vector3d value, variance;      ///< e; of the error
  Eigen::Matrix<double, 3, 6> by_pose;  ///< de / d(translation, rotation)
  Eigen::Matrix3d by_plane;             ///< M
};

/// A normal distribution of (tilt, tilt, height) of a plane and the log scale, in information form.
struct GroundMessage {
  Eigen::Matrix4d information = Eigen::Matrix4d::Zero();
  Eigen::Vector4d pull = Eigen::Vector4d::Zero();  ///< information * mean
};

/// What is known of (plane, log scale) from a vehicle's normal equations without their priors: all
/// other parameters are eliminated.
/// @param pose_at   of the pose that stands on the plane, among the parameters; the last of them is
///                  the log scale.
/// @return changes from where the normal equations were formed; nothing if they are not positive.
std::optional<GroundMessage> ground_message(const Eigen::MatrixXd& hessian,
                                            const Eigen::VectorXd& gradient, Eigen::Index pose_at,
                                            const StanceTerms& stance);

/// One vehicle among several on a shared ground.
struct GroundSpeaker {
  std::vector<Eigen::Index> rows;     ///< first row of each of its planes in the joint covariance
  std::size_t lead = 0;               ///< the plane that it speaks of
  std::optional<GroundMessage> said;  ///< nothing: it only listens
};

/// Mean and covariance of a vehicle's planes, 3 rows each, and the log scale.
struct GroundPrior {
  Eigen::VectorXd mean;
  Eigen::MatrixXd covariance;
};

/// What each vehicle's planes and the scale are by the joint prior (mean 0, `covariance`, its last
/// row the log scale) and by what the others said. What the rest contradicts by far counts less.
std::vector<GroundPrior> exchange_messages(const Eigen::MatrixXd& covariance,
                                           const std::vector<GroundSpeaker>& speakers);

}  // namespace camber::internal
