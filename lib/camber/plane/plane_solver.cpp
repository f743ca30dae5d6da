#include "camber/plane/plane_solver.h"

#include <algorithm>
#include <cmath>

namespace camber {

using Eigen::Vector3d;
namespace kernels = plane_kernels;

plane_kernels::FloatPlane PivotPlane::as_float() const {
  return {static_cast<float>(n.x()), static_cast<float>(n.y()), static_cast<float>(n.z()),
          static_cast<float>(d)};
}

plane_kernels::Window PlaneWindow::as_float() const {
  const auto f = [](double value) { return static_cast<float>(value); };
  return {f(a.x()), f(a.y()),          f(a.z()),  f(-a.dot(center)), f(b.x()),  f(b.y()),
          f(b.z()), f(-b.dot(center)), f(half_u), f(half_v),         f(ramp_u), f(ramp_v)};
}

void align(const PivotPlane& plane, PlaneWindow* window) {
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

void PointArrays::weigh(const NoiseModel& noise, const PivotPlane& plane) {
  std::fill(w.begin(), w.begin() + static_cast<long>(size), 1.0f);
  noise.weigh(plane.n, plane.d, size, x.data(), y.data(), z.data(), sigma.data(), covariance.data(),
              w.data());
}

kernels::Moments sum_moments(const PointArrays& s, const PivotPlane& plane,
                             const PlaneWindow& window, double limit, kernels::Loss loss,
                             bool influence) {
  kernels::Moments moments;
  const std::size_t n = kernels::padded(s.size);
  const kernels::Target target = {plane.as_float(), window.as_float(), static_cast<float>(limit)};
  for (std::size_t begin = 0; begin < n; begin += kernels::kBlock) {
    kernels::accumulate({s.x.data() + begin, s.y.data() + begin, s.z.data() + begin,
                         s.w.data() + begin, std::min(kernels::kBlock, n - begin)},
                        target, loss, influence, &moments);
  }
  return moments;
}

bool solve_step(const kernels::Moments& m, const PlaneWindow& window, PivotPlane* plane,
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

void refine_candidate(PointArrays* points, const Vector3d& up, PlaneCandidate* c, bool near) {
  constexpr double kLimit = kBiweight * kBiweight;
  for (int round = 0; round < 12; ++round) {
    align(c->plane, &c->window);
    points->weigh(c->noise, c->plane);
    PivotPlane next = c->plane;
    double step = 0.0;
    const bool newton = near || round >= 2;
    kernels::Moments moments =
        sum_moments(*points, c->plane, c->window, kLimit,
                    newton ? kernels::Loss::kNewton : kernels::Loss::kReweighted, false);
    const double unit = std::sqrt(std::max(moments.count, 1.0) / std::max(moments.weight, 1e-300));
    bool solved = solve_step(moments, c->window, &next, &step);
    if (newton && (!solved || step > unit)) {
      next = c->plane;
      moments =
          sum_moments(*points, c->plane, c->window, kLimit, kernels::Loss::kReweighted, false);
      solved = solve_step(moments, c->window, &next, &step);
    }
    if (!solved) break;
    c->plane = next;
    // Newton's step over all points comes after this; its error is of second order.
    if (step < 0.03 * unit / std::sqrt(std::max(moments.count, 1.0))) break;
  }
  if (c->plane.n.dot(up) < 0.0) {
    c->plane.n = -c->plane.n;
    c->plane.d = -c->plane.d;
  }
  align(c->plane, &c->window);
}

}  // namespace camber
