#pragma once

#include <Eigen/Core>
#include <memory>
#include <string>
#include <vector>

#include "camber/geometry/plane.h"
#include "camber/road/constraint.h"
#include "camber/road/ground_field.h"

namespace camber {

/// The tangent plane of the road under the camera, up to scale, as it is estimated from the road
/// ahead.
struct EgoPlaneEstimate {
  UncertainPlane plane;  ///< centroid: the foot below the camera
  /// d(tilt, tilt, height) / d(shared parameters) of the ground field: errors of the motion.
  Eigen::Matrix<double, 3, Eigen::Dynamic> shared_jacobian;
};

/// Linear functions of the metric road: a column each. See RoadPosterior::covariance.
struct RoadFunctionals {
  Eigen::MatrixXd of_state;  ///< rows as the posterior's state
};

/// The field's shared parameters (the motion) given all constraints, and the scale with them.
struct SharedEstimate {
  Eigen::VectorXd change;  ///< against the motion that the field was made with
  /// Of the shared parameters and, last, of the logarithm of the scale.
  Eigen::MatrixXd covariance;
  /// What of it an error explains that all windows of one camera share: an outer product each.
  std::vector<CommonError> common;
};

/// Everything that is known of where the road lies, as one Gaussian: the inverse depths of the
/// ground field, the ego plane and the logarithm of the scale, with their joint covariance. Planes,
/// clouds, the scale and their covariances are views of it.
///
/// Constraints condition it (Kalman update); the covariance is that of the field, less a product of
/// low rank for each update, so that joint covariances of any functions cost one solution of the
/// field's system for each function. Values of another conditioned copy share the field.
class RoadPosterior {
 public:
  /// @param field              of the ground ahead, up to scale.
  /// @param shared_covariance  of the field's shared parameters (the motion).
  /// @param inflation          factor on the field's covariance, >= 1: errors that whole stretches
  ///                           of road share (moving shadows, reflections).
  /// @param log_scale_sigma    of the logarithm of metres_per_baseline, before any constraint.
  RoadPosterior(std::shared_ptr<const GroundField> field, Eigen::MatrixXd shared_covariance,
                double inflation, EgoPlaneEstimate ego, double metres_per_baseline,
                double log_scale_sigma);

  /// The posterior once a constraint, linearised at this one's mean, is known too.
  RoadPosterior conditioned(const Constraint& constraint) const;

  /// The same road with another independent error of the logarithm of its scale.
  RoadPosterior with_wider_scale(double variance) const;

  /// Squared Mahalanobis distance of a constraint's residual, from this posterior and its noise.
  double squared_innovation(const Constraint& constraint) const;

  /// A constraint linearised at another posterior of the same field, at this one's mean.
  Constraint relinearised(const Constraint& constraint, const RoadPosterior& linearised_at) const;

  double metres_per_baseline() const;
  double scale_sigma() const;  ///< standard deviation of the logarithm of the scale

  /// Metric inverse depth of the ground at a pixel, 1/m; <= 0: the sky.
  double inverse_depth(const Eigen::Vector2d& pixel) const;
  /// The same at the pixels 0 to count - 1 of a row.
  void inverse_depths(double row, int count, float* out) const;
  /// See GroundField::observed.
  double observed(const Eigen::Vector2d& pixel) const { return field_->observed(pixel); }
  double top() const { return field_->top(); }
  const GroundField& field() const { return *field_; }
  const Eigen::MatrixXd& shared_covariance() const { return shared_covariance_; }
  SharedEstimate shared() const;

  /// The ego plane, m, with its own covariance.
  UncertainPlane ego() const;

  /// Functions of the metric inverse depths: row k of `coefficients` weighs those at the pixels.
  RoadFunctionals of_inverse_depths(const std::vector<Eigen::Vector2d>& pixels,
                                    const Eigen::MatrixXd& coefficients) const;
  /// The ego plane's (tilt, tilt, height), rad and m.
  RoadFunctionals of_ego() const;
  /// The logarithm of the scale.
  RoadFunctionals of_log_scale() const;
  /// The measurements of a constraint.
  RoadFunctionals of_constraint(const Constraint& constraint) const;

  /// Joint covariance of functions.
  Eigen::MatrixXd covariance(const RoadFunctionals& functionals) const;
  /// Its diagonal alone.
  Eigen::VectorXd variances(const RoadFunctionals& functionals) const;
  Eigen::MatrixXd covariance(const RoadFunctionals& rows, const RoadFunctionals& columns) const;

 private:
  Eigen::MatrixXd covariance_times(const Eigen::MatrixXd& of_state) const;

  /// One update: covariance before times functions, and the inverse of the innovation's covariance.
  struct Update {
    Eigen::MatrixXd gain_side, information;
    Eigen::MatrixXd of_shared;  // covariance of the shared parameters with the functions
  };
  Eigen::MatrixXd shared_covariance_with(const Eigen::MatrixXd& of_state) const;

  /// What the mean is off by one standard deviation of an error that all windows share.
  struct CommonEffect {
    std::string name;
    Eigen::VectorXd of_state, of_shared;
  };

  std::shared_ptr<const GroundField> field_;
  Eigen::MatrixXd shared_covariance_;
  double inflation_ = 1.0;
  EgoPlaneEstimate ego_;
  double log_scale_variance_ = 0.0;
  // Mean: changes of the nodes and of the ego plane against the field's and the estimate's; the
  // scale itself.
  Eigen::VectorXd node_change_;
  Eigen::VectorXd metric_nodes_;  // (nodes + change) / scale
  Eigen::Vector3d ego_change_ = Eigen::Vector3d::Zero();
  double log_scale_ = 0.0;
  Eigen::VectorXd shared_change_;
  std::vector<std::shared_ptr<const Update>> updates_;
  std::vector<CommonEffect> common_;
};

/// Functions side by side.
RoadFunctionals joined(const std::vector<RoadFunctionals>& parts);

}  // namespace camber
