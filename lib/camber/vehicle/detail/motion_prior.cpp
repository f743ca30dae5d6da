#include "camber/vehicle/detail/motion_prior.h"

#include <algorithm>
#include <cmath>

namespace camber::internal {

Eigen::Matrix3d logarithm_jacobian(const Eigen::Vector3d& v) {
  const double angle = v.norm();
  const Eigen::Matrix3d cross = skew(v);
  // (1 / a^2) - (1 + cos a) / (2 a sin a), whose terms cancel near 0.
  const double factor = angle < 1e-3 ? 1.0 / 12.0
                                     : 1.0 / (angle * angle) - (1.0 + std::cos(angle)) /
                                                                   (2.0 * angle * std::sin(angle));
  return Eigen::Matrix3d::Identity() + 0.5 * cross + factor * cross * cross;
}

Step step_between(const ViewCamera& first, const ViewCamera& second, const ViewPose& a,
                  const ViewPose& b, double log_scale, StepJacobian* jacobian) {
  const SE3 &wa = first.world_from_camera, &wb = second.world_from_camera;
  const Eigen::Matrix3d ra = wa.rotation_matrix() * a.rotation;
  const Eigen::Matrix3d rb = wb.rotation_matrix() * b.rotation;
  const Eigen::Vector3d baseline = std::exp(log_scale) * (wb.translation() - wa.translation());
  const Eigen::Vector3d between =
      wb.rotation() * b.translation - wa.rotation() * a.translation + baseline;
  const Eigen::Vector3d shift = ra.transpose() * between;
  const Eigen::Matrix3d turned = ra.transpose() * rb;
  Step out;
  out.head<3>() = shift;
  out.tail<3>() = rotation_to_vector(Eigen::Quaterniond(turned));
  if (!jacobian) return out;
  StepJacobian& j = *jacobian;
  j.setZero();
  j.block<3, 3>(0, 0) = -ra.transpose() * wa.rotation_matrix();
  j.block<3, 3>(0, 3) = skew(shift);
  j.block<3, 3>(0, 6) = ra.transpose() * wb.rotation_matrix();
  j.block<3, 1>(0, 12) = ra.transpose() * baseline;
  const Eigen::Matrix3d by_turn = logarithm_jacobian(out.tail<3>());
  j.block<3, 3>(3, 3) = -by_turn * turned.transpose();
  j.block<3, 3>(3, 9) = by_turn;
  return out;
}

MotionPrior::MotionPrior(std::vector<ViewCamera> cameras, const MotionNoise& noise)
    : cameras_(std::move(cameras)), noise_(noise) {}

double MotionPrior::interval(int view) const {
  return std::max(camera(view + 1).time_s - camera(view).time_s, noise_.min_interval);
}

Step MotionPrior::sigma(const VehicleState& state, int view) const {
  Step out;
  if (state.motion == Motion::kParked) {
    const ViewCamera &a = camera(view), &b = camera(view + 1);
    const double turn = std::hypot(a.sigma_turn, b.sigma_turn);
    const double shift = std::hypot(a.sigma_shift, b.sigma_shift, noise_.parked_shift);
    const double distance = state.poses[static_cast<std::size_t>(view)].translation.norm();
    out.head<3>().setConstant(std::hypot(shift, turn * distance));
    out.tail<3>().setConstant(std::hypot(turn, noise_.parked_turn));
    return out;
  }
  const double dt = interval(view);
  out[0] =
      view == 0 ? noise_.speed * dt : noise_.acceleration * 0.5 * (dt + interval(view - 1)) * dt;
  // Vehicle frame: x ahead, y up.
  out[1] = noise_.vertical * dt;
  out[2] = noise_.sideways * dt;
  out.tail<3>() << noise_.tilting * dt, noise_.turning * dt, noise_.tilting * dt;
  return out;
}

double MotionPrior::add(const VehicleState& state, const ParameterLayout& layout,
                        NormalEquations* equations) const {
  double cost = 0.0;
  Step r, last;
  StepJacobian j, last_j;
  for (int k = 0; k + 1 < layout.num_views; ++k) {
    const auto at = static_cast<std::size_t>(k);
    r = step_between(camera(k), camera(k + 1), state.poses[at], state.poses[at + 1],
                     state.log_scale, equations ? &j : nullptr);
    Step weight = sigma(state, k).cwiseAbs2().cwiseInverse();
    const double along_weight = weight[0];
    const bool follows = state.motion == Motion::kMoving && k > 0;  // its speed changes little
    if (follows) weight[0] = 0.0;
    cost += 0.5 * r.cwiseAbs2().dot(weight);
    if (equations) {
      const StepJacobian weighted = weight.asDiagonal() * j;
      const Eigen::MatrixXd h = j.transpose() * weighted;
      const Eigen::VectorXd g = weighted.transpose() * r;
      scatter(h, g, {{layout.pose(k), 0, 12}, {layout.scale(), 12, 1}}, equations);
    }
    if (follows) {
      const double ratio = interval(k) / interval(k - 1);
      const double change = r[0] - ratio * last[0];
      cost += 0.5 * along_weight * change * change;
      if (equations) {
        Eigen::Matrix<double, 19, 1> row = Eigen::Matrix<double, 19, 1>::Zero();
        row.head<12>() -= ratio * last_j.block<1, 12>(0, 0).transpose();
        row.segment<12>(6) += j.block<1, 12>(0, 0).transpose();
        row[18] = j(0, 12) - ratio * last_j(0, 12);
        const Eigen::MatrixXd h = (along_weight * row) * row.transpose();
        const Eigen::VectorXd g = (along_weight * change) * row;
        scatter(h, g, {{layout.pose(k - 1), 0, 18}, {layout.scale(), 18, 1}}, equations);
      }
    }
    last = r;
    if (equations) last_j = j;
  }
  return cost;
}

double MotionPrior::log_normaliser(const VehicleState& state) const {
  double out = 0.0;
  for (int k = 0; k + 1 < static_cast<int>(cameras_.size()); ++k) {
    out += sigma(state, k).array().log().sum();
  }
  return out;
}

}  // namespace camber::internal
