#include "camber/calibrate/drive_lens.h"

#include <cmath>

namespace camber {

DriveLens::Vector DriveLens::parameters() const {
  Vector out;
  out << std::log(f), cx, cy, k1, k2, yaw, pitch;
  return out;
}

DriveLens DriveLens::with(const Vector& parameters) const {
  DriveLens out = *this;
  out.f = std::exp(parameters(0));
  out.cx = parameters(1);
  out.cy = parameters(2);
  out.k1 = parameters(3);
  out.k2 = parameters(4);
  out.yaw = parameters(5);
  out.pitch = parameters(6);
  return out;
}

std::optional<Eigen::Vector2d> DriveLens::pixel(const Eigen::Vector3d& p) const {
  if (!(p.z() > 0.0)) return std::nullopt;
  const Eigen::Vector2d x = p.head<2>() / p.z();
  const double r2 = x.squaredNorm();
  return Eigen::Vector2d(cx, cy) + f * (1.0 + r2 * (k1 + r2 * k2)) * x;
}

std::optional<DriveLens::Projection> DriveLens::project(const Eigen::Vector3d& p) const {
  if (!(p.z() > 0.0)) return std::nullopt;
  const Eigen::Vector2d x = p.head<2>() / p.z();
  const double r2 = x.squaredNorm();
  const double stretch = 1.0 + r2 * (k1 + r2 * k2);
  Projection out;
  out.pixel = Eigen::Vector2d(cx, cy) + f * stretch * x;
  const Eigen::Matrix2d by_x =
      f * (stretch * Eigen::Matrix2d::Identity() + 2.0 * (k1 + 2.0 * k2 * r2) * x * x.transpose());
  out.by_point.leftCols<2>() = by_x / p.z();
  out.by_point.col(2) = -by_x * x / p.z();
  out.by_lens.col(0) = f * stretch * x;
  out.by_lens.col(1) = Eigen::Vector2d::UnitX();
  out.by_lens.col(2) = Eigen::Vector2d::UnitY();
  out.by_lens.col(3) = f * r2 * x;
  out.by_lens.col(4) = f * r2 * r2 * x;
  out.by_lens.rightCols<2>().setZero();
  return out;
}

std::optional<Eigen::Vector3d> DriveLens::ray(const Eigen::Vector2d& pixel) const {
  const Eigen::Vector2d seen = (pixel - Eigen::Vector2d(cx, cy)) / f;
  const double radius = seen.norm();
  if (radius < 1e-12) return Eigen::Vector3d(seen.x(), seen.y(), 1.0);
  // Newton's method on r (1 + k1 r^2 + k2 r^4) = radius, from the middle outwards.
  double r = std::min(radius, 0.5);
  for (int iteration = 0; iteration < 50; ++iteration) {
    const double r2 = r * r;
    const double error = r * (1.0 + r2 * (k1 + r2 * k2)) - radius;
    const double slope = 1.0 + r2 * (3.0 * k1 + 5.0 * r2 * k2);
    if (!(slope > 1e-3)) return std::nullopt;
    r -= error / slope;
    if (!(r > 0.0) || r > 100.0) return std::nullopt;
    if (std::abs(error) < 1e-13) break;
  }
  const Eigen::Vector2d x = seen * (r / radius);
  return Eigen::Vector3d(x.x(), x.y(), 1.0);
}

PinholeCamera DriveLens::pinhole() const { return {width, height, f, f, cx, cy}; }

LensDistortion DriveLens::distortion() const {
  LensDistortion out;
  out.raw = pinhole();
  if (k1 == 0.0 && k2 == 0.0) return out;
  out.model = LensModel::kBrown;
  out.coefficients = {k1, k2, 0.0, 0.0, 0.0};
  return out;
}

}  // namespace camber
