#include "camber/geometry/lens_map.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>

namespace camber {
namespace {

constexpr double kMostTangent = 1.88;  // of 62 degrees
constexpr double kMostAngle = 1.5;     // rad, of any ray

}  // namespace

LensMap::LensMap(const PinholeCamera& camera, const LensDistortion& lens)
    : camera_(camera), lens_(lens) {
  camera.validate();
  lens.validate();
  const std::vector<double>& c = lens.coefficients;
  if (lens.model == LensModel::kBrown) {
    k_[0] = c[0];
    k_[1] = c[1];
    p_[0] = c[2];
    p_[1] = c[3];
    if (c.size() > 4) k_[2] = c[4];
    for (std::size_t i = 5; i < c.size(); ++i) k_[i - 2] = c[i];
  } else if (lens.model == LensModel::kFisheye) {
    std::copy(c.begin(), c.end(), k_);
  }
  // The first place where the radius stops growing.
  constexpr int kSteps = 3000;
  const double most = lens.model == LensModel::kFisheye ? kMostAngle : std::tan(kMostAngle);
  limit_ = most;
  for (int i = 1; i <= kSteps; ++i) {
    const double at = most * i / kSteps;
    double derivative = 0.0;
    if (radius(at, &derivative) > 0.0 && derivative > 0.0) continue;
    limit_ = most * (i - 1) / kSteps;
    break;
  }
}

double LensMap::radius(double ideal, double* derivative) const {
  const double s = ideal * ideal;
  if (lens_.model == LensModel::kFisheye) {
    *derivative = 1.0 + s * (3 * k_[0] + s * (5 * k_[1] + s * (7 * k_[2] + s * 9 * k_[3])));
    return ideal * (1.0 + s * (k_[0] + s * (k_[1] + s * (k_[2] + s * k_[3]))));
  }
  const double above = 1.0 + s * (k_[0] + s * (k_[1] + s * k_[2]));
  const double below = 1.0 + s * (k_[3] + s * (k_[4] + s * k_[5]));
  const double by_above = k_[0] + s * (2 * k_[1] + s * 3 * k_[2]);  // d / ds
  const double by_below = k_[3] + s * (2 * k_[4] + s * 3 * k_[5]);
  *derivative = (above + 2 * s * (by_above - by_below * above / below)) / below;
  return ideal * above / below;
}

Eigen::Vector2d LensMap::distorted(const Eigen::Vector2d& ideal) const {
  const double r = ideal.norm();
  double unused = 0.0;
  if (lens_.model == LensModel::kFisheye) {
    const double angle = std::atan(r);
    return r > 0.0 ? Eigen::Vector2d(radius(angle, &unused) / r * ideal) : ideal;
  }
  const double ratio = r > 0.0 ? radius(r, &unused) / r : 1.0;
  const double x = ideal.x(), y = ideal.y();
  return {ratio * x + 2 * p_[0] * x * y + p_[1] * (r * r + 2 * x * x),
          ratio * y + p_[0] * (r * r + 2 * y * y) + 2 * p_[1] * x * y};
}

std::optional<Eigen::Vector2d> LensMap::raw_from_pinhole(const Eigen::Vector2d& pixel) const {
  const Eigen::Vector2d ideal = camera_.ray(pixel).head<2>();
  const double r = ideal.norm();
  if ((lens_.model == LensModel::kFisheye ? std::atan(r) : r) > limit_) return std::nullopt;
  const Eigen::Vector2d d = distorted(ideal);
  return Eigen::Vector2d(lens_.raw.fx * d.x() + lens_.raw.cx, lens_.raw.fy * d.y() + lens_.raw.cy);
}

std::optional<Eigen::Vector2d> LensMap::pinhole_from_raw(const Eigen::Vector2d& pixel) const {
  const Eigen::Vector2d wanted = lens_.raw.ray(pixel).head<2>();
  // The radius alone by bisection, then both coordinates by Newton's method.
  const double target = wanted.norm();
  double unused = 0.0;
  if (!(target <= radius(limit_, &unused) + 0.05)) return std::nullopt;
  double low = 0.0, high = limit_;
  for (int i = 0; i < 60; ++i) {
    const double middle = 0.5 * (low + high);
    (radius(middle, &unused) < target ? low : high) = middle;
  }
  const double start = lens_.model == LensModel::kFisheye ? std::tan(low) : low;
  Eigen::Vector2d ideal = target > 0.0 ? Eigen::Vector2d(start / target * wanted) : wanted;
  for (int i = 0; i < 20; ++i) {
    const Eigen::Vector2d off = distorted(ideal) - wanted;
    if (off.norm() < 1e-13) break;
    constexpr double kStep = 1e-6;
    Eigen::Matrix2d jacobian;
    for (int k = 0; k < 2; ++k) {
      const Eigen::Vector2d step = kStep * Eigen::Vector2d::Unit(k);
      jacobian.col(k) = (distorted(ideal + step) - distorted(ideal - step)) / (2 * kStep);
    }
    if (!(std::abs(jacobian.determinant()) > 1e-9)) return std::nullopt;
    ideal -= jacobian.inverse() * off;
  }
  const double r = ideal.norm();
  if (!((distorted(ideal) - wanted).norm() < 1e-9) ||
      (lens_.model == LensModel::kFisheye ? std::atan(r) : r) > limit_) {
    return std::nullopt;
  }
  return Eigen::Vector2d(camera_.fx * ideal.x() + camera_.cx, camera_.fy * ideal.y() + camera_.cy);
}

PinholeCamera undistorted_camera(const LensDistortion& lens) {
  PinholeCamera out = lens.raw;
  const LensMap map(lens.raw, lens);
  const double right = lens.raw.width - 1.0, bottom = lens.raw.height - 1.0;
  // Rays of the borders, as tangents; what the model does not reach counts as the widest.
  const auto tangent = [&](double u, double v) {
    const auto pixel = map.pinhole_from_raw({u, v});
    if (pixel) return Eigen::Vector2d(lens.raw.ray(*pixel).head<2>());
    return Eigen::Vector2d(kMostTangent * lens.raw.ray({u, v}).head<2>().normalized());
  };
  double least_x = 0.0, greatest_x = 0.0, least_y = 0.0, greatest_y = 0.0;
  const auto cover = [&](const Eigen::Vector2d& t) {
    least_x = std::min(least_x, t.x());
    greatest_x = std::max(greatest_x, t.x());
    least_y = std::min(least_y, t.y());
    greatest_y = std::max(greatest_y, t.y());
  };
  cover(tangent(0.0, std::clamp(lens.raw.cy, 0.0, bottom)));
  cover(tangent(right, std::clamp(lens.raw.cy, 0.0, bottom)));
  cover(tangent(std::clamp(lens.raw.cx, 0.0, right), 0.0));
  constexpr int kSteps = 32;
  for (int i = 0; i <= kSteps; ++i) {
    const Eigen::Vector2d t = tangent(right * i / kSteps, bottom);
    // Corners beyond the middle row's width are sky's and neighbours' ground, not the road's.
    if (t.x() >= least_x && t.x() <= greatest_x) cover(t);
  }
  const auto bounded = [](double value, double most) { return std::clamp(value, -most, most); };
  const double most_x = std::min(kMostTangent, lens.raw.width / lens.raw.fx);
  const double most_y = std::min(kMostTangent, lens.raw.height / lens.raw.fy);
  const double left_px = std::floor(lens.raw.fx * bounded(least_x, most_x));
  const double right_px = std::ceil(lens.raw.fx * bounded(greatest_x, most_x));
  const double top_px = std::floor(lens.raw.fy * bounded(least_y, most_y));
  const double bottom_px = std::ceil(lens.raw.fy * bounded(greatest_y, most_y));
  out.cx = -left_px;
  out.cy = -top_px;
  out.width = static_cast<int>(right_px - left_px) + 1;
  out.height = static_cast<int>(bottom_px - top_px) + 1;
  return out;
}

}  // namespace camber
