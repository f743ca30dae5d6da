#pragma once

#include <Eigen/Core>
#include <vector>

#include "camber/geometry/pinhole_camera.h"
#include "camber/geometry/se3.h"

namespace camber {

/// One point of the reference image seen in another: z = pi(R ray + rho t) + noise, pixels.
struct BundleObservation {
  int point = 0;          ///< index into the points
  int view = 0;           ///< index into the views
  Eigen::Vector2d pixel;  ///< z
};

/// Few views, many points that hang on viewing rays of one reference image: each point has one
/// unknown, which is eliminated in closed form (Triggs, McLauchlan, Hartley, Fitzgibbon, "Bundle
/// Adjustment - A Modern Synthesis", 2000, section 6.1), so that a step costs one pass over the
/// observations and a system of 6 unknowns a view.
struct BundleProblem {
  PinholeCamera camera;
  std::vector<Eigen::Vector3d> rays;            ///< one a point, z = 1, reference camera frame
  std::vector<BundleObservation> observations;  ///< sorted by point
  double cauchy = 1.5;                          ///< scale of the loss, standard deviations, > 0
  int num_threads = 0;                          ///< <= 0: see resolve_num_threads
};

/// The normal equations of the views with the depths eliminated. A view's six unknowns: rotation
/// vector applied on the left (rad), translation.
struct ReducedBundle {
  Eigen::MatrixXd information;  ///< 6 views square, without the gauge: the scale is open
  Eigen::VectorXd gradient;     ///< of half the cost
  double cost = 0.0;            ///< sum of the Cauchy losses
};

/// @param sigma_px  standard deviation of a coordinate, > 0.
ReducedBundle reduce_bundle(const BundleProblem& problem, const std::vector<SE3>& views,
                            const std::vector<double>& inverse_depths, double sigma_px);

/// Differences between the projections and the observations, px, one column an observation; NaN for
/// a point behind the camera.
Eigen::Matrix2Xd bundle_residuals(const BundleProblem& problem, const std::vector<SE3>& views,
                                  const std::vector<double>& inverse_depths);

/// Levenberg-Marquardt over views and inverse depths, reweighted by the Cauchy loss; the baseline
/// of `longest` keeps its length. The same result for any number of threads.
/// @return false if nothing could be improved because the start is unusable (no finite cost).
bool solve_bundle(const BundleProblem& problem, std::size_t longest, double sigma_px,
                  std::vector<SE3>& views, std::vector<double>& inverse_depths);

}  // namespace camber
