// A vehicle's message on its ground plane and the scale.

#include <cmath>

#include "camber/vehicle/detail/ground_propagation.h"
#include "camber/vehicle/detail/linear_algebra.h"

namespace camber::internal {

std::optional<GroundMessage> eliminate_to_ground(const NormalEquations& equations,
                                                 Eigen::Index pose_at,
                                                 const ContactTerms& contact) {
  const Eigen::Index rest = equations.hessian.rows() - 1;
  const Eigen::Vector3d weight = contact.variance.cwiseInverse();
  const Eigen::Matrix3d plane_weighted = weight.asDiagonal() * contact.by_plane;
  const ContactJacobian pose_weighted = weight.asDiagonal() * contact.by_pose;
  // Of (plane, log scale), of all else, and between them.
  Eigen::Matrix4d ground = Eigen::Matrix4d::Zero();
  Eigen::Vector4d ground_vector;
  ground.topLeftCorner<3, 3>() = contact.by_plane.transpose() * plane_weighted;
  ground(3, 3) = equations.hessian(rest, rest);
  ground_vector << plane_weighted.transpose() * contact.residual, -equations.gradient[rest];
  Eigen::MatrixXd inner = equations.hessian.topLeftCorner(rest, rest);
  Eigen::VectorXd inner_vector = -equations.gradient.head(rest);
  inner.block<6, 6>(pose_at, pose_at) += contact.by_pose.transpose() * pose_weighted;
  inner_vector.segment<6>(pose_at) -= pose_weighted.transpose() * contact.residual;
  Eigen::MatrixXd between = Eigen::MatrixXd::Zero(rest, 4);
  between.block<6, 3>(pose_at, 0) = -contact.by_pose.transpose() * plane_weighted;
  between.col(3) = equations.hessian.col(rest).head(rest);
  const SymmetricFactors factors(inner);
  if (!factors.positive()) return std::nullopt;
  const Eigen::MatrixXd solved = factors.solve_matrix(between);
  const Eigen::Matrix4d information = ground - transposed_product(between, solved);
  const Eigen::Vector4d vector = ground_vector - solved.transpose() * inner_vector;
  if (!information.allFinite() || !vector.allFinite()) return std::nullopt;
  GroundMessage out;
  out.information = 0.5 * (information + information.transpose());
  out.information_vector = vector;
  // A scale that the vehicle does not measure may have come out a rounding error below nothing.
  constexpr double kRounding = 1e-9;
  Eigen::MatrixXd check = out.information;
  check.diagonal().array() += kRounding * out.information.trace();
  if (!SymmetricFactors(check).positive()) return std::nullopt;
  return out;
}

std::optional<GroundMessage> ground_message(const VehiclePosterior& posterior,
                                            const VehicleState& state, int view,
                                            const UncertainPlane& reference) {
  const ParameterLayout& layout = posterior.layout();
  // Where the observed second derivatives have no minimum, those of the least-squares step do.
  for (const bool observed : {true, false}) {
    PosteriorEquations equations;
    if (!std::isfinite(posterior.evaluate(state, &equations, observed))) continue;
    equations.gradient += posterior.shape_marginal_gradient(state, equations);
    for (int k = 0; k < posterior.num_views(); ++k) {
      PoseMatrix hessian;
      PoseVector gradient;
      posterior.contact(k).evaluate(state.poses[static_cast<std::size_t>(k)], &hessian, &gradient);
      equations.hessian.block<6, 6>(layout.pose(k), layout.pose(k)) -= hessian;
      equations.gradient.segment<6>(layout.pose(k)) -= gradient;
    }
    equations.hessian(layout.scale(), layout.scale()) -= 1.0 / posterior.scale_variance();
    equations.gradient[layout.scale()] -=
        (state.log_scale - posterior.scale_mean()) / posterior.scale_variance();
    auto out = eliminate_to_ground(
        equations, layout.pose(view),
        posterior.contact(view).terms(state.poses[static_cast<std::size_t>(view)]));
    if (!out) continue;
    // From the changes at this state to those of the reference plane.
    const UncertainPlane& now = posterior.contact(view).plane();
    const Eigen::Vector3d turn = now.plane.normal - reference.plane.normal;
    const double raised = reference.plane.signed_distance(reference.centroid) -
                          now.plane.signed_distance(reference.centroid);
    const Eigen::Vector4d moved(-reference.axis2.dot(turn), reference.axis1.dot(turn), raised,
                                state.log_scale);
    out->information_vector += out->information * moved;
    return out;
  }
  return std::nullopt;
}

}  // namespace camber::internal
