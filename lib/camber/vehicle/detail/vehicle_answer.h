#pragma once

// From a state of the posterior to a VehicleEstimate with its covariance, status and reason.

#include <string>

#include "camber/vehicle/detail/vehicle_posterior.h"

namespace camber::internal {

// Reasons of weak answers that more planes and views do not undo.
inline constexpr char kTwoHeadings[] = "two headings fit alike";
inline constexpr char kSidesSwapped[] = "the keypoints' left and right are swapped";

using ReportCovariance = Eigen::Matrix<double, 9, 9>;

/// d(centre of the box, rotation vector in the vehicle's frame, length, height, width) /
/// d(parameters of a view).
Eigen::MatrixXd report_jacobian(const ViewPose& pose, const Form& form, Eigen::Index parameters);

/// Covariance of what is reported, from that of a view's parameters; the centre with what the prior
/// does not know of it.
ReportCovariance report_covariance(const ViewPose& pose, const Form& form,
                                   const Eigen::MatrixXd& covariance, const FormNoise& noise);

void write_pose_and_form(const VehiclePrior& prior, const ViewPose& pose, const Form& form,
                         VehicleEstimate* out);

/// Whether enough keypoints of a view are where the state has them.
bool keypoints_agree(const VehiclePosterior& posterior, int view, const VehicleState& state);

/// Why the keypoints' answer in one view is not reliable; empty if it is.
std::string unreliable_reason(const VehiclePosterior& posterior, int view,
                              const VehicleState& state, const Box2& box);

/// The state's mean once the shape is integrated out, and the covariance of all parameters.
struct PosteriorMean {
  VehicleState state;
  Eigen::MatrixXd covariance;
  Eigen::MatrixXd information;  ///< its inverse
  /// What all parameters change by where the planes of all views are raised by what their
  /// covariances leave out: an error that is not in `covariance`.
  Eigen::VectorXd raised;
  /// add_contradictions(): a column a source; nor are these in `covariance`.
  Eigen::MatrixXd contradictions;
  bool minimum = false;  ///< false: the second derivatives are not positive definite
};
PosteriorMean posterior_mean(const VehiclePosterior& posterior, const VehicleState& state);

/// What the planes and the registration ask for against the rest of the evidence: the change of all
/// parameters without the source, from none of it where both agree to all where they contradict
/// each other (AnswerGates).
/// @param state  that the mean is of.
void add_contradictions(const VehiclePosterior& posterior, const VehicleState& state,
                        PosteriorMean* mean);

/// Covariance of a view's own parameters (VehiclePosterior::view_covariance), with `raised` and
/// `contradictions`.
Eigen::MatrixXd stated_covariance(const VehiclePosterior& posterior, int view,
                                  const PosteriorMean& mean);

/// Writes a reliable answer with its covariance and status.
/// @param rival  cost of the best other heading above this one's.
void write_answer(const VehiclePosterior& posterior, int view, const VehiclePrior& prior,
                  const PosteriorMean& mean, double rival, VehicleEstimate* out);

/// What the support plane's own status means for the answer, the plane's height deviation there,
/// and kFailed for an answer that is not finite.
void finish_answer(const SupportPlane& support, VehicleEstimate* out);

}  // namespace camber::internal
