// The gradient that integrating out the shape coefficients adds.

#include "camber/vehicle/detail/linear_algebra.h"
#include "camber/vehicle/detail/vehicle_posterior.h"

namespace camber::internal {

namespace {

/// A point's part of d(log determinant) / d(its derivatives by the coefficients): K x 2 for u, v,
/// per pixel.
struct ShapeTerm {
  int point = 0;
  Eigen::MatrixXd weight;
};

/// Derivatives of a point's pixel by the coefficients, K x 2 for u, v.
Eigen::MatrixXd shape_jacobian(const BodyView& at, int point) {
  Eigen::MatrixXd out(at.num_coefficients(), 2);
  at.shape_jacobian(point, out.col(0).data(), out.col(1).data());
  return out;
}

/// With the coefficients' information H = sum_i w_i J_i^T J_i, d(log det H)/2 = sum_i <w_i J_i
/// H^-1, dJ_i>: the factors of dJ_i, weights held.
/// @param covariance       H^-1, pose and size held.
/// @param errors_by_shape  how the shape errors follow the coefficients, 3 rows a keypoint.
std::vector<ShapeTerm> shape_terms(const KeypointLikelihood& keypoints, const BoxLikelihood& box,
                                   const BodyView& at, const Eigen::MatrixXd& covariance,
                                   const ShapeErrors* errors,
                                   const Eigen::MatrixXd& errors_by_shape) {
  std::vector<ShapeTerm> out;
  const std::vector<Eigen::Vector2d> weights = keypoints.weights(at, errors);
  for (std::size_t j = 0; j < weights.size(); ++j) {
    const int point = keypoints.points()[j];
    Eigen::MatrixXd by_shape = shape_jacobian(at, point);
    by_shape.col(0) /= keypoints.cell_u();
    by_shape.col(1) /= keypoints.cell_v();
    if (errors) {
      by_shape.noalias() -= errors_by_shape.middleRows<3>(3 * point).transpose() *
                            keypoints.cells_by_shape_error().transpose();
    }
    ShapeTerm term;
    term.point = point;
    term.weight = product(covariance, by_shape);
    term.weight.col(0) *= weights[j].x() / keypoints.cell_u();
    term.weight.col(1) *= weights[j].y() / keypoints.cell_v();
    out.push_back(std::move(term));
  }
  for (const BoxLikelihood::Side& side : box.sides(at)) {
    ShapeTerm term;
    term.point = side.point;
    term.weight = Eigen::MatrixXd::Zero(at.num_coefficients(), 2);
    term.weight.col(side.axis) =
        side.information * covariance * shape_jacobian(at, side.point).col(side.axis);
    out.push_back(std::move(term));
  }
  return out;
}

}  // namespace

Eigen::VectorXd VehiclePosterior::shape_marginal_gradient(
    const VehicleState& state, const PosteriorEquations& equations) const {
  Eigen::VectorXd out = Eigen::VectorXd::Zero(layout_.total());
  const int shape = num_coefficients(), shape_at = layout_.shape();
  if (shape == 0) return out;
  const Eigen::MatrixXd information = equations.hessian.block(shape_at, shape_at, shape, shape);
  const Eigen::MatrixXd covariance = SymmetricFactors(information).inverse();
  const ShapeErrors* errors = num_views() > 1 ? &state.errors : nullptr;
  Eigen::MatrixXd errors_by_shape;
  if (errors) errors_by_shape = equations.errors_by.middleCols(shape_at, shape);
  for (int k = 0; k < num_views(); ++k) {
    const BodyView at = view(k, state);
    if (!at.in_front()) return out;
    const std::vector<ShapeTerm> terms =
        shape_terms(keypoints(k), box(k), at, covariance, errors, errors_by_shape);
    const auto sum = [&](int parameter, double step) {
      PoseVector pose_step = PoseVector::Zero();
      Form form = state.form;
      if (parameter < kPoseParameters) {
        pose_step[parameter] = step;
      } else {
        form.size[parameter - kPoseParameters] += step;
      }
      const ViewPose pose = at.pose().moved(pose_step);
      const BodyView there(body_, camera_, pose, form);
      double total = 0.0;
      for (const ShapeTerm& t : terms) {
        total += t.weight.cwiseProduct(shape_jacobian(there, t.point)).sum();
      }
      return total;
    };
    // Central differences: the second derivatives of a projection are simple but many.
    for (int i = 0; i < kPoseParameters + kSizeParameters; ++i) {
      const double step = i < 3 ? 1e-4 * at.pose().translation.norm() : 1e-4;
      const int parameter =
          i < kPoseParameters ? layout_.pose(k) + i : layout_.size() + i - kPoseParameters;
      out[parameter] += (sum(i, step) - sum(i, -step)) / (2.0 * step);
    }
  }
  return out;
}

}  // namespace camber::internal
