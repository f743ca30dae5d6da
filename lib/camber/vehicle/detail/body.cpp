#include "camber/vehicle/detail/body.h"

#include "camber/geometry/se3.h"
#include "camber/vehicle/detail/projection.h"

namespace camber::internal {

ViewPose ViewPose::moved(const Eigen::Matrix<double, kPoseParameters, 1>& step) const {
  ViewPose out;
  out.translation = translation + step.head<3>();
  out.rotation = rotation * rotation_from_vector(step.tail<3>()).toRotationMatrix();
  return out;
}

Body::Body(const ShapePrior& prior, int num_coefficients, bool car_like)
    : mean_(3, kNumBodyPoints),
      basis_(Eigen::MatrixXd::Zero(num_coefficients, 3 * kNumBodyPoints)) {
  for (int i = 0; i < kNumKeypoints; ++i) {
    const int row = i % kNumSideKeypoints;
    const double side = i < kNumSideKeypoints ? 1.0 : -1.0;
    const Eigen::Vector3d mirror(1.0, 1.0, side);
    mean_.col(i) = mirror.cwiseProduct(prior.mean.col(row));
    for (int k = 0; k < num_coefficients; ++k) {
      const auto& direction = prior.basis[static_cast<std::size_t>(k)];
      for (int axis = 0; axis < 3; ++axis) {
        basis_(k, 3 * i + axis) = mirror[axis] * direction(axis, row);
      }
    }
  }
  int next = kNumKeypoints;
  const auto fixed = [&](double x, double y, double z) {
    mean_.col(next++) = Eigen::Vector3d(x, y, z);
  };
  if (!car_like) {
    for (int i = 0; i < 8; ++i) fixed((i & 1) - 0.5, (i >> 1) & 1, (i >> 2) - 0.5);
    while (next < kNumBodyPoints) fixed(0.0, 0.5, 0.0);
    return;
  }
  for (const int i : {0, 1, 18, 19}) {  // where the tyres touch the ground
    for (const int axis : {0, 2}) basis_.col(3 * next + axis) = basis_.col(3 * i + axis);
    fixed(mean_(0, i), 0.0, mean_(2, i));
  }
  fixed(0.5, 0.33, 0.0);  // bumpers' foremost and rearmost points
  fixed(-0.5, 0.33, 0.0);
  fixed(-0.05, 1.0, 0.0);  // roof
  fixed(-0.20, 0.99, 0.0);
  fixed(0.0, 0.45, 0.5);  // widest points of the doors
  fixed(0.0, 0.45, -0.5);
}

Eigen::Matrix3Xd Body::basis(int point) const {
  return basis_.middleCols(3 * point, 3).transpose();
}

BodyView::BodyView(const Body& body, const PinholeCamera& camera, const ViewPose& pose,
                   const Form& form)
    : body_(body), camera_(camera), pose_(pose), form_(form), size_(form.along_axes()) {
  Eigen::Map<Eigen::VectorXd> shares(shares_[0].data(), 3 * kNumBodyPoints);
  shares = Eigen::Map<const Eigen::VectorXd>(body.mean_.data(), 3 * kNumBodyPoints);
  if (body.num_coefficients() > 0) shares.noalias() += body.basis_.transpose() * form.shape;
  for (std::size_t i = 0; i < shares_.size(); ++i) {
    vehicle_points_[i] = size_.cwiseProduct(shares_[i]);
    camera_points_[i] = pose.rotation * vehicle_points_[i] + pose.translation;
    const Eigen::Vector3d& x = camera_points_[i];
    if (x.z() > kNearest) {
      pixels_[i] = {camera.fx * x.x() / x.z() + camera.cx, camera.fy * x.y() / x.z() + camera.cy};
    } else {
      in_front_ = false;
    }
  }
}

void BodyView::write_shape_part(int point, const Eigen::Matrix<double, 2, 3>& turned, double* du,
                                double* dv) const {
  const int count = body_.num_coefficients();
  const double* x = body_.basis_.data() + 3 * point * count;
  const double *y = x + count, *z = y + count;
  const double ux = turned(0, 0) * size_[0], uy = turned(0, 1) * size_[1],
               uz = turned(0, 2) * size_[2];
  const double vx = turned(1, 0) * size_[0], vy = turned(1, 1) * size_[1],
               vz = turned(1, 2) * size_[2];
  for (int k = 0; k < count; ++k) {
    du[k] = ux * x[k] + uy * y[k] + uz * z[k];
    dv[k] = vx * x[k] + vy * y[k] + vz * z[k];
  }
}

void BodyView::jacobian(int point, double* du, double* dv) const {
  const Eigen::Matrix<double, 2, 3> direct =
      projection_jacobian(camera_, camera_points_[static_cast<std::size_t>(point)]).topRows<2>();
  const Eigen::Matrix<double, 2, 3> turned = direct * pose_.rotation;
  const Eigen::Vector3d& p = in_vehicle(point);
  const Eigen::Vector3d& share = shares_[static_cast<std::size_t>(point)];
  double* rows[] = {du, dv};
  for (int axis = 0; axis < 2; ++axis) {
    double* d = rows[axis];
    const double tx = turned(axis, 0), ty = turned(axis, 1), tz = turned(axis, 2);
    for (int i = 0; i < 3; ++i) d[i] = direct(axis, i);
    // R exp(w) p: d / dw = -R [p]x.
    d[3] = tz * p.y() - ty * p.z();
    d[4] = tx * p.z() - tz * p.x();
    d[5] = ty * p.x() - tx * p.y();
    d[6] = tx * share.x();  // length, width, height
    d[7] = tz * share.z();
    d[8] = ty * share.y();
  }
  constexpr int kOthers = kPoseParameters + kSizeParameters;
  write_shape_part(point, turned, du + kOthers, dv + kOthers);
}

void BodyView::shape_jacobian(int point, double* du, double* dv) const {
  const Eigen::Vector3d& x = camera_points_[static_cast<std::size_t>(point)];
  write_shape_part(point, projection_jacobian(camera_, x).topRows<2>() * pose_.rotation, du, dv);
}

}  // namespace camber::internal
