#include "camber/vehicle/detail/vehicle_posterior.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>

#include "camber/vehicle/detail/linear_algebra.h"

namespace camber::internal {

namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

const VehiclePrior& prior_of(const VehicleFitOptions& options) {
  return options.prior ? *options.prior : shipped_vehicle_prior();
}

int available(const VehiclePrior& prior, const std::string& vehicle_class, int num_coefficients) {
  return std::min(
      {num_coefficients, prior.shape(vehicle_class).num_coefficients(), kMaxCoefficients});
}

/// Variance of the shape errors that no coefficient explains, m^2, each axis.
std::array<double, kNumKeypoints> residual_variance(const ShapePrior& prior, int num_coefficients) {
  const Eigen::Matrix<double, 3, kNumSideKeypoints> left = prior.residual_sigma(num_coefficients);
  std::array<double, kNumKeypoints> out;
  for (std::size_t i = 0; i < out.size(); ++i) {
    out[i] = left.col(static_cast<int>(i) % kNumSideKeypoints).squaredNorm() / 3.0;
  }
  return out;
}

std::vector<ViewCamera> cameras_of(const std::vector<PosteriorView>& views) {
  std::vector<ViewCamera> out;
  for (const PosteriorView& v : views) out.push_back(v.camera);
  return out;
}

}  // namespace

VehiclePosterior::VehiclePosterior(const PinholeCamera& camera,
                                   const std::vector<PosteriorView>& views,
                                   const std::string& vehicle_class,
                                   const VehicleFitOptions& options, int num_coefficients,
                                   double scale_sigma)
    : camera_(camera),
      noise_(options.noise),
      prior_(prior_of(options), vehicle_class,
             available(prior_of(options), vehicle_class, num_coefficients)),
      body_(prior_of(options).shape(vehicle_class), prior_.num_coefficients(),
            prior_of(options).has_shape(vehicle_class)),
      shape_variance_(
          residual_variance(prior_of(options).shape(vehicle_class), prior_.num_coefficients())),
      motion_(cameras_of(views), options.noise.motion),
      scale_variance_(scale_sigma * scale_sigma) {
  layout_.num_views = static_cast<int>(views.size());
  layout_.num_coefficients = prior_.num_coefficients();
  for (const PosteriorView& v : views) {
    boxes_.emplace_back(camera, v.detection->box, noise_.box, layout_.num_views);
    keypoints_.emplace_back(camera, *v.detection, options.keypoint_set, noise_.keypoint,
                            shape_variance_, prior_.mean_size(), boxes_.back().cuts());
    // Views of one vehicle share its plane, which counts once over all of them.
    contacts_.emplace_back(*v.support, noise_.contact, options.plane_is_exact,
                           1.0 / layout_.num_views);
  }
}

VehiclePosterior::VehiclePosterior(const PinholeCamera& camera, const VehicleDetection& detection,
                                   const SupportPlane& support, const VehicleFitOptions& options,
                                   int num_coefficients)
    : VehiclePosterior(camera, {{&detection, &support, {}}}, detection.vehicle_class, options,
                       num_coefficients, /*scale_sigma=*/1.0) {}

VehicleState VehiclePosterior::mean_state() const {
  VehicleState out;
  out.poses.resize(keypoints_.size());
  out.form = prior_.mean();
  return out;
}

void VehiclePosterior::update_visibility(const VehicleState& state) {
  for (int k = 0; k < num_views(); ++k) keypoints(k).update_visibility(view(k, state));
}

double VehiclePosterior::evaluate(const VehicleState& state, PosteriorEquations* equations,
                                  bool observed) const {
  const int views = num_views(), form = layout_.num_form();
  if (equations) equations->set_zero(layout_.total());
  // One view's shape errors are integrated out exactly.
  const ShapeErrors* errors = views > 1 ? &state.errors : nullptr;
  std::vector<ShapeErrorEquations> error_terms(equations && errors ? keypoints_.size() : 0);
  double cost = 0.0;
  NormalEquations own;  // of one view
  for (int k = 0; k < views; ++k) {
    const BodyView at = view(k, state);
    if (!at.in_front()) return kInfinity;
    ShapeErrorEquations* own_errors = error_terms.empty() ? nullptr : &error_terms[index(k)];
    if (equations) own.set_zero(body_.num_parameters());
    if (own_errors) own_errors->set_zero(body_.num_parameters());
    cost += keypoints(k).add(at, errors, observed, equations ? &own : nullptr, own_errors);
    cost += box(k).add(at, equations ? &own : nullptr);
    if (!equations) continue;
    scatter(own.hessian, own.gradient,
            {{layout_.pose(k), 0, kPoseParameters}, {layout_.size(), kPoseParameters, form}},
            equations);
  }
  cost += add_contacts(state, equations);
  cost += prior_.add(state.form, layout_.size(), equations);
  const double scale_off = state.log_scale - scale_mean_;
  cost += 0.5 * scale_off * scale_off / scale_variance_;
  if (equations) {
    equations->hessian(layout_.scale(), layout_.scale()) += 1.0 / scale_variance_;
    equations->gradient[layout_.scale()] += scale_off / scale_variance_;
  }
  cost += motion_.add(state, layout_, equations);
  const std::optional<double> registered = registration_.add(state, layout_, equations);
  if (!registered) return kInfinity;
  cost += *registered;
  if (errors) {
    for (int i = 0; i < kNumKeypoints; ++i) {
      cost += 0.5 * error_weight(i) * errors->col(i).squaredNorm();
    }
  }
  if (!error_terms.empty()) eliminate_errors(state, error_terms, equations);
  return cost;
}

double VehiclePosterior::add_contacts(const VehicleState& state, NormalEquations* equations) const {
  double cost = 0.0;
  PoseMatrix hessian;
  PoseVector gradient;
  for (int k = 0; k < num_views(); ++k) {
    cost += contact(k).evaluate(state.poses[index(k)], equations ? &hessian : nullptr, &gradient);
    if (!equations) continue;
    const int at = layout_.pose(k);
    equations->hessian.block<kPoseParameters, kPoseParameters>(at, at) += hessian;
    equations->gradient.segment<kPoseParameters>(at) += gradient;
  }
  return cost;
}

NormalEquations VehiclePosterior::equations_of(EvidenceSource source,
                                               const VehicleState& state) const {
  NormalEquations out;
  out.set_zero(layout_.total());
  if (source == EvidenceSource::kPlanes) {
    add_contacts(state, &out);
  } else {
    registration_.add(state, layout_, &out);
  }
  return out;
}

VehicleState VehiclePosterior::moved(const VehicleState& state, const Eigen::VectorXd& step) const {
  VehicleState out = state;
  for (int k = 0; k < num_views(); ++k) {
    ViewPose& pose = out.poses[index(k)];
    pose = pose.moved(step.segment<kPoseParameters>(layout_.pose(k)));
  }
  out.form.size += step.segment<kSizeParameters>(layout_.size());
  out.form.size = out.form.size.cwiseMax(noise_.form.min_size_share * mean_size());
  out.form.shape += step.segment(layout_.shape(), num_coefficients());
  out.log_scale += step[layout_.scale()];
  return out;
}

Eigen::VectorXd VehiclePosterior::limited(const Eigen::VectorXd& step) const {
  constexpr double kLargestTurn = 0.3;  // rad
  double turn = 0.0;
  for (int k = 0; k < num_views(); ++k) {
    turn = std::max(turn, step.segment<3>(layout_.pose(k) + 3).norm());
  }
  if (!(turn > kLargestTurn)) return step;
  return (kLargestTurn / turn) * step;
}

double VehiclePosterior::error_weight(int keypoint) const {
  return 1.0 / std::max(shape_variance_[static_cast<std::size_t>(keypoint)],
                        noise_.keypoint.min_shape_variance);
}

/// Schur complement of the shape errors, 3 x 3 each.
void VehiclePosterior::eliminate_errors(const VehicleState& state,
                                        const std::vector<ShapeErrorEquations>& terms,
                                        PosteriorEquations* equations) const {
  std::array<Eigen::Matrix3d, kNumKeypoints> own;
  ShapeErrors gradient;
  for (int i = 0; i < kNumKeypoints; ++i) {
    own[static_cast<std::size_t>(i)] = error_weight(i) * Eigen::Matrix3d::Identity();
    gradient.col(i) = error_weight(i) * state.errors.col(i);
  }
  Eigen::MatrixXd cross = Eigen::MatrixXd::Zero(3 * kNumKeypoints, layout_.total());
  for (int k = 0; k < num_views(); ++k) {
    const ShapeErrorEquations& t = terms[index(k)];
    for (std::size_t i = 0; i < own.size(); ++i) own[i] += t.own[i];
    gradient += t.gradient;
    cross.middleCols(layout_.pose(k), kPoseParameters) += t.cross.leftCols(kPoseParameters);
    cross.middleCols(layout_.size(), layout_.num_form()) += t.cross.rightCols(layout_.num_form());
  }
  equations->errors_by.resize(3 * kNumKeypoints, layout_.total());
  equations->errors_at.resize(3 * kNumKeypoints);
  equations->errors_log_determinant = 0.0;
  for (int i = 0; i < kNumKeypoints; ++i) {
    const Eigen::Matrix3d inverse = own[static_cast<std::size_t>(i)].inverse();
    equations->errors_by.middleRows<3>(3 * i).noalias() = inverse * cross.middleRows<3>(3 * i);
    equations->errors_at.segment<3>(3 * i) = inverse * gradient.col(i);
    equations->errors_log_determinant -= std::log(inverse.determinant());
  }
  equations->hessian -= transposed_product(cross, equations->errors_by);
  equations->gradient.noalias() -= cross.transpose() * equations->errors_at;
}

Eigen::MatrixXd VehiclePosterior::view_covariance(int view, const Eigen::MatrixXd& all) const {
  const int form = layout_.num_form(), pose = layout_.pose(view), size = layout_.size();
  Eigen::MatrixXd out(kPoseParameters + form, kPoseParameters + form);
  out << all.block(pose, pose, kPoseParameters, kPoseParameters),
      all.block(pose, size, kPoseParameters, form),  //
      all.block(size, pose, form, kPoseParameters), all.block(size, size, form, form);
  return out;
}

double VehiclePosterior::minus_log_evidence(const VehicleState& state) const {
  PosteriorEquations equations;
  const double cost = evaluate(state, &equations);
  const SymmetricFactors factors(equations.hessian);
  if (!std::isfinite(cost) || !factors.positive()) return kInfinity;
  const double log_determinant = factors.log_determinant() + equations.errors_log_determinant;
  return cost + 0.5 * log_determinant + motion_.log_normaliser(state);
}

}  // namespace camber::internal
