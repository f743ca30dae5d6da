#pragma once

// The posterior of one vehicle in one or more views: a pose for each view, one size, one shape, and
// the scale of the cameras' baselines.

#include <optional>
#include <vector>

#include "camber/vehicle/detail/box_likelihood.h"
#include "camber/vehicle/detail/ground_contact.h"
#include "camber/vehicle/detail/keypoint_likelihood.h"
#include "camber/vehicle/detail/motion_prior.h"
#include "camber/vehicle/detail/registration_likelihood.h"
#include "camber/vehicle/detail/size_shape_prior.h"
#include "camber/vehicle/detail/vehicle_state.h"
#include "camber/vehicle/fit_vehicle.h"

namespace camber::internal {

/// One view of a vehicle. Referred to while a posterior is made.
struct PosteriorView {
  const VehicleDetection* detection = nullptr;
  const SupportPlane* support = nullptr;
  ViewCamera camera;
};

/// Normal equations of all parameters; from two views on the shape errors are eliminated.
struct PosteriorEquations : NormalEquations {
  // errors = -(errors_at + errors_by * step) for a step of the parameters; 3 rows a keypoint.
  Eigen::MatrixXd errors_by;
  Eigen::VectorXd errors_at;
  double errors_log_determinant = 0.0;
};

/// Sources that know nothing of the keypoints.
enum class EvidenceSource { kPlanes, kRegistration };

class VehiclePosterior {
 public:
  /// @param vehicle_class  whose prior all views share.
  /// @param scale_sigma    of the logarithm of the baselines' scale.
  VehiclePosterior(const PinholeCamera& camera, const std::vector<PosteriorView>& views,
                   const std::string& vehicle_class, const VehicleFitOptions& options,
                   int num_coefficients, double scale_sigma);
  /// Of one view.
  VehiclePosterior(const PinholeCamera& camera, const VehicleDetection& detection,
                   const SupportPlane& support, const VehicleFitOptions& options,
                   int num_coefficients);

  const PinholeCamera& camera() const { return camera_; }
  const VehicleNoise& noise() const { return noise_; }
  const Body& body() const { return body_; }
  const ParameterLayout& layout() const { return layout_; }
  int num_views() const { return layout_.num_views; }
  int num_coefficients() const { return layout_.num_coefficients; }
  Eigen::Vector3d mean_size() const { return prior_.mean_size(); }
  KeypointLikelihood& keypoints(int view) { return keypoints_[index(view)]; }
  const KeypointLikelihood& keypoints(int view) const { return keypoints_[index(view)]; }
  const BoxLikelihood& box(int view) const { return boxes_[index(view)]; }
  const GroundContact& contact(int view) const { return contacts_[index(view)]; }
  const MotionPrior& motion() const { return motion_; }
  double scale_mean() const { return scale_mean_; }
  double scale_variance() const { return scale_variance_; }

  void set_registration(RegistrationLikelihood registration) {
    registration_ = std::move(registration);
  }
  void set_plane(int view, const UncertainPlane& plane) { contacts_[index(view)].set_plane(plane); }
  void set_scale(double mean, double variance) {
    scale_mean_ = mean;
    scale_variance_ = variance;
  }

  /// The mean vehicle, poses at the origin.
  VehicleState mean_state() const;
  BodyView view(int view, const VehicleState& state) const {
    return {body_, camera_, state.poses[index(view)], state.form};
  }
  /// KeypointLikelihood::update_visibility of all views.
  void update_visibility(const VehicleState& state);

  /// Minus log posterior; infinity where the body is not in front of a camera.
  /// @param observed  as KeypointLikelihood::add takes it.
  double evaluate(const VehicleState& state, PosteriorEquations* equations,
                  bool observed = false) const;

  /// The part of evaluate()'s normal equations that one source alone gives.
  NormalEquations equations_of(EvidenceSource source, const VehicleState& state) const;

  /// Moved by a step of all parameters; the shape errors stay.
  VehicleState moved(const VehicleState& state, const Eigen::VectorXd& step) const;
  /// A step without turns of more than 0.3 rad, which leave the range of the linear model.
  Eigen::VectorXd limited(const Eigen::VectorXd& step) const;

  /// Gradient, by poses and size, of half the log determinant of the coefficients' information:
  /// what integrating them out adds to the gradient of the minus log posterior (0 for the other
  /// parameters). The coefficients are shares of the size, so each that the keypoints measure is
  /// known to depth over size: at the joint maximum of pose and shape a vehicle is too near and too
  /// large.
  /// @param equations  of evaluate() at the state.
  Eigen::VectorXd shape_marginal_gradient(const VehicleState& state,
                                          const PosteriorEquations& equations) const;

  /// Covariance of one view's own parameters (pose, size, coefficients) out of that of all.
  Eigen::MatrixXd view_covariance(int view, const Eigen::MatrixXd& all) const;

  /// Minus log evidence of a hypothesis (Laplace), up to what all hypotheses share; infinity where
  /// the state is no minimum.
  double minus_log_evidence(const VehicleState& state) const;

 private:
  static std::size_t index(int view) { return static_cast<std::size_t>(view); }
  double error_weight(int keypoint) const;
  /// Adds the contacts' cost, optionally with their normal equations.
  double add_contacts(const VehicleState& state, NormalEquations* equations) const;
  void eliminate_errors(const VehicleState& state, const std::vector<ShapeErrorEquations>& terms,
                        PosteriorEquations* equations) const;

  PinholeCamera camera_;
  VehicleNoise noise_;
  SizeShapePrior prior_;
  Body body_;
  ParameterLayout layout_;
  std::array<double, kNumKeypoints> shape_variance_;  // m^2
  std::vector<KeypointLikelihood> keypoints_;         // one a view
  std::vector<BoxLikelihood> boxes_;
  std::vector<GroundContact> contacts_;
  MotionPrior motion_;
  RegistrationLikelihood registration_;
  double scale_mean_ = 0.0, scale_variance_;
};

}  // namespace camber::internal
