#include "camber/vehicle/detail/registration_likelihood.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <cmath>

#include "camber/vehicle/detail/linear_algebra.h"
#include "camber/vehicle/detail/projection.h"

namespace camber::internal {

RegistrationLikelihood::RegistrationLikelihood(const PinholeCamera& camera,
                                               const RegistrationNoise& noise, int lead,
                                               const ViewPose& lead_pose, const Form& form,
                                               const std::vector<RegisteredView>& registered)
    : camera_(camera), lead_(lead), gate_squared_(noise.gate * noise.gate) {
  for (const RegisteredView& r : registered) {
    Link link;
    link.view = r.view;
    const Eigen::Vector3d place =
        lead_pose.rotation.transpose() * (r.shift.anchor - lead_pose.translation);
    link.share = place.cwiseQuotient(form.along_axes());
    link.measured << r.shift.displacement, r.shift.log_depth_ratio;
    link.information = r.shift.noise.inverse();
    link.by_common << Eigen::Matrix3d::Identity(), r.shift.by_depth;
    links_.push_back(link);
  }
  if (registered.empty()) return;
  const VehicleShift& any = registered.front().shift;  // one template has them all
  common_information_.setZero();
  common_information_.topLeftCorner<3, 3>() = any.shared.inverse();
  common_information_(3, 3) = 1.0 / (any.depth_sigma * any.depth_sigma);
}

std::optional<Eigen::Vector3d> RegistrationLikelihood::residual(const VehicleState& state, int i,
                                                                Jacobian* jacobian) const {
  constexpr double kNearest = 0.3;  // m
  const Link& link = links_[static_cast<std::size_t>(i)];
  const ViewPose& a = state.poses[static_cast<std::size_t>(lead_)];
  const ViewPose& b = state.poses[static_cast<std::size_t>(link.view)];
  const Eigen::Vector3d body = link.share.cwiseProduct(state.form.along_axes());
  const Eigen::Vector3d xa = a.rotation * body + a.translation;
  const Eigen::Vector3d xb = b.rotation * body + b.translation;
  if (!(xa.z() > kNearest) || !(xb.z() > kNearest)) return std::nullopt;
  const Eigen::Vector3d predicted(camera_.fx * (xb.x() / xb.z() - xa.x() / xa.z()),
                                  camera_.fy * (xb.y() / xb.z() - xa.y() / xa.z()),
                                  std::log(xb.z() / xa.z()));
  if (jacobian) {
    const Eigen::Matrix3d ja = -projection_jacobian(camera_, xa),
                          jb = projection_jacobian(camera_, xb);
    const Eigen::Matrix3d turned_a = ja * a.rotation, turned_b = jb * b.rotation;
    const Eigen::Matrix3d body_cross = skew(body);
    jacobian->block<3, 3>(0, 0) = ja;
    jacobian->block<3, 3>(0, 3) = -turned_a * body_cross;
    jacobian->block<3, 3>(0, 6) = jb;
    jacobian->block<3, 3>(0, 9) = -turned_b * body_cross;
    const Eigen::Matrix3d turned = turned_a + turned_b;
    jacobian->col(12) = turned.col(0) * link.share.x();  // length, width, height
    jacobian->col(13) = turned.col(2) * link.share.z();
    jacobian->col(14) = turned.col(1) * link.share.y();
  }
  return Eigen::Vector3d(predicted - link.measured);
}

Eigen::Vector4d RegistrationLikelihood::common_errors(const std::vector<Eigen::Vector3d>& residuals,
                                                      Eigen::Matrix4d* information) const {
  constexpr int kRounds = 20;
  constexpr double kConverged = 1e-10;  // squared standard deviations
  Eigen::Vector4d common = Eigen::Vector4d::Zero();
  for (int round = 0; round < kRounds; ++round) {
    *information = common_information_;
    Eigen::Vector4d right = Eigen::Vector4d::Zero();
    for (std::size_t i = 0; i < links_.size(); ++i) {
      const Link& link = links_[i];
      const Eigen::Vector3d r = residuals[i] - link.by_common * common;
      const double weight = 1.0 / (1.0 + r.dot(link.information * r) / gate_squared_);
      const Eigen::Matrix<double, 4, 3> weighted =
          weight * link.by_common.transpose() * link.information;
      *information += weighted * link.by_common;
      right += weighted * residuals[i];
    }
    const Eigen::Vector4d next = information->ldlt().solve(right);
    const Eigen::Vector4d change = next - common;
    common = next;
    if (change.dot(*information * change) < kConverged) break;
  }
  return common;
}

std::optional<double> RegistrationLikelihood::add(const VehicleState& state,
                                                  const ParameterLayout& layout,
                                                  NormalEquations* equations) const {
  if (links_.empty()) return 0.0;
  std::vector<Eigen::Vector3d> residuals;
  std::vector<Jacobian> jacobians(equations ? links_.size() : 0);
  for (std::size_t i = 0; i < links_.size(); ++i) {
    const auto r = residual(state, static_cast<int>(i), equations ? &jacobians[i] : nullptr);
    if (!r) return std::nullopt;
    residuals.push_back(*r);
  }
  Eigen::Matrix4d common_information;
  const Eigen::Vector4d common = common_errors(residuals, &common_information);
  double cost = 0.5 * common.dot(common_information_ * common);
  Eigen::MatrixXd common_by_state;
  if (equations) common_by_state.setZero(4, layout.total());
  for (std::size_t i = 0; i < links_.size(); ++i) {
    const Link& link = links_[i];
    const Eigen::Vector3d r = residuals[i] - link.by_common * common;
    const double squared = r.dot(link.information * r);
    cost += 0.5 * gate_squared_ * std::log1p(squared / gate_squared_);
    if (!equations) continue;
    const Jacobian weighted =
        (1.0 / (1.0 + squared / gate_squared_)) * link.information * jacobians[i];
    const Eigen::MatrixXd h = jacobians[i].transpose() * weighted;
    const Eigen::VectorXd g = weighted.transpose() * r;
    scatter(h, g,
            {{layout.pose(lead_), 0, 6}, {layout.pose(link.view), 6, 6}, {layout.size(), 12, 3}},
            equations);
    const Eigen::Matrix<double, 4, 15> own = link.by_common.transpose() * weighted;
    common_by_state.middleCols(layout.pose(lead_), 6) += own.leftCols<6>();
    common_by_state.middleCols(layout.pose(link.view), 6) += own.middleCols<6>(6);
    common_by_state.middleCols(layout.size(), 3) += own.rightCols<3>();
  }
  if (equations) {
    const Eigen::MatrixXd solved = common_information.ldlt().solve(common_by_state);
    equations->hessian -= transposed_product(common_by_state, solved);
  }
  return cost;
}

}  // namespace camber::internal
