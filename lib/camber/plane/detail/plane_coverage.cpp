#include "camber/plane/detail/plane_coverage.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <optional>
#include <vector>

namespace camber::detail {

using Eigen::Vector3d;
namespace kernels = plane_kernels;

namespace {

/// Ends of the range in which all but a share of the values at either end lie, from counts in bins,
/// anew inside that range while strays make it wide: ends that single points hardly move.
bool inner_range(const float* values, std::size_t n, double share, double* low, double* high) {
  constexpr std::size_t kFine = 512;
  float least = values[0], most = values[0];
  for (std::size_t i = 1; i < n; ++i) {
    least = std::min(least, values[i]);
    most = std::max(most, values[i]);
  }
  *low = static_cast<double>(least);
  *high = static_cast<double>(most);
  for (int zoom = 0; zoom < 6; ++zoom) {
    const double from = *low, width = (*high - from) / kFine;
    if (!(width > 0.0)) return false;
    std::array<std::uint32_t, kFine + 2> bins{};
    const float f = static_cast<float>(from), per_width = static_cast<float>(1.0 / width);
    for (std::size_t i = 0; i < n; ++i) {
      const float place = (values[i] - f) * per_width + 1.0f;
      ++bins[static_cast<std::uint32_t>(
          std::min(std::max(place, 0.0f), static_cast<float>(kFine + 1)))];
    }
    const auto end = [&](bool upper) {
      double rest = share * static_cast<double>(n);
      for (std::size_t k = 0; k < kFine + 2; ++k) {
        const std::size_t bin = upper ? kFine + 1 - k : k;
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
    if (last - first > 0.1 * kFine * width) break;
    // A bin around it: its ends were found to a bin's width.
    *low -= width;
    *high += width;
  }
  return *high > *low;
}

constexpr std::size_t kBins = 256;  // places along an axis

/// Points and the sums of their residuals by place along an axis, without what lies outside.
struct BinnedPoints {
  std::array<double, kBins> number{};
  // Sums from the first place on.
  std::array<double, kBins + 1> points{}, offsets{};
};

BinnedPoints bin_points(const float* along, const float* normalised, std::size_t n, double first,
                        double width) {
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
  BinnedPoints out;
  for (std::size_t k = 0; k < kBins; ++k) {
    out.number[k] = static_cast<double>(number[k + 1]);
    out.points[k + 1] = out.points[k] + out.number[k];
    out.offsets[k + 1] = out.offsets[k] + static_cast<double>(residuals[k + 1]);
  }
  return out;
}

/// How far each place belongs to ground that is covered and on the plane, 0 to 1, from the points
/// within `reach` places of it; false where there are no points.
bool evenness(const BinnedPoints& bins, double reach, std::array<double, kBins>* share) {
  const auto up_to = [](const std::array<double, kBins + 1>& sums, double place) {
    place = std::clamp(place, 0.0, static_cast<double>(kBins));
    const auto below = std::min(static_cast<std::size_t>(place), kBins - 1);
    return sums[below] + (place - static_cast<double>(below)) * (sums[below + 1] - sums[below]);
  };
  std::array<double, kBins> count{}, mean{};
  for (std::size_t k = 0; k < kBins; ++k) {
    // At the ends as many bins, on one side.
    const double middle =
        std::clamp(static_cast<double>(k) + 0.5, reach, static_cast<double>(kBins) - reach);
    count[k] = up_to(bins.points, middle + reach) - up_to(bins.points, middle - reach);
    mean[k] =
        count[k] > 0.0
            ? std::abs(up_to(bins.offsets, middle + reach) - up_to(bins.offsets, middle - reach)) /
                  count[k]
            : 1e30;
  }
  std::array<double, kBins> ordered = count;
  const auto upper = ordered.begin() + kBins * 3 / 4;
  std::nth_element(ordered.begin(), upper, ordered.end());
  const double plateau = *upper;
  if (!(plateau > 0.0)) return false;
  for (std::size_t k = 0; k < kBins; ++k) {
    const double bound = std::max(1.0, 4.0 / std::sqrt(std::max(count[k], 1e-9)));
    (*share)[k] = std::clamp((count[k] / plateau - 0.3) / 0.2, 0.0, 1.0) *
                  std::clamp((1.25 - mean[k] / bound) / 0.5, 0.0, 1.0);
  }
  return true;
}

/// A morphological closing: fills dips shorter than `gap` places.
std::vector<double> close_gaps(const std::array<double, kBins>& share, std::size_t gap) {
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
  return closed;
}

/// The middle, by points, of the run of places that holds the most; none with fewer than 100.
std::optional<std::size_t> middle_of_longest(const BinnedPoints& bins,
                                             const std::vector<double>& closed) {
  const std::array<double, kBins + 1>& points = bins.points;
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
  if (best < 100.0) return std::nullopt;
  const double half = 0.5 * (points[best_begin] + points[best_end]);
  std::size_t center = best_begin;
  while (center + 1 < best_end && points[center + 1] < half) ++center;
  return center;
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
  const double width = (last - first) / static_cast<double>(kBins);
  const BinnedPoints bins = bin_points(along, normalised, n, first, width);
  const double pieces = std::clamp(static_cast<double>(n) / 40.0, 8.0, 64.0);
  const double reach = 0.5 * static_cast<double>(kBins) / pieces;
  std::array<double, kBins> share{};
  if (!evenness(bins, reach, &share)) return false;
  // A gap as short as the points around one place does not end it.
  std::vector<double> closed = close_gaps(share, static_cast<std::size_t>(2.0 * reach) + 1);
  const std::optional<std::size_t> middle = middle_of_longest(bins, closed);
  if (!middle) return false;
  // Outwards from its middle no place counts more than one before it.
  const std::size_t center = *middle;
  for (std::size_t k = center + 1; k < kBins; ++k) closed[k] = std::min(closed[k], closed[k - 1]);
  for (std::size_t k = center; k-- > 0;) closed[k] = std::min(closed[k], closed[k + 1]);
  double inside = 0.0, begin = static_cast<double>(center), end = begin;
  for (std::size_t k = 0; k < kBins; ++k) {
    inside += closed[k] * bins.number[k];
    (k < center ? begin : end) += k < center ? -closed[k] : closed[k];
  }
  const auto quantile_of_run = [&](double part) {
    double rest = part * inside;
    for (std::size_t k = 0; k < kBins; ++k) {
      const double here = closed[k] * bins.number[k];
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

/// A set's points as seen from a plane and its window: see kernels::project.
struct Projection {
  std::vector<float> normalised, u, v;  // with the padding
  Projection(const PointArrays& s, const PlaneCandidate& c)
      : normalised(s.x.size()), u(s.x.size()), v(s.x.size()) {
    update(s, c);
  }
  void update(const PointArrays& s, const PlaneCandidate& c) {
    kernels::project({s.x.data(), s.y.data(), s.z.data(), s.w.data(), s.x.size()},
                     c.plane.as_float(), c.window.as_float(), normalised.data(), u.data(),
                     v.data());
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

}  // namespace camber::detail
