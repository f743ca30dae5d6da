#pragma once

#include <Eigen/Core>

namespace camber {

/// What one vehicle measures of the ground plane that it stands on and of the metric scale, as a
/// normal distribution in information form. Rows: tilt about the plane's axis1, tilt about axis2
/// (rad), height at its centroid (m), as changes of a support plane; logarithm of the factor on the
/// cameras' baselines. It may lack rank: a single view measures no scale.
struct GroundMessage {
  Eigen::Matrix4d information = Eigen::Matrix4d::Zero();
  Eigen::Vector4d information_vector = Eigen::Vector4d::Zero();  ///< information * mean
};

}  // namespace camber
