#pragma once

#include <ceres/autodiff_cost_function.h>
#include <ceres/cost_function.h>

#include "camber/geometry/pinhole_camera.h"
#include "camber/vehicle/paper/cost_functions/vehicle_blocks.h"

namespace camber::paper {

/// Reprojection of one keypoint, L_r, equations 2 and 3:
/// r = (pi(R diag(l, h, w) (mean + basis a) + t) - z) / sigma, in standard deviations, each axis
/// its own (the network sees the box resized to a square). Visible and hidden keypoints differ in
/// sigma. Parameter blocks: pose (7), form (3 + K). Fails for a point not in front of the camera.
struct KeypointReprojection {
  PinholeCamera camera;
  WireframePoint point;
  Eigen::Vector2d pixel;  ///< z
  Eigen::Vector2d sigma;  ///< px, u and v

  template <typename T>
  bool operator()(const T* pose, const T* form, T* residual) const {
    using Vector3 = Eigen::Matrix<T, 3, 1>;
    Vector3 share = point.mean.cast<T>();
    for (Eigen::Index k = 0; k < point.basis.cols(); ++k) {
      share += point.basis.col(k).cast<T>() * form[3 + k];
    }
    const Eigen::Map<const Eigen::Quaternion<T>> rotation(pose);
    const Eigen::Map<const Vector3> translation(pose + 4);
    const Vector3 x =
        rotation * Vector3(form[0] * share.x(), form[2] * share.y(), form[1] * share.z()) +
        translation;
    if (!(x.z() > T(0.1))) return false;
    residual[0] = (camera.fx * x.x() / x.z() + camera.cx - pixel.x()) / sigma.x();
    residual[1] = (camera.fy * x.y() / x.z() + camera.cy - pixel.y()) / sigma.y();
    return true;
  }

  /// Analytic derivatives, any K.
  static ceres::CostFunction* create(const KeypointReprojection& term);
  /// The automatic twin, for K known when compiling.
  template <int K>
  static ceres::CostFunction* create_automatic(const KeypointReprojection& term) {
    return new ceres::AutoDiffCostFunction<KeypointReprojection, 2, 7, 3 + K>(
        new KeypointReprojection(term));
  }
};

namespace internal {

class AnalyticKeypointReprojection : public ceres::CostFunction {
 public:
  explicit AnalyticKeypointReprojection(const KeypointReprojection& term) : term_(term) {
    set_num_residuals(2);
    mutable_parameter_block_sizes()->push_back(7);
    mutable_parameter_block_sizes()->push_back(3 + static_cast<int>(term.point.basis.cols()));
  }

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override {
    const double *pose = parameters[0], *form = parameters[1];
    const Eigen::Index count = term_.point.basis.cols();
    Eigen::Vector3d share = term_.point.mean;
    for (Eigen::Index k = 0; k < count; ++k) share += term_.point.basis.col(k) * form[3 + k];
    const Eigen::Vector3d size(form[0], form[2], form[1]);
    const Eigen::Vector3d p = size.cwiseProduct(share);
    const Eigen::Vector3d v(pose[0], pose[1], pose[2]);
    const double w = pose[3];
    // R p = p + 2 w (v x p) + 2 v x (v x p)
    const Eigen::Vector3d vp = v.cross(p);
    const Eigen::Vector3d x =
        p + 2.0 * w * vp + 2.0 * v.cross(vp) + Eigen::Vector3d(pose[4], pose[5], pose[6]);
    if (!(x.z() > 0.1)) return false;
    const double iz = 1.0 / x.z();
    const double u = term_.camera.fx * x.x() * iz, t = term_.camera.fy * x.y() * iz;
    residuals[0] = (u + term_.camera.cx - term_.pixel.x()) / term_.sigma.x();
    residuals[1] = (t + term_.camera.cy - term_.pixel.y()) / term_.sigma.y();
    if (!jacobians) return true;
    Eigen::Matrix<double, 2, 3> d;  // by x
    d << term_.camera.fx * iz, 0.0, -u * iz, 0.0, term_.camera.fy * iz, -t * iz;
    d.row(0) /= term_.sigma.x();
    d.row(1) /= term_.sigma.y();
    if (jacobians[0]) {
      Eigen::Map<Eigen::Matrix<double, 2, 7, Eigen::RowMajor>> j(jacobians[0]);
      Eigen::Matrix3d by_v = 2.0 * (v * p.transpose() - 2.0 * p * v.transpose());
      by_v.diagonal().array() += 2.0 * v.dot(p);
      const Eigen::Vector3d wp = 2.0 * w * p;  // - 2 w [p]x
      by_v(0, 1) += wp.z();
      by_v(0, 2) -= wp.y();
      by_v(1, 0) -= wp.z();
      by_v(1, 2) += wp.x();
      by_v(2, 0) += wp.y();
      by_v(2, 1) -= wp.x();
      j.leftCols<3>().noalias() = d * by_v;
      j.col(3).noalias() = d * (2.0 * vp);
      j.rightCols<3>() = d;
    }
    if (jacobians[1]) {
      const Eigen::Matrix3d rotation =
          Eigen::Map<const Eigen::Quaterniond>(pose).toRotationMatrix();
      const Eigen::Matrix<double, 2, 3> turned = d * rotation;
      Eigen::Map<Eigen::Matrix<double, 2, Eigen::Dynamic, Eigen::RowMajor>> j(jacobians[1], 2,
                                                                              3 + count);
      j.col(0) = turned.col(0) * share.x();
      j.col(1) = turned.col(2) * share.z();
      j.col(2) = turned.col(1) * share.y();
      const Eigen::Matrix<double, 2, 3> scaled = turned * size.asDiagonal();
      for (Eigen::Index k = 0; k < count; ++k) {
        j.col(3 + k).noalias() = scaled * term_.point.basis.col(k);
      }
    }
    return true;
  }

 private:
  KeypointReprojection term_;
};

}  // namespace internal

inline ceres::CostFunction* KeypointReprojection::create(const KeypointReprojection& term) {
  return new internal::AnalyticKeypointReprojection(term);
}

}  // namespace camber::paper
