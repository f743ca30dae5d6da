#include "camber/plane/plane_solver.h"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

namespace camber {

using Eigen::Matrix3d;
using Eigen::Vector3d;
namespace kernels = plane_kernels;

namespace {

constexpr double kWeakTilt = 0.02;    // rad
constexpr double kSystematic = 0.01;  // relative range noise

}  // namespace

plane_kernels::FloatPlane LocalPlane::as_float() const {
  return {static_cast<float>(n.x()), static_cast<float>(n.y()), static_cast<float>(n.z()),
          static_cast<float>(d)};
}

plane_kernels::Window PlaneWindow::as_float() const {
  const auto f = [](double value) { return static_cast<float>(value); };
  return {f(a.x()), f(a.y()),          f(a.z()),  f(-a.dot(center)), f(b.x()),  f(b.y()),
          f(b.z()), f(-b.dot(center)), f(half_u), f(half_v),         f(ramp_u), f(ramp_v)};
}

void align(const LocalPlane& plane, PlaneWindow* window) {
  const Vector3d along = window->a;
  UncertainPlane::make_axes(plane.n, along, &window->a, &window->b);
  window->center -= plane.distance(window->center) * plane.n;
}

void PointArrays::resize(std::size_t n, bool with_sigma, bool with_covariance) {
  const std::size_t m = kernels::padded(n);
  for (std::vector<float>* array : {&x, &y, &z, &w}) array->assign(m, 0.0f);
  if (with_sigma) sigma.assign(m, 1.0f);
  if (with_covariance) covariance.assign(m, {});
  size = n;
}

void PointArrays::take(const PointArrays& from, const std::vector<std::uint32_t>& rows) {
  resize(rows.size(), !from.sigma.empty(), !from.covariance.empty());
  for (std::size_t k = 0; k < rows.size(); ++k) {
    const std::uint32_t i = rows[k];
    x[k] = from.x[i];
    y[k] = from.y[i];
    z[k] = from.z[i];
    w[k] = from.w[i];
    if (!sigma.empty()) sigma[k] = from.sigma[i];
    if (!covariance.empty()) covariance[k] = from.covariance[i];
  }
}

void PointArrays::weigh(const NoiseModel& noise, const LocalPlane& plane) {
  std::fill(w.begin(), w.begin() + static_cast<long>(size), 1.0f);
  noise.weigh(plane.n, plane.d, size, x.data(), y.data(), z.data(), sigma.data(), covariance.data(),
              w.data());
}

kernels::Moments sum_moments(const PointArrays& s, const LocalPlane& plane,
                             const PlaneWindow& window, double limit, kernels::Loss loss,
                             bool influence) {
  kernels::Moments moments;
  const std::size_t n = kernels::padded(s.size);
  for (std::size_t begin = 0; begin < n; begin += kernels::kBlock) {
    kernels::accumulate(s.x.data() + begin, s.y.data() + begin, s.z.data() + begin,
                        s.w.data() + begin, std::min(kernels::kBlock, n - begin), plane.as_float(),
                        window.as_float(), static_cast<float>(limit), loss, influence, &moments);
  }
  return moments;
}

bool solve_step(const kernels::Moments& m, const PlaneWindow& window, LocalPlane* plane,
                double* step) {
  if (!(m.weight > 0.0) || m.count < 2.5) return false;
  const double mu = m.u / m.weight, mv = m.v / m.weight;
  const double uu = m.uu / m.weight - mu * mu, uv = m.uv / m.weight - mu * mv,
               vv = m.vv / m.weight - mv * mv;
  const double determinant = uu * vv - uv * uv;
  if (!(uu > 0.0 && vv > 0.0) || !(determinant > 1e-9 * uu * vv)) return false;
  const double g = m.r / m.weight;
  const double gu = m.ru / m.weight - mu * g, gv = m.rv / m.weight - mv * g;
  const double alpha = (vv * gu - uv * gv) / determinant, beta = (uu * gv - uv * gu) / determinant;
  const double gamma = g - alpha * mu - beta * mv;  // at the window's centre
  if (!std::isfinite(alpha) || !std::isfinite(beta) || !std::isfinite(gamma)) return false;
  const double before = plane->n.dot(window.center) + plane->d;
  const Vector3d anchor = window.center + (gamma - before) * plane->n;
  plane->n = (plane->n - alpha * window.a - beta * window.b).normalized();
  plane->d = -plane->n.dot(anchor);
  *step = std::max({std::abs(g), std::abs(alpha) * std::sqrt(uu), std::abs(beta) * std::sqrt(vv)});
  return true;
}

PlaneEstimate estimate_covariance(const LocalPlane& plane, const PlaneWindow& window,
                                  const kernels::Moments& full, const kernels::Moments& s,
                                  const Vector3d& up, bool systematic) {
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
  out.centroid -= plane.distance(out.centroid) * plane.n;
  out.plane.normal = plane.n;
  out.plane.offset = plane.d;

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
  const double points = std::max(full.count, 1.0);
  const double one = std::sqrt(full.count / std::max(full.weight, 1e-300));
  result.points = full.count;
  result.noise = one;
  Matrix3d covariance;
  if (points < 12.0) {
    // Too few residuals to tell their spread.
    covariance = Vector3d(1.0, 1.0, std::max(one * one, wide)).asDiagonal();
  } else {
    const Matrix3d inverse = hessian.inverse();
    covariance = inverse * spread * inverse.transpose() * (points / (points - 3.0));
    if (systematic) covariance(2, 2) += kSystematic * kSystematic * one * one;
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

  const bool line = !(thin > 1e-8 * wide) || !out.covariance.allFinite() ||
                    std::sqrt(thin) < 3.0 * one / std::sqrt(points);
  if (line) {
    // The plane through the line that is nearest to level.
    const Vector3d along = out.axis1;
    const Vector3d level = up - up.dot(along) * along;
    result.status = Status::kNotObservable;
    result.reason = "the points lie on a line";
    if (level.norm() > 1e-9) {
      out.plane.normal = level.normalized();
      out.plane.offset = -out.plane.normal.dot(out.centroid);
      out.axis2 = out.plane.normal.cross(along);
    }
    out.covariance =
        Vector3d(1.0, one * one / points / std::max(wide, 1e-300), one * one).asDiagonal();
    return result;
  }
  const double tilt = std::sqrt(std::max(out.covariance(0, 0), out.covariance(1, 1)));
  if (points < 12.0) {
    result.status = Status::kWeak;
    result.reason = fmt::format("only {} points lie on the plane", std::lround(points));
  } else if (tilt > kWeakTilt) {
    result.status = Status::kWeak;
    result.reason = fmt::format("the tilt's standard deviation is {:.3g} rad", tilt);
  } else {
    result.status = Status::kOk;
  }
  return result;
}

}  // namespace camber
