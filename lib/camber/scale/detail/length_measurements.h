#pragma once

// What the sources that measure lengths on the ground share: an iterated Kalman update of the
// metric inverse depths at their pixels (Bell and Cathey, "The Iterated Kalman Filter Update as a
// Gauss-Newton Method", IEEE TAC 1993).

#include <Eigen/Core>
#include <functional>
#include <vector>

#include "camber/geometry/pinhole_camera.h"
#include "camber/road/road_posterior.h"

namespace camber::detail {

/// Measurements of metric inverse depths, linearised at some.
struct LinearisedLengths {
  Eigen::MatrixXd by_inverse_depth;  // a row a measurement
  Eigen::VectorXd residual;          // measured minus predicted
  Eigen::MatrixXd covariance;
};

/// The ground at the pixels that a source uses, as the road knows it before.
struct GroundAtPixels {
  GroundAtPixels(const RoadPosterior& road, const PinholeCamera& camera,
                 std::vector<Eigen::Vector2d> at);

  Eigen::Index size() const { return mean.size(); }
  /// m, camera frame, for other inverse depths than the mean's.
  Eigen::Vector3d point(const Eigen::VectorXd& inverse_depths, Eigen::Index i) const {
    return rays.col(i) / inverse_depths[i];
  }

  std::vector<Eigen::Vector2d> pixels;
  Eigen::Matrix3Xd rays;                              // z = 1
  Eigen::VectorXd mean;                               // metric inverse depths
  Eigen::Matrix<double, Eigen::Dynamic, 2> by_pixel;  // d(inverse depth) / d(pixel)
  Eigen::MatrixXd covariance;
};

/// Inverse depths once lengths are known.
struct UpdatedDepths {
  Eigen::VectorXd mean;
  Eigen::MatrixXd covariance;
};

/// Iterated update; it stops where a step would leave a quarter of an inverse depth.
/// @param linearise  the measurements around given inverse depths.
UpdatedDepths updated(const GroundAtPixels& ground,
                      const std::function<LinearisedLengths(const Eigen::VectorXd&)>& linearise);

/// Mean square of the residuals, in standard deviations, with and without the ground's own spread.
double mean_squared_innovation(const LinearisedLengths& lengths, const Eigen::MatrixXd& prior);

/// Accepted lengths as a constraint around the ground before, with how well they fit.
struct SolvedLengths {
  Constraint constraint;       ///< without name and source
  double misfit_before = 0.0;  ///< mean squared innovation, variances
  double misfit_after = 0.0;   ///< mean squared residual, variances
};

/// @param linearise  the accepted lengths, at any inverse depths
/// @param solution   the inverse depths once they are known
SolvedLengths solved(const GroundAtPixels& ground,
                     const std::function<LinearisedLengths(const Eigen::VectorXd&)>& linearise,
                     const Eigen::VectorXd& solution);

}  // namespace camber::detail
