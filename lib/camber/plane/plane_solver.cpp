#include "camber/plane/plane_solver.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>

#include "camber/core/random.h"

namespace camber {

using Eigen::Matrix3d;
using Eigen::Vector3d;
namespace kernels = plane_kernels;

namespace {

constexpr double kRangeNoise = 0.01;  // relative, along unknown rays
constexpr double kRayTilt = 0.08;     // see UnknownRays

/// Ends of the range in which all but a share of the values at either end lie, from counts in bins,
/// anew inside that range while strays make it wide: ends that single points hardly move.
bool inner_range(const float* values, std::size_t n, double share, double* low, double* high) {
  constexpr std::size_t kBins = 512;
  float least = values[0], most = values[0];
  for (std::size_t i = 1; i < n; ++i) {
    least = std::min(least, values[i]);
    most = std::max(most, values[i]);
  }
  *low = static_cast<double>(least);
  *high = static_cast<double>(most);
  for (int zoom = 0; zoom < 6; ++zoom) {
    const double from = *low, width = (*high - from) / kBins;
    if (!(width > 0.0)) return false;
    std::array<std::uint32_t, kBins + 2> bins{};
    const float f = static_cast<float>(from), per_width = static_cast<float>(1.0 / width);
    for (std::size_t i = 0; i < n; ++i) {
      const float place = (values[i] - f) * per_width + 1.0f;
      ++bins[static_cast<std::uint32_t>(
          std::min(std::max(place, 0.0f), static_cast<float>(kBins + 1)))];
    }
    const auto end = [&](bool upper) {
      double rest = share * static_cast<double>(n);
      for (std::size_t k = 0; k < kBins + 2; ++k) {
        const std::size_t bin = upper ? kBins + 1 - k : k;
        const double count = static_cast<double>(bins[bin]);
        if (count > 0.0 && count >= rest) {
          const double inside = rest / count;
          return from + (static_cast<double>(bin) - 1.0 + (upper ? 1.0 - inside : inside)) * width;
        }
        rest -= count;
      }
      return from;
    };
    const double first = end(false), last = end(true);
    *low = first;
    *high = last;
    if (!(last > first)) return false;
    if (last - first > 0.1 * kBins * width) break;
    // A bin around it: its ends were found to a bin's width.
    *low -= width;
    *high += width;
  }
  return *high > *low;
}

/// Where along one axis the points lie evenly and on the plane: the run of places around which
/// there are at least 40 % as many points as where there are many, and whose mean residual stays
/// below one standard deviation; the run's ends come from quantiles of the points in it. Everything
/// here changes steadily with the points: places near the bounds count in part.
bool even_run(const float* along, const float* normalised, std::size_t n, double* low,
              double* high) {
  if (n < 200) return false;
  double first = 0.0, last = 0.0;
  if (!inner_range(along, n, 0.003, &first, &last)) return false;
  constexpr std::size_t kBins = 256;
  const double width = (last - first) / static_cast<double>(kBins);
  const float from = static_cast<float>(first), per_width = static_cast<float>(1.0 / width);
  // Bin 0 and the last hold what lies outside.
  const float last_place = static_cast<float>(kBins + 1);
  std::array<std::uint32_t, kBins + 2> number{};
  std::array<float, kBins + 2> residuals{};
  for (std::size_t i = 0; i < n; ++i) {
    const float place = (along[i] - from) * per_width + 1.0f;
    const auto bin = static_cast<std::uint32_t>(std::min(std::max(place, 0.0f), last_place));
    ++number[bin];
    residuals[bin] += normalised[i];
  }
  // Sums from the first bin on, and with them the points around a place: +- `reach` bins.
  std::array<double, kBins + 1> points{}, offsets{};
  for (std::size_t k = 0; k < kBins; ++k) {
    points[k + 1] = points[k] + static_cast<double>(number[k + 1]);
    offsets[k + 1] = offsets[k] + static_cast<double>(residuals[k + 1]);
  }
  const double pieces = std::clamp(static_cast<double>(n) / 40.0, 8.0, 64.0);
  const double reach = 0.5 * static_cast<double>(kBins) / pieces;
  const auto up_to = [](const std::array<double, kBins + 1>& sums, double place) {
    place = std::clamp(place, 0.0, static_cast<double>(kBins));
    const auto below = std::min(static_cast<std::size_t>(place), kBins - 1);
    return sums[below] + (place - static_cast<double>(below)) * (sums[below + 1] - sums[below]);
  };
  std::array<double, kBins> count{}, mean{}, share{};
  for (std::size_t k = 0; k < kBins; ++k) {
    // At the ends as many bins, on one side.
    const double middle =
        std::clamp(static_cast<double>(k) + 0.5, reach, static_cast<double>(kBins) - reach);
    count[k] = up_to(points, middle + reach) - up_to(points, middle - reach);
    mean[k] =
        count[k] > 0.0
            ? std::abs(up_to(offsets, middle + reach) - up_to(offsets, middle - reach)) / count[k]
            : 1e30;
  }
  std::array<double, kBins> ordered = count;
  const auto upper = ordered.begin() + kBins * 3 / 4;
  std::nth_element(ordered.begin(), upper, ordered.end());
  const double plateau = *upper;
  if (!(plateau > 0.0)) return false;
  for (std::size_t k = 0; k < kBins; ++k) {
    const double bound = std::max(1.0, 4.0 / std::sqrt(std::max(count[k], 1e-9)));
    share[k] = std::clamp((count[k] / plateau - 0.3) / 0.2, 0.0, 1.0) *
               std::clamp((1.25 - mean[k] / bound) / 0.5, 0.0, 1.0);
  }
  // A gap as short as the points around one place does not end it: a morphological closing.
  const auto gap = static_cast<std::size_t>(2.0 * reach) + 1;
  std::vector<double> closed(gap, 0.0);
  closed.insert(closed.end(), share.begin(), share.end());
  const auto slide = [&](bool most) {
    // In place: the extreme of [k, k + gap) for `most`, else of (k - gap, k].
    for (std::size_t done = 1; done < gap;) {
      const std::size_t step = std::min(done, gap - done);
      for (std::size_t i = step; i < closed.size(); ++i) {
        if (most) {
          closed[i - step] = std::max(closed[i - step], closed[i]);
        } else {
          const std::size_t k = closed.size() - 1 - (i - step);
          closed[k] = std::min(closed[k], closed[k - step]);
        }
      }
      done += step;
    }
  };
  slide(true);
  slide(false);
  closed.erase(closed.begin(), closed.begin() + static_cast<long>(gap));
  // The run with the most points.
  std::size_t best_begin = 0, best_end = 0;
  double best = 0.0;
  for (std::size_t k = 0; k < kBins;) {
    if (!(closed[k] > 0.5)) {
      ++k;
      continue;
    }
    std::size_t end = k;
    while (end < kBins && closed[end] > 0.5) ++end;
    const double inside = points[end] - points[k];
    if (inside > best) {
      best = inside;
      best_begin = k;
      best_end = end;
    }
    k = end;
  }
  if (best < 100.0) return false;
  // Outwards from its middle no place counts more than one before it.
  const double half = 0.5 * (points[best_begin] + points[best_end]);
  std::size_t center = best_begin;
  while (center + 1 < best_end && points[center + 1] < half) ++center;
  for (std::size_t k = center + 1; k < kBins; ++k) closed[k] = std::min(closed[k], closed[k - 1]);
  for (std::size_t k = center; k-- > 0;) closed[k] = std::min(closed[k], closed[k + 1]);
  double inside = 0.0, begin = static_cast<double>(center), end = begin;
  for (std::size_t k = 0; k < kBins; ++k) {
    inside += closed[k] * static_cast<double>(number[k + 1]);
    (k < center ? begin : end) += k < center ? -closed[k] : closed[k];
  }
  const auto quantile_of_run = [&](double part) {
    double rest = part * inside;
    for (std::size_t k = 0; k < kBins; ++k) {
      const double here = closed[k] * static_cast<double>(number[k + 1]);
      if (here > 0.0 && here >= rest) {
        return first + (static_cast<double>(k) + rest / here) * width;
      }
      rest -= here;
    }
    return last;
  };
  const double tenth = quantile_of_run(0.1), ninetieth = quantile_of_run(0.9);
  *low = std::max(first + begin * width, tenth - 0.125 * (ninetieth - tenth));
  *high = std::min(first + end * width, ninetieth + 0.125 * (ninetieth - tenth));
  return *high > *low;
}

/// Deviation of the points near a plane from a quadratic surface over it: curved ground is not
/// noise. That from the plane where there are too few points.
double curved_deviation(const PointArrays& s, std::size_t begin, std::size_t count,
                        const PivotPlane& plane, double deviation, double least) {
  using Vector6 = Eigen::Matrix<double, 6, 1>;
  using Matrix6 = Eigen::Matrix<double, 6, 6>;
  Vector3d a, b;
  UncertainPlane::make_axes(plane.n, Vector3d::UnitX(), &a, &b);
  const Vector3d from = s.point(begin);
  double out = deviation;
  Vector6 surface = Vector6::Zero();
  for (int round = 0; round < 2; ++round) {
    Matrix6 normal = Matrix6::Zero();
    Vector6 right = Vector6::Zero();
    double squares = 0.0, used = 0.0;
    for (std::size_t k = 0; k < count; ++k) {
      const Vector3d p = s.point(begin + k) - from;
      const double u = a.dot(p), v = b.dot(p), r = plane.distance(s.point(begin + k));
      Vector6 row;
      row << 1.0, u, v, u * u, u * v, v * v;
      if (!(std::abs(r - row.dot(surface)) < 3.0 * out)) continue;
      normal.selfadjointView<Eigen::Lower>().rankUpdate(row);
      right += r * row;
      squares += r * r;
      used += 1.0;
    }
    if (used < 10.0) return deviation;
    const Matrix6 full = normal.selfadjointView<Eigen::Lower>();
    const Eigen::LDLT<Matrix6> solver(full);
    const Vector6 solution = solver.solve(right);
    if (solver.info() != Eigen::Success || !solution.allFinite()) return deviation;
    surface = solution;
    const double rest = std::max(squares - solution.dot(right), 0.0);
    out = std::max(std::sqrt(rest / (used - 6.0)), least);
  }
  return std::min(out, deviation);
}

/// A set's points as seen from a plane and its window: see kernels::project.
struct Projection {
  std::vector<float> normalised, u, v;  // with the padding
  Projection(const PointArrays& s, const PlaneCandidate& c)
      : normalised(s.x.size()), u(s.x.size()), v(s.x.size()) {
    update(s, c);
  }
  void update(const PointArrays& s, const PlaneCandidate& c) {
    kernels::project(s.x.data(), s.y.data(), s.z.data(), s.w.data(), s.x.size(), c.plane.as_float(),
                     c.window.as_float(), normalised.data(), u.data(), v.data());
  }
};

/// Re-estimates the noise from the residuals of the refined plane inside its window.
/// @param power  of the factor to the deviations found: 1, less to change them less
void rescale_noise(PointArrays* points, double least_noise, double power, PlaneCandidate* c,
                   Projection* projection) {
  const PointArrays& s = *points;
  points->weigh(c->noise, c->plane);
  projection->update(s, *c);
  std::vector<float>& normalised = projection->normalised;
  const float half_u = static_cast<float>(c->window.half_u),
              half_v = static_cast<float>(c->window.half_v);
  std::size_t filled = 0;
  for (std::size_t k = 0; k < s.size; ++k) {
    const float r = normalised[k];
    normalised[filled] = r;
    filled += (std::abs(projection->u[k]) <= half_u) & (std::abs(projection->v[k]) <= half_v) &
                      (r < 1e29f)
                  ? 1
                  : 0;
  }
  const bool same = c->noise.kind == NoiseKind::kSame;
  // Fewer residuals measure less, and so few nothing.
  const bool learnt = same || c->noise.kind == NoiseKind::kPower;
  const double few = learnt ? 20.0 : 150.0, enough = learnt ? 100.0 : 250.0;
  const double trust = std::clamp((static_cast<double>(filled) - few) / (enough - few), 0.0, 1.0);
  if (!(trust > 0.0)) return;
  double factor = std::clamp(core_deviation(normalised.data(), filled, 1.0, 6.0), 0.3, 4.0);
  factor = std::pow(factor, power * trust);
  if (same) factor = std::max(factor, least_noise / c->noise.scale);
  c->noise.rescale(factor);
}

}  // namespace

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
  for (std::size_t begin = 0; begin < n; begin += kernels::kBlock) {
    kernels::accumulate(s.x.data() + begin, s.y.data() + begin, s.z.data() + begin,
                        s.w.data() + begin, std::min(kernels::kBlock, n - begin), plane.as_float(),
                        window.as_float(), static_cast<float>(limit), loss, influence, &moments);
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

UnknownRays unknown_rays(const PointArrays& s, const PivotPlane& plane, const PlaneWindow& window) {
  const kernels::FloatPlane p = plane.as_float();
  const kernels::Window w = window.as_float();
  const float steep_u = 1.0f / w.ramp_u, steep_v = 1.0f / w.ramp_v;
  struct Sums {
    double one = 0, x = 0, xx = 0, xxx = 0, xxxx = 0, v = 0, vx = 0, vxx = 0;
    void add(double share, double place, double square) {
      const double place2 = place * place;
      one += share;
      x += share * place;
      xx += share * place2;
      xxx += share * place2 * place;
      xxxx += share * place2 * place2;
      v += share * square;
      vx += share * square * place;
      vxx += share * square * place2;
    }
  };
  Sums along, across;
  double weight = 0.0;
  constexpr float kLimit = static_cast<float>(kInlierSigmas * kInlierSigmas);
  for (std::size_t k = 0; k < s.size; ++k) {
    const float r = p.nx * s.x[k] + p.ny * s.y[k] + p.nz * s.z[k] + p.d;
    const float u = w.ax * s.x[k] + w.ay * s.y[k] + w.az * s.z[k] + w.a0;
    const float v = w.bx * s.x[k] + w.by * s.y[k] + w.bz * s.z[k] + w.b0;
    const float taper = std::clamp((w.half_u - std::abs(u)) * steep_u, 0.0f, 1.0f) *
                        std::clamp((w.half_v - std::abs(v)) * steep_v, 0.0f, 1.0f);
    const float share = r * r * s.w[k] < kLimit && s.w[k] > 0.0f ? taper : 0.0f;
    if (!(share > 0.0f)) continue;
    // Each point's share of the fit, and its square in units of its own variance.
    const double d = static_cast<double>(share), square = static_cast<double>(r * r * s.w[k]);
    weight += d * static_cast<double>(s.w[k]);
    along.add(d, static_cast<double>(u), square);
    across.add(d, static_cast<double>(v), square);
  }
  UnknownRays out;
  if (along.one < 20.0 || !(along.v > 0.0)) return out;
  const double noise = std::sqrt(along.v / weight);
  out.rise = kRangeNoise * noise;
  if (window.half_u > 1e14 || along.one < 200.0) return out;
  // How much the variance changes along an axis, relative to its mean: root mean square of the
  // quadratic that fits it best.
  const auto slope = [&](const Sums& sums) {
    const double n = sums.one, x = sums.x / n, xx = sums.xx / n, xxx = sums.xxx / n,
                 xxxx = sums.xxxx / n;
    Eigen::Matrix2d spread;
    spread << xx - x * x, xxx - x * xx, xxx - x * xx, xxxx - xx * xx;
    const Eigen::Vector2d change(sums.vx / sums.v - x, sums.vxx / sums.v - xx);
    if (!(spread.determinant() > 0.0)) return 0.0;
    // Less what chance makes of even noise, two free parameters.
    const double change2 = change.dot(spread.inverse() * change) - 3.0 / n;
    return kRayTilt * noise * std::sqrt(std::max(change2, 0.0) / spread(0, 0));
  };
  out.slope_u = slope(along);
  out.slope_v = slope(across);
  return out;
}

PlaneEstimate estimate_covariance(const PivotPlane& plane, const PlaneWindow& window,
                                  const kernels::Moments& full, const kernels::Moments& s,
                                  const Vector3d& up, const std::optional<UnknownRays>& rays,
                                  double shared) {
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
  const double points = std::max(full.count, 1.0);
  const double one = std::sqrt(full.count / std::max(full.weight, 1e-300));
  result.points = full.count;
  result.noise = one;
  Matrix3d covariance;
  if (points < 12.0) {
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
    if (shared > 0.0 && thin > 0.0) {
      // As one point's at a root mean square distance from the middle, along either axis.
      covariance.topLeftCorner<2, 2>() += shared * shared * scatter.inverse();
      covariance(2, 2) += shared * shared;
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

  // Sums in float distinguish the two to about 1e-6.
  const bool line = !(thin > 1e-6 * wide) || !out.covariance.allFinite() ||
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

KeyedDraws::KeyedDraws() { clear(); }

void KeyedDraws::clear() {
  key_.fill(~static_cast<std::uint64_t>(0));
  row_.fill(kNone);
}

void KeyedDraws::add(std::uint64_t key, std::uint32_t row) {
  const std::size_t slot = key >> 56;
  if (row_[slot] != kNone && key >= key_[slot]) return;
  key_[slot] = key;
  row_[slot] = row;
}

std::uint32_t KeyedDraws::draw(std::uint64_t bits) const {
  std::size_t slot = bits >> 56;
  while (row_[slot] == kNone) slot = (slot + 1) % kSlots;
  return row_[slot];
}

namespace {

/// About the quantile at 0.35: the mean of a range, which no single value decides.
/// @param sorted  not empty
double mean_of_quiet(const std::vector<float>& sorted) {
  const double count = static_cast<double>(sorted.size());
  double sum = 0.0, weight = 0.0;
  for (std::size_t k = 0; k < sorted.size(); ++k) {
    // How much of the k-th of the parts of [0, 1] lies within the range.
    const double share = std::min(static_cast<double>(k + 1), 0.45 * count) -
                         std::max(static_cast<double>(k), 0.25 * count);
    sum += std::max(share, 0.0) * static_cast<double>(sorted[k]);
    weight += std::max(share, 0.0);
  }
  return sum / weight;
}

/// That of the neighbourhoods' deviations. Where most neighbourhoods lie on no plane at all (trees
/// and facades around a scanner) that of the others, which are quieter by far.
/// @param values  not empty
double typical_of(std::vector<float> values) {
  constexpr double kByFar = 4.0;
  constexpr std::size_t kFewest = 3;
  std::sort(values.begin(), values.end());
  for (;;) {
    const double typical = mean_of_quiet(values);
    const auto below = static_cast<std::size_t>(
        std::lower_bound(values.begin(), values.end(), static_cast<float>(typical)) -
        values.begin());
    if (below < kFewest || below == values.size() ||
        !(typical > kByFar * static_cast<double>(values[below / 2]))) {
      return typical;
    }
    values.resize(below);
  }
}

}  // namespace

void learn_local_noise(const PointArrays& s,
                       const std::vector<std::pair<std::size_t, std::size_t>>& leaves,
                       const std::vector<std::uint64_t>& keys, const Vector3d& up, double max_tilt,
                       double least, std::uint64_t seed, NoiseModel* model) {
  constexpr std::size_t kMostLeaves = 36;
  constexpr int kSamples = 9;
  const std::size_t step = keys.empty() ? std::max<std::size_t>(1, leaves.size() / kMostLeaves) : 1;
  std::vector<float> deviations;
  std::vector<std::pair<std::size_t, std::size_t>> measured;  // rows of each
  std::vector<std::pair<float, float>> pairs;                 // sigma, |residual|
  std::vector<float> residuals, sorted;
  const double least_cosine = std::cos(std::min(max_tilt, 1.5));
  for (std::size_t leaf = step / 2; leaf < leaves.size(); leaf += step) {
    const auto [begin, end] = leaves[leaf];
    const std::size_t m = end - begin;
    if (m < 6) continue;
    const CounterRandom random(seed, keys.empty() ? 1000 + leaf : 1000);
    KeyedDraws draws;
    for (std::size_t k = 0; k < m && !keys.empty(); ++k) {
      draws.add(keys[begin + k], static_cast<std::uint32_t>(k));
    }
    std::uint64_t counter = 0;
    const auto draw = [&]() -> std::size_t {
      const std::uint64_t index = counter++;
      return keys.empty() ? random.below(index, m) : draws.draw(random.bits(index));
    };
    PivotPlane best;
    double best_quantile = std::numeric_limits<double>::infinity();
    const auto measure = [&, first = begin](const PivotPlane& plane) {
      const kernels::FloatPlane p = plane.as_float();
      residuals.resize(m);
      for (std::size_t k = 0; k < m; ++k) {
        residuals[k] = p.nx * s.x[first + k] + p.ny * s.y[first + k] + p.nz * s.z[first + k] + p.d;
      }
    };
    for (int sample = 0; sample < kSamples; ++sample) {
      const std::size_t i = draw(), j = draw(), k = draw();
      const Vector3d p = s.point(begin + i);
      const Vector3d cross = (s.point(begin + j) - p).cross(s.point(begin + k) - p);
      const double norm = cross.norm();
      if (!(norm > 0.0)) continue;
      PivotPlane plane;
      plane.n = cross / norm;
      if (std::abs(plane.n.dot(up)) < least_cosine) continue;
      plane.d = -plane.n.dot(p);
      measure(plane);
      // No lower quantile with no more residuals below the best so far.
      std::size_t below = 0;
      const float bound = static_cast<float>(best_quantile);
      for (std::size_t q = 0; q < m; ++q) below += std::abs(residuals[q]) < bound ? 1 : 0;
      if (below <= static_cast<std::size_t>(0.45 * static_cast<double>(m))) continue;
      sorted.resize(m);
      for (std::size_t q = 0; q < m; ++q) sorted[q] = std::abs(residuals[q]);
      const double q = quantile(sorted, 0.45);
      if (q < best_quantile) {
        best_quantile = q;
        best = plane;
      }
    }
    if (!std::isfinite(best_quantile)) continue;
    // Refit on the points near it; twice, for the first scale comes from a lucky sample.
    double deviation = std::max(best_quantile / 0.5978, least);  // 45 % of |N(0, 1)|
    std::size_t used = 0;
    for (int round = 0; round < 2; ++round) {
      measure(best);
      Vector3d mean = Vector3d::Zero();
      Matrix3d scatter = Matrix3d::Zero();
      used = 0;
      for (std::size_t k = 0; k < m; ++k) {
        if (std::abs(static_cast<double>(residuals[k])) > 3.0 * deviation) continue;
        const Vector3d p = s.point(begin + k) - s.point(begin);
        mean += p;
        scatter += p * p.transpose();
        ++used;
      }
      if (used < 5) break;
      mean /= static_cast<double>(used);
      scatter -= static_cast<double>(used) * mean * mean.transpose();
      Eigen::SelfAdjointEigenSolver<Matrix3d> solver;
      solver.computeDirect(scatter);
      best.n = solver.eigenvectors().col(0);
      best.d = -best.n.dot(mean + s.point(begin));
      const double free = static_cast<double>(used) - 3.0;
      deviation = std::max(std::sqrt(std::max(solver.eigenvalues()[0], 0.0) / free), least);
    }
    if (used < 5) continue;
    deviation = curved_deviation(s, begin, m, best, deviation, least);
    deviations.push_back(static_cast<float>(deviation));
    measured.emplace_back(begin, end);
    if (model->kind == NoiseKind::kPower) {
      measure(best);
      for (std::size_t k = 0; k < m; ++k) {
        const float sigma = s.sigma[begin + k];
        if (sigma > 1e-12f && sigma < 1e12f) pairs.emplace_back(sigma, std::abs(residuals[k]));
      }
    }
  }
  const double typical = deviations.empty() ? least : std::max(typical_of(deviations), least);
  if (model->kind == NoiseKind::kSame) {
    model->scale = typical;
    return;
  }
  model->kind = NoiseKind::kIsotropic;
  model->scale = 1.0;
  if (!learn_power_law(pairs, typical, least, model)) return;
  // The law's shape is that of all neighbourhoods, its size that of the quiet ones.
  std::vector<float> ratios;
  for (std::size_t k = 0; k < measured.size(); ++k) {
    const auto [begin, end] = measured[k];
    double squares = 0.0, count = 0.0;
    for (std::size_t row = begin; row < end; ++row) {
      const double sigma = static_cast<double>(s.sigma[row]);
      if (!(sigma > 1e-12 && sigma < 1e12)) continue;
      const double deviation = model->scale * std::pow(sigma, model->exponent);
      squares += deviation * deviation;
      count += 1.0;
    }
    if (squares > 0.0) {
      ratios.push_back(deviations[k] / static_cast<float>(std::sqrt(squares / count)));
    }
  }
  if (ratios.empty()) return;
  std::sort(ratios.begin(), ratios.end());
  model->rescale(mean_of_quiet(ratios));
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

void refine_and_window(PointArrays* points, const Vector3d& up, double least_noise,
                       bool fixed_noise, PlaneCandidate* c, bool again) {
  const PointArrays& s = *points;
  if (again && c->window.half_u > 1e14) return;
  Projection projection(s, *c);
  if (!again) {
    refine_candidate(points, up, c);
    if (!fixed_noise) {
      rescale_noise(points, least_noise, 1.0, c, &projection);
      refine_candidate(points, up, c, true);
    }
  }
  std::vector<float>&u = projection.u, &v = projection.v, &normalised = projection.normalised;
  // With few points the window opens, over a range of their number so that none of them decides.
  constexpr double kManyInWindow = 600.0, kSteady = 200.0;
  double open = 0.0;
  for (int round = again ? 1 : 0; round < 2; ++round) {
    points->weigh(c->noise, c->plane);
    const PlaneWindow wide = c->window;
    projection.update(s, *c);
    std::size_t filled = 0;
    // Axes: the principal directions of the inliers.
    double su = 0, sv = 0, suu = 0, suv = 0, svv = 0;
    const float most_u = round > 0 ? static_cast<float>(1.3 * wide.half_u) : 2e15f,
                most_v = round > 0 ? static_cast<float>(1.3 * wide.half_v) : 2e15f;
    for (std::size_t k = 0; k < s.size; ++k) {
      // Without branches: whether a row counts is hard to predict.
      const float a = u[k], b = v[k], r = normalised[k];
      u[filled] = a;
      v[filled] = b;
      normalised[filled] = r;
      filled += (std::abs(r) < 3.0f) & (std::abs(a) <= most_u) & (std::abs(b) <= most_v) ? 1 : 0;
    }
    if (round == 0)
      open = std::clamp((kManyInWindow - static_cast<double>(filled)) / kSteady, 0.0, 1.0);
    if (!(open < 1.0)) return;
    for (std::size_t k = 0; k < filled; ++k) {
      const double a = static_cast<double>(u[k]), b = static_cast<double>(v[k]);
      su += a;
      sv += b;
      suu += a * a;
      suv += a * b;
      svv += b * b;
    }
    const double count = static_cast<double>(filled);
    const double cuu = suu - su * su / count, cuv = suv - su * sv / count,
                 cvv = svv - sv * sv / count;
    const double angle = 0.5 * std::atan2(2.0 * cuv, cuu - cvv);
    const double cosine = std::cos(angle), sine = std::sin(angle);
    const float fc = static_cast<float>(cosine), fs = static_cast<float>(sine);
    for (std::size_t k = 0; k < filled; ++k) {
      const float a = u[k], b = v[k];
      u[k] = fc * a + fs * b;
      v[k] = -fs * a + fc * b;
    }
    double low, high, left, right;
    if (!even_run(u.data(), normalised.data(), filled, &low, &high)) return;
    // Across: only of the points within the run along.
    const float from = static_cast<float>(low), to = static_cast<float>(high);
    std::size_t inside = 0;
    for (std::size_t k = 0; k < filled; ++k) {
      v[inside] = v[k];
      normalised[inside] = normalised[k];
      inside += (u[k] >= from) & (u[k] <= to) ? 1 : 0;
    }
    if (!even_run(v.data(), normalised.data(), inside, &left, &right)) return;
    PlaneWindow& window = c->window;
    window.a = cosine * wide.a + sine * wide.b;
    window.b = -sine * wide.a + cosine * wide.b;
    window.center = wide.center + 0.5 * (low + high) * window.a + 0.5 * (left + right) * window.b;
    // Nothing at the very edges, full weight from 14 % inwards.
    window.half_u = 0.48 * (high - low) / (1.0 - open);
    window.half_v = 0.48 * (right - left) / (1.0 - open);
    window.ramp_u = 0.12 * (high - low) / (1.0 - open);
    window.ramp_v = 0.12 * (right - left) / (1.0 - open);
    if (!again) refine_candidate(points, up, c, true);
    if (fixed_noise) continue;
    rescale_noise(points, least_noise, 1.0 - open, c, &projection);
    if (!again) refine_candidate(points, up, c, true);
  }
}

}  // namespace camber
