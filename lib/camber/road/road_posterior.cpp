#include "camber/road/road_posterior.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <stdexcept>
#include <string>

#include "camber/geometry/detail/dense_product.h"

namespace camber {

void Constraint::validate() const {
  const auto require = [&](bool fits, const char* block) {
    if (!fits) {
      throw std::invalid_argument("constraint " + name + ": " + block +
                                  " does not fit its measurements");
    }
  };
  const auto columns = static_cast<Eigen::Index>(pixels.size());
  require(covariance.rows() == size() && covariance.cols() == size(), "covariance");
  require(columns == 0 || (by_inverse_depth.rows() == size() && by_inverse_depth.cols() == columns),
          "by_inverse_depth");
  require(by_ego.size() == 0 || (by_ego.rows() == size() && by_ego.cols() == 3), "by_ego");
  require(by_log_scale.size() == 0 || by_log_scale.size() == size(), "by_log_scale");
  for (const CommonError& error : common) require(error.by.size() == size(), "common");
}

RoadPosterior::RoadPosterior(std::shared_ptr<const GroundField> field,
                             Eigen::MatrixXd shared_covariance, double inflation,
                             EgoPlaneEstimate ego, double metres_per_baseline,
                             double log_scale_sigma)
    : field_(std::move(field)),
      shared_covariance_(std::move(shared_covariance)),
      inflation_(inflation),
      ego_(std::move(ego)),
      log_scale_variance_(log_scale_sigma * log_scale_sigma),
      log_scale_(std::log(metres_per_baseline)) {
  if (!(inflation >= 1.0) || !(metres_per_baseline > 0.0) || !(log_scale_sigma > 0.0)) {
    throw std::invalid_argument(
        "road posterior: inflation must be >= 1, metres_per_baseline and log_scale_sigma > 0");
  }
  const Eigen::Index shared = field_->shared().cols();
  if (shared_covariance_.size() > 0 && shared > 0 && shared_covariance_.rows() != shared) {
    throw std::invalid_argument("road posterior: the shared parameters' covariance is " +
                                std::to_string(shared_covariance_.rows()) + " square, expected " +
                                std::to_string(shared));
  }
  if (ego_.shared_jacobian.cols() != shared) ego_.shared_jacobian.setZero(3, shared);
  node_change_ = Eigen::VectorXd::Zero(field_->nodes().size());
  metric_nodes_ = field_->nodes() / metres_per_baseline;
  shared_change_ = Eigen::VectorXd::Zero(shared_covariance_.rows());
}

RoadPosterior RoadPosterior::with_wider_scale(double variance) const {
  RoadPosterior out = *this;
  out.log_scale_variance_ += variance;
  return out;
}

double RoadPosterior::metres_per_baseline() const { return std::exp(log_scale_); }

double RoadPosterior::scale_sigma() const {
  return std::sqrt(std::max(0.0, covariance(of_log_scale())(0, 0)));
}

double RoadPosterior::inverse_depth(const Eigen::Vector2d& pixel) const {
  return field_->interpolated(pixel, metric_nodes_);
}

void RoadPosterior::inverse_depths(double row, int count, float* out) const {
  field_->interpolated_row(row, metric_nodes_, count, out);
}

UncertainPlane RoadPosterior::ego() const {
  UncertainPlane out = ego_.plane;
  const double m = metres_per_baseline();
  out.plane = ego_.plane.perturbed(ego_change_);
  out.plane.offset *= m;
  out.centroid = out.plane.foot(Eigen::Vector3d::Zero());
  UncertainPlane::make_axes(out.plane.normal, ego_.plane.axis1, &out.axis1, &out.axis2);
  out.covariance = covariance(of_ego());
  return out;
}

RoadFunctionals RoadPosterior::of_inverse_depths(const std::vector<Eigen::Vector2d>& pixels,
                                                 const Eigen::MatrixXd& coefficients) const {
  // r = rho / m: a larger scale lowers all metric inverse depths.
  const Eigen::Index nodes = node_change_.size(), count = coefficients.rows();
  RoadFunctionals out;
  out.of_state = Eigen::MatrixXd::Zero(nodes + 4, count);
  if (pixels.empty()) return out;
  const Eigen::MatrixXd of_nodes = field_->functionals(pixels, coefficients);
  out.of_state.topRows(nodes) = of_nodes / metres_per_baseline();
  out.of_state.row(nodes + 3) = -(of_nodes.transpose() * metric_nodes_).transpose();
  return out;
}

RoadFunctionals RoadPosterior::of_ego() const {
  const Eigen::Index nodes = node_change_.size();
  const double m = metres_per_baseline();
  RoadFunctionals out;
  out.of_state = Eigen::MatrixXd::Zero(nodes + 4, 3);
  out.of_state.block<3, 3>(nodes, 0) = Eigen::Vector3d(1.0, 1.0, m).asDiagonal();
  // The height at the foot grows with the scale. A plane is raised where its offset falls.
  out.of_state(nodes + 3, 2) = -m * ego_.plane.perturbed(ego_change_).offset;
  return out;
}

RoadFunctionals RoadPosterior::of_log_scale() const {
  RoadFunctionals out;
  out.of_state = Eigen::MatrixXd::Zero(node_change_.size() + 4, 1);
  out.of_state(node_change_.size() + 3, 0) = 1.0;
  return out;
}

RoadFunctionals RoadPosterior::of_constraint(const Constraint& constraint) const {
  constraint.validate();
  RoadFunctionals out;
  out.of_state = Eigen::MatrixXd::Zero(node_change_.size() + 4, constraint.size());
  if (!constraint.pixels.empty()) {
    out.of_state += of_inverse_depths(constraint.pixels, constraint.by_inverse_depth).of_state;
  }
  if (constraint.by_ego.size() > 0) {
    out.of_state += of_ego().of_state * constraint.by_ego.transpose();
  }
  if (constraint.by_log_scale.size() > 0) {
    out.of_state += of_log_scale().of_state * constraint.by_log_scale.transpose();
  }
  return out;
}

Eigen::MatrixXd RoadPosterior::covariance_times(const Eigen::MatrixXd& of_state) const {
  const Eigen::Index nodes = node_change_.size();
  const Eigen::MatrixXd field = of_state.topRows(nodes);
  const Eigen::MatrixXd ego = of_state.middleRows(nodes, 3);
  Eigen::MatrixXd out(of_state.rows(), of_state.cols());
  out.topRows(nodes) = inflation_ * field_->solve(field);
  out.middleRows(nodes, 3) = ego_.plane.covariance * ego;
  out.row(nodes + 3) = log_scale_variance_ * of_state.row(nodes + 3);
  if (shared_covariance_.size() > 0 && field_->shared().size() > 0) {
    // Field and ego plane share the errors of the motion; the ego plane's own covariance has its
    // share already.
    const double root = std::sqrt(inflation_);
    const Eigen::MatrixXd of_motion =
        shared_covariance_ * (root * detail::transposed_product(field_->shared(), field));
    const Eigen::MatrixXd of_motion_by_ego =
        shared_covariance_ * (ego_.shared_jacobian.transpose() * ego);
    out.topRows(nodes) += root * detail::product(field_->shared(), of_motion + of_motion_by_ego);
    out.middleRows(nodes, 3) += ego_.shared_jacobian * of_motion;
  }
  for (const auto& update : updates_) {
    const Eigen::MatrixXd of_gain = detail::transposed_product(update->gain_side, of_state);
    out -= detail::product(update->gain_side, update->information * of_gain);
  }
  return out;
}

Eigen::MatrixXd RoadPosterior::shared_covariance_with(const Eigen::MatrixXd& of_state) const {
  const Eigen::Index nodes = node_change_.size();
  Eigen::MatrixXd out = Eigen::MatrixXd::Zero(shared_covariance_.rows(), of_state.cols());
  if (shared_covariance_.size() > 0 && field_->shared().size() > 0) {
    const Eigen::MatrixXd of_field =
        detail::transposed_product(field_->shared(), of_state.topRows(nodes));
    out = shared_covariance_ * (std::sqrt(inflation_) * of_field +
                                ego_.shared_jacobian.transpose() * of_state.middleRows(nodes, 3));
  }
  for (const auto& update : updates_) {
    out -= update->of_shared *
           (update->information * detail::transposed_product(update->gain_side, of_state));
  }
  return out;
}

SharedEstimate RoadPosterior::shared() const {
  const Eigen::Index count = shared_covariance_.rows(), scale = node_change_.size() + 3;
  SharedEstimate out;
  out.change = shared_change_;
  out.covariance = Eigen::MatrixXd::Zero(count + 1, count + 1);
  out.covariance.topLeftCorner(count, count) = shared_covariance_;
  for (const auto& update : updates_) {
    out.covariance.topLeftCorner(count, count) -=
        update->of_shared * update->information * update->of_shared.transpose();
  }
  const RoadFunctionals log_scale = of_log_scale();
  out.covariance.topRightCorner(count, 1) = shared_covariance_with(log_scale.of_state);
  out.covariance.bottomLeftCorner(1, count) = out.covariance.topRightCorner(count, 1).transpose();
  out.covariance(count, count) = covariance(log_scale)(0, 0);
  for (const CommonEffect& effect : common_) {
    Eigen::VectorXd by(count + 1);
    by << effect.of_shared, effect.of_state[scale];
    out.common.push_back({effect.name, std::move(by)});
  }
  return out;
}

Eigen::MatrixXd RoadPosterior::covariance(const RoadFunctionals& rows,
                                          const RoadFunctionals& columns) const {
  return detail::transposed_product(rows.of_state, covariance_times(columns.of_state));
}

Eigen::MatrixXd RoadPosterior::covariance(const RoadFunctionals& functionals) const {
  const Eigen::MatrixXd out = covariance(functionals, functionals);
  return 0.5 * (out + out.transpose());
}

Eigen::VectorXd RoadPosterior::variances(const RoadFunctionals& functionals) const {
  const Eigen::MatrixXd& of_state = functionals.of_state;
  return of_state.cwiseProduct(covariance_times(of_state)).colwise().sum().transpose();
}

double RoadPosterior::squared_innovation(const Constraint& constraint) const {
  const Eigen::MatrixXd spread = covariance(of_constraint(constraint)) + constraint.covariance;
  return constraint.residual.dot(spread.ldlt().solve(constraint.residual));
}

RoadPosterior RoadPosterior::conditioned(const Constraint& constraint) const {
  RoadPosterior out = *this;
  if (constraint.size() == 0) return out;
  const RoadFunctionals functionals = of_constraint(constraint);
  auto update = std::make_shared<Update>();
  update->gain_side = covariance_times(functionals.of_state);
  Eigen::MatrixXd spread =
      detail::transposed_product(functionals.of_state, update->gain_side) + constraint.covariance;
  spread = 0.5 * (spread + spread.transpose()).eval();
  const Eigen::LDLT<Eigen::MatrixXd> ldlt(spread);
  update->information = ldlt.solve(Eigen::MatrixXd::Identity(spread.rows(), spread.cols()));
  const Eigen::VectorXd change = update->gain_side * ldlt.solve(constraint.residual);
  const Eigen::Index nodes = node_change_.size();
  out.node_change_ += change.head(nodes);
  out.ego_change_ += change.segment<3>(nodes);
  out.log_scale_ += change[nodes + 3];
  out.metric_nodes_ = (field_->nodes() + out.node_change_) / out.metres_per_baseline();
  update->of_shared = shared_covariance_with(functionals.of_state);
  out.shared_change_ += update->of_shared * ldlt.solve(constraint.residual);
  // An error of the measurements goes into the mean as they do; one that is there already is
  // corrected by them.
  const auto add = [&](const Eigen::VectorXd& off, CommonEffect* effect) {
    const Eigen::VectorXd weighted = update->information * off;
    effect->of_state += update->gain_side * weighted;
    effect->of_shared += update->of_shared * weighted;
  };
  for (CommonEffect& effect : out.common_) {
    add(-(functionals.of_state.transpose() * effect.of_state), &effect);
  }
  for (const CommonError& error : constraint.common) {
    auto effect = std::find_if(out.common_.begin(), out.common_.end(),
                               [&](const CommonEffect& e) { return e.name == error.name; });
    if (effect == out.common_.end()) {
      out.common_.push_back({error.name, Eigen::VectorXd::Zero(nodes + 4),
                             Eigen::VectorXd::Zero(shared_covariance_.rows())});
      effect = std::prev(out.common_.end());
    }
    add(error.by, &*effect);
  }
  out.updates_.push_back(std::move(update));
  return out;
}

Constraint RoadPosterior::relinearised(const Constraint& constraint,
                                       const RoadPosterior& linearised_at) const {
  Constraint out = constraint;
  if (constraint.size() == 0) return out;
  const Eigen::Index nodes = node_change_.size();
  Eigen::VectorXd step(nodes + 4);
  step.head(nodes) = linearised_at.node_change_ - node_change_;
  step.segment<3>(nodes) = linearised_at.ego_change_ - ego_change_;
  step[nodes + 3] = linearised_at.log_scale_ - log_scale_;
  out.residual += of_constraint(constraint).of_state.transpose() * step;
  return out;
}

RoadFunctionals joined(const std::vector<RoadFunctionals>& parts) {
  RoadFunctionals out;
  Eigen::Index columns = 0;
  for (const RoadFunctionals& part : parts) columns += part.of_state.cols();
  if (parts.empty()) return out;
  out.of_state.resize(parts.front().of_state.rows(), columns);
  Eigen::Index at = 0;
  for (const RoadFunctionals& part : parts) {
    out.of_state.middleCols(at, part.of_state.cols()) = part.of_state;
    at += part.of_state.cols();
  }
  return out;
}

}  // namespace camber
