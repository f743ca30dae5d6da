#include "camber/vehicle/detail/vehicle_answer.h"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "camber/vehicle/detail/box_likelihood.h"
#include "camber/vehicle/detail/linear_algebra.h"

namespace camber::internal {

Eigen::MatrixXd report_jacobian(const ViewPose& pose, const Form& form, Eigen::Index parameters) {
  Eigen::MatrixXd j = Eigen::MatrixXd::Zero(9, parameters);
  j.block<3, 3>(0, 0).setIdentity();
  const Eigen::Vector3d middle(0.0, 0.5 * form.size[2], 0.0);
  j.block<3, 3>(0, 3) = -pose.rotation * skew(middle);
  j.block<3, 1>(0, 8) = 0.5 * pose.rotation.col(1);
  j.block<3, 3>(3, 3).setIdentity();
  j(6, 6) = j(7, 8) = j(8, 7) = 1.0;  // length, width, height to length, height, width
  return j;
}

ReportCovariance report_covariance(const ViewPose& pose, const Form& form,
                                   const Eigen::MatrixXd& covariance, const FormNoise& noise) {
  const Eigen::MatrixXd j = report_jacobian(pose, form, covariance.cols());
  ReportCovariance out = product(product(j, covariance), j.transpose());
  const Eigen::Vector3d margins = noise.centre_share * form.along_axes();
  out.topLeftCorner<3, 3>() +=
      pose.rotation * margins.cwiseAbs2().asDiagonal() * pose.rotation.transpose();
  return out;
}

void write_pose_and_form(const VehiclePrior& prior, const ViewPose& pose, const Form& form,
                         VehicleEstimate* out) {
  out->pose.camera_from_vehicle = SE3(pose.rotation, pose.translation);
  out->pose.dimensions = {form.size[0], form.size[1], form.size[2]};
  out->shape.assign(form.shape.data(), form.shape.data() + form.shape.size());
  const ShapePrior& shape = prior.shape(out->vehicle_class);
  const KeypointMatrix keypoints = shape.keypoints(out->pose.dimensions, out->shape);
  for (int i = 0; i < kNumKeypoints; ++i) {
    out->keypoints[static_cast<std::size_t>(i)] =
        pose.rotation * keypoints.col(i) + pose.translation;
  }
}

bool keypoints_agree(const VehiclePosterior& posterior, int view, const VehicleState& state) {
  const AnswerGates& gates = posterior.noise().answer;
  const KeypointLikelihood& keypoints = posterior.keypoints(view);
  const auto count = static_cast<double>(keypoints.points().size());
  return keypoints.agreement(posterior.view(view, state)).count >=
         std::max(gates.agreeing_keypoints, gates.agreeing_share * count);
}

std::string unreliable_reason(const VehiclePosterior& posterior, int view,
                              const VehicleState& state, const Box2& box) {
  if (!keypoints_agree(posterior, view, state)) return "too few keypoints agree";
  const AnswerGates& gates = posterior.noise().answer;
  const PinholeCamera& camera = posterior.camera();
  const BodyView at = posterior.view(view, state);
  if ((state.form.size.array() < gates.least_size * posterior.mean_size().array()).any()) {
    return "the keypoints ask for too small a vehicle";
  }
  if (at.in_front() &&
      intersection_over_union(outline(at).clipped(camera.width, camera.height),
                              box.clipped(camera.width, camera.height)) < gates.box_overlap) {
    return "the keypoints do not fit the box";
  }
  return "";
}

namespace {

/// What is compared is the distance along the viewing ray, which the keypoints leave open most: the
/// variance of the change is that without the source less that with it.
Eigen::VectorXd contradiction_of(EvidenceSource source, const VehiclePosterior& posterior,
                                 const VehicleState& state, const PosteriorMean& mean) {
  const NormalEquations own = posterior.equations_of(source, state);
  Eigen::VectorXd change = Eigen::VectorXd::Zero(own.gradient.size());
  if (own.hessian.isZero()) return change;
  const SymmetricFactors rest(mean.information - own.hessian);
  if (!rest.positive()) return change;
  change = rest.solve(own.gradient);
  double most = 0.0;  // standard deviations
  for (int k = 0; k < posterior.num_views(); ++k) {
    const int at = posterior.layout().pose(k);
    Eigen::VectorXd ray = Eigen::VectorXd::Zero(change.size());
    ray.segment<3>(at) = state.poses[static_cast<std::size_t>(k)].translation.normalized();
    const double variance = ray.dot(rest.solve(ray)) - ray.dot(mean.covariance * ray);
    if (variance > 0.0) most = std::max(most, std::abs(ray.dot(change)) / std::sqrt(variance));
  }
  const AnswerGates& gates = posterior.noise().answer;
  return std::clamp((most - gates.source_agrees) / (gates.source_contradicts - gates.source_agrees),
                    0.0, 1.0) *
         change;
}

}  // namespace

PosteriorMean posterior_mean(const VehiclePosterior& posterior, const VehicleState& state) {
  PosteriorMean out;
  out.state = state;
  PosteriorEquations equations;
  if (!std::isfinite(posterior.evaluate(state, &equations, /*observed=*/true))) return out;
  const SymmetricFactors factors(equations.hessian);
  out.minimum = factors.positive();
  out.covariance = factors.inverse();
  out.information = equations.hessian;
  const Eigen::VectorXd gradient = posterior.shape_marginal_gradient(state, equations);
  out.state = posterior.moved(state, -out.covariance * gradient);
  Eigen::VectorXd gradient_change = Eigen::VectorXd::Zero(posterior.layout().total());
  for (int k = 0; k < posterior.num_views(); ++k) {
    gradient_change.segment<kPoseParameters>(posterior.layout().pose(k)) =
        posterior.contact(k).gradient_by_unmodelled(out.state.poses[static_cast<std::size_t>(k)]);
  }
  out.raised = out.covariance * gradient_change;
  return out;
}

void add_contradictions(const VehiclePosterior& posterior, const VehicleState& state,
                        PosteriorMean* mean) {
  if (!mean->minimum) return;
  mean->contradictions.resize(posterior.layout().total(), 2);
  mean->contradictions << contradiction_of(EvidenceSource::kPlanes, posterior, state, *mean),
      contradiction_of(EvidenceSource::kRegistration, posterior, state, *mean);
}

Eigen::MatrixXd stated_covariance(const VehiclePosterior& posterior, int view,
                                  const PosteriorMean& mean) {
  Eigen::MatrixXd all = mean.covariance + mean.raised * mean.raised.transpose();
  if (mean.contradictions.size() > 0) add_square(mean.contradictions, &all);
  return posterior.view_covariance(view, all);
}

void write_answer(const VehiclePosterior& posterior, int view, const VehiclePrior& prior,
                  const PosteriorMean& mean, double rival, VehicleEstimate* out) {
  const VehicleState& state = mean.state;
  const ViewPose& pose = state.poses[static_cast<std::size_t>(view)];
  const VehicleNoise& noise = posterior.noise();
  const GroundContact& contact = posterior.contact(view);
  write_pose_and_form(prior, pose, state.form, out);
  out->covariance =
      report_covariance(pose, state.form, stated_covariance(posterior, view, mean), noise.form);
  const Eigen::Matrix3d place = out->covariance.topLeftCorner<3, 3>();
  const int at = posterior.layout().pose(view);
  const PoseMatrix covariance = mean.covariance.block<kPoseParameters, kPoseParameters>(at, at);
  out->plane = contact.posterior_plane(pose, covariance, mean.raised.segment<kPoseParameters>(at),
                                       place, &out->plane_sigma_height);
  out->reprojection_rmse_px =
      posterior.keypoints(view).agreement(posterior.view(view, state)).rmse_px;
  out->status = Status::kOk;
  out->reason.clear();
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> spread(place, Eigen::EigenvaluesOnly);
  const double sigma = std::sqrt(std::max(spread.eigenvalues().maxCoeff(), 0.0));
  const double contradiction = noise.contact.contradiction * noise.contact.contradiction;
  if (rival < noise.hypotheses.rival_heading) {
    out->status = Status::kWeak;
    out->reason = kTwoHeadings;
  } else if (contact.squared_distance(pose) > contradiction) {
    out->status = Status::kWeak;
    out->reason = "the keypoints contradict the plane";
  } else if (sigma > noise.answer.relative_sigma * pose.translation.norm()) {
    out->status = Status::kWeak;
    out->reason = fmt::format("position known to {:.1f} m only", sigma);
  }
}

void finish_answer(const SupportPlane& support, VehicleEstimate* out) {
  if (support.status == Status::kNotObservable || support.status == Status::kFailed) {
    out->status = Status::kNotObservable;
    if (out->reason.empty()) out->reason = "the plane below it is not observable";
  } else if (support.status == Status::kWeak && out->status == Status::kOk) {
    out->status = Status::kWeak;
    out->reason = "the plane below it is weak";
  }
  if (!std::isfinite(out->plane_sigma_height)) {
    out->plane_sigma_height =
        std::sqrt(std::max(support.plane.height_variance(out->pose.bottom_center()), 0.0));
  }
  if (!out->covariance.allFinite() || !out->pose.bottom_center().allFinite()) {
    out->status = Status::kFailed;
    out->reason = "the fit did not converge";
  }
}

}  // namespace camber::internal
