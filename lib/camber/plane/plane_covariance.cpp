#include "camber/plane/plane_covariance.h"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

namespace camber {

using Eigen::Matrix3d;
using Eigen::Vector3d;
namespace kernels = plane_kernels;

namespace {

constexpr double kRangeNoise = 0.01;  // relative, along unknown rays
constexpr double kRayTilt = 0.08;     // see UnknownRays

/// Whether points with this scatter in the plane (m^2) are spread over an area, not along a line.
bool covers_area(const Eigen::Matrix2d& scatter) {
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> eigen;
  eigen.computeDirect(scatter, Eigen::EigenvaluesOnly);
  constexpr double kLeast = 1e-4;  // a hundredth as wide as long
  return eigen.eigenvalues()[0] > kLeast * eigen.eigenvalues()[1];
}

/// Status and reason; a line has the plane through it that is nearest to level.
/// @param scatter  m^2, smaller and larger eigenvalue in the plane, by the curvature of the loss:
///                 negative where more points leave the plane than lie on it
/// @param area     whether the points themselves are spread over an area
/// @param one      m, standard deviation of a point by the curvature of the loss
void judge(const Eigen::Vector2d& scatter, bool area, double one, const Vector3d& up,
           PlaneEstimate* result) {
  UncertainPlane& out = result->plane;
  const double thin = std::max(scatter[0], 0.0), wide = scatter[1];
  const double points = std::max(result->points, 1.0);
  // Sums in float distinguish the two to about 1e-6.
  const bool line = !(thin > 1e-6 * wide) || !out.covariance.allFinite() ||
                    std::sqrt(thin) < 3.0 * one / std::sqrt(points);
  if (line) {
    // The plane through the line that is nearest to level.
    const Vector3d along = out.axis1;
    const Vector3d level = up - up.dot(along) * along;
    result->status = Status::kNotObservable;
    result->bends = !(wide > 0.0) || (scatter[0] < 0.0 && area);
    result->reason =
        result->bends ? "the points bend away from any plane" : "the points lie on a line";
    if (level.norm() > 1e-9) {
      out.plane.normal = level.normalized();
      out.plane.offset = -out.plane.normal.dot(out.centroid);
      out.axis2 = out.plane.normal.cross(along);
    }
    const double variance =
        points < static_cast<double>(kFewPlaces) ? std::max(one * one, wide) : one * one;
    out.covariance =
        Vector3d(1.0, std::min(variance / points / std::max(wide, 1e-300), 1.0), variance)
            .asDiagonal();
    return;
  }
  const double tilt = std::sqrt(std::max(out.covariance(0, 0), out.covariance(1, 1)));
  if (points < static_cast<double>(kFewPlaces)) {
    result->status = Status::kWeak;
    result->reason = fmt::format("only {} points lie on the plane", std::lround(points));
  } else if (tilt > kWeakTilt) {
    result->status = Status::kWeak;
    result->reason = fmt::format("the tilt's standard deviation is {:.3g} rad", tilt);
  } else {
    result->status = Status::kOk;
  }
}

}  // namespace

UnknownRays unknown_rays(const PointArrays& s, const PivotPlane& plane, const PlaneWindow& window) {
  constexpr float kLimit = static_cast<float>(kInlierSigmas * kInlierSigmas);
  const kernels::SpreadSums sums = kernels::spread_along(
      {s.x.data(), s.y.data(), s.z.data(), s.w.data(), kernels::padded(s.size)}, plane.as_float(),
      window.as_float(), kLimit);
  const kernels::SpreadSums::Axis &along = sums.u, &across = sums.v;
  const double weight = sums.weight;
  UnknownRays out;
  if (along.one < 20.0 || !(along.v > 0.0)) return out;
  const double noise = std::sqrt(along.v / weight);
  out.rise = kRangeNoise * noise;
  if (window.half_u > 1e14 || along.one < 200.0) return out;
  // How much the variance changes along an axis, relative to its mean: root mean square of the
  // quadratic that fits it best.
  const auto slope = [&](const kernels::SpreadSums::Axis& axis) {
    const double n = axis.one, x = axis.x / n, xx = axis.xx / n, xxx = axis.xxx / n,
                 xxxx = axis.xxxx / n;
    Eigen::Matrix2d spread;
    spread << xx - x * x, xxx - x * xx, xxx - x * xx, xxxx - xx * xx;
    const Eigen::Vector2d change(axis.vx / axis.v - x, axis.vxx / axis.v - xx);
    if (!(spread.determinant() > 0.0)) return 0.0;
    // Less what chance makes of even noise, two free parameters.
    const double change2 = change.dot(spread.inverse() * change) - 3.0 / n;
    return kRayTilt * noise * std::sqrt(std::max(change2, 0.0) / spread(0, 0));
  };
  out.slope_u = slope(along);
  out.slope_v = slope(across);
  return out;
}

double measured_noise(const PointArrays& s, const PivotPlane& plane, const PlaneWindow& window) {
  constexpr float kLimit = static_cast<float>(kBiweight);
  std::vector<float> residuals(s.x.size()), u(s.x.size()), v(s.x.size());
  kernels::project({s.x.data(), s.y.data(), s.z.data(), s.w.data(), s.x.size()}, plane.as_float(),
                   window.as_float(), residuals.data(), u.data(), v.data());
  const float half_u = static_cast<float>(window.half_u),
              half_v = static_cast<float>(window.half_v);
  std::size_t filled = 0;
  double count = 0.0, weight = 0.0, squares = 0.0;
  for (std::size_t k = 0; k < s.size; ++k) {
    const float r = residuals[k];
    if (!(r < 1e29f) || std::abs(u[k]) > half_u || std::abs(v[k]) > half_v) continue;
    residuals[filled++] = r;
    if (!(std::abs(r) < kLimit)) continue;
    count += 1.0;
    weight += static_cast<double>(s.w[k]);
    squares += static_cast<double>(r) * static_cast<double>(r);
  }
  constexpr double kFree = 3.0, kFewest = 20.0, kReach = 6.0;
  if (count <= kFree || !(weight > 0.0)) return std::numeric_limits<double>::quiet_NaN();
  const double stated = std::sqrt(count / weight);
  const double free = std::sqrt(count / (count - kFree));
  if (count < kFewest) return stated * free * std::sqrt(squares / count);
  // Weights of a threshold may be far from the noise: the histogram's bins then are, too.
  double deviation = 1.0;
  for (int round = 0; round < 4; ++round) {
    const double before = deviation;
    deviation = core_deviation(residuals.data(), filled, before, kReach * before);
    if (std::abs(deviation - before) < 0.05 * before) break;
  }
  return stated * free * deviation;
}

PlaneEstimate estimate_covariance(const PivotPlane& plane, const PlaneWindow& window,
                                  const kernels::Moments& full, const kernels::Moments& s,
                                  const PlanePointErrors& errors, const Vector3d& up,
                                  const std::optional<UnknownRays>& rays) {
  PlaneEstimate result;
  // Everything about the weighted centroid (mu, mv) of the window's coordinates.
  const double mu = full.u / full.weight, mv = full.v / full.weight;
  const auto about = [&](double m1, double m_u, double m_v, double uu, double uv, double vv) {
    Matrix3d h;
    h(0, 0) = uu - 2.0 * mu * m_u + mu * mu * m1;
    h(0, 1) = h(1, 0) = uv - mu * m_v - mv * m_u + mu * mv * m1;
    h(1, 1) = vv - 2.0 * mv * m_v + mv * mv * m1;
    h(0, 2) = h(2, 0) = m_u - mu * m1;
    h(1, 2) = h(2, 1) = m_v - mv * m1;
    h(2, 2) = m1;
    return h;
  };
  const Matrix3d hessian = about(full.weight, full.u, full.v, full.uu, full.uv, full.vv);
  const double share = full.count / std::max(s.count, 1e-300);  // a part's sums to all points
  const Matrix3d spread = share * about(s.i1, s.iu, s.iv, s.iuu, s.iuv, s.ivv);

  UncertainPlane& out = result.plane;
  out.centroid = window.center + mu * window.a + mv * window.b;
  const double rise = rays ? rays->rise : 0.0;
  out.centroid -= (plane.distance(out.centroid) + rise) * plane.n;
  out.plane.normal = plane.n;
  out.plane.offset = plane.d + rise;

  // In-plane scatter decides what is observable.
  const Eigen::Matrix2d scatter = hessian.topLeftCorner<2, 2>() / full.weight;
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> in_plane;
  in_plane.computeDirect(scatter);
  const double thin = std::max(in_plane.eigenvalues()[0], 0.0), wide = in_plane.eigenvalues()[1];
  result.condition = thin > 0.0 ? wide / thin : std::numeric_limits<double>::infinity();
  out.axis1 = window.a * in_plane.eigenvectors()(0, 1) + window.b * in_plane.eigenvectors()(1, 1);
  out.axis1 = (out.axis1 - out.axis1.dot(plane.n) * plane.n).normalized();
  // The sign of an eigenvector is free: point along the axis' largest component.
  int largest = 0;
  out.axis1.cwiseAbs().maxCoeff(&largest);
  if (out.axis1[largest] < 0.0) out.axis1 = -out.axis1;
  out.axis2 = plane.n.cross(out.axis1);

  // Covariance of (alpha, beta, gamma): sandwich, with the small-sample factor.
  const double points = std::max(errors.places, 1.0);
  const double one = std::sqrt(full.count / std::max(full.weight, 1e-300));
  result.points = errors.places;
  result.noise = std::isfinite(errors.noise) ? errors.noise : one;
  Matrix3d covariance;
  if (points < static_cast<double>(kFewPlaces)) {
    // Too few residuals to measure their spread.
    covariance = Vector3d(1.0, 1.0, std::max(one * one, wide)).asDiagonal();
  } else {
    const Matrix3d inverse = hessian.inverse();
    covariance = inverse * spread * inverse.transpose() * (points / (points - 3.0));
    if (rays) {
      covariance(0, 0) += rays->slope_u * rays->slope_u;
      covariance(1, 1) += rays->slope_v * rays->slope_v;
      covariance(2, 2) += 0.25 * rays->rise * rays->rise;
    }
    if (errors.shared > 0.0 && thin > 0.0) {
      // As one point's at a root mean square distance from the middle, along either axis.
      const double variance = errors.shared * errors.shared;
      covariance.topLeftCorner<2, 2>() += variance * scatter.inverse();
      covariance(2, 2) += variance;
    }
  }
  // The surface raised by alpha u + beta v + gamma has the normal n - alpha a - beta b; a turn
  // (t1, t2) about the axes gives n + t1 axis1 x n + t2 axis2 x n = n - t1 axis2 + t2 axis1.
  Matrix3d turn = Matrix3d::Zero();
  turn(0, 0) = out.axis2.dot(window.a);
  turn(0, 1) = out.axis2.dot(window.b);
  turn(1, 0) = -out.axis1.dot(window.a);
  turn(1, 1) = -out.axis1.dot(window.b);
  turn(2, 2) = 1.0;
  out.covariance = turn * covariance * turn.transpose();
  out.covariance = 0.5 * (out.covariance + out.covariance.transpose()).eval();

  judge(in_plane.eigenvalues(), covers_area(spread.topLeftCorner<2, 2>()), one, up, &result);
  return result;
}

}  // namespace camber
