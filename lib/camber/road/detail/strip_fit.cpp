#include "camber/road/detail/strip_fit.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "camber/core/median.h"
#include "camber/core/threads.h"

namespace camber::detail {

namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kHuber = 1.5;  // sigmas, beyond which the loss grows linearly
constexpr double kTrim = 4.5;   // sigmas, beyond which a point does not count
constexpr double kLeastBend = 1e-3, kMostBend = 1e5;
constexpr int kBendRounds = 3;
constexpr double kLeastNoise = 1e-4;  // m: rounding of the coordinates at least

}  // namespace

StripFit::StripFit(const StripGrid& grid, const std::vector<StripPoint>& points, double least_trim)
    : smoother_(grid, points), points_(points), least_trim_(least_trim) {}

bool StripFit::solve(const StripRoughness& roughness) {
  smoother_.set_data(used_, heights_);
  return smoother_.used() >= 6 && smoother_.solve(roughness, noise_);
}

void StripFit::reweigh(bool trim) {
  std::vector<double> off(points_.size(), 0.0), sizes;
  for (std::size_t i = 0; i < points_.size(); ++i) {
    const StripPoint& point = points_[i];
    used_[i] = smoother_.inside(point);
    if (!used_[i]) continue;
    off[i] = (point.z - smoother_.height(point.s, point.v)) * std::sqrt(point.weight);
    sizes.push_back(std::abs(off[i]));
  }
  const double scale = std::max(kLeastNoise, kSigmaFromMad * upper_median(&sizes));
  const double most =
      trim ? std::max(least_trim_, kTrim * scale) : std::numeric_limits<double>::infinity();
  const double bound = kHuber * scale;
  double count = 0.0, within = 0.0, squares = 0.0;
  for (std::size_t i = 0; i < points_.size(); ++i) {
    if (!used_[i]) continue;
    if (std::abs(off[i]) > most) {
      used_[i] = 0;
      continue;
    }
    count += 1.0;
    within += std::abs(off[i]) <= bound;
    squares += std::pow(std::clamp(off[i], -bound, bound), 2);
  }
  const double share = std::max(0.5, within / std::max(1.0, count));
  for (std::size_t i = 0; i < points_.size(); ++i) {
    if (!used_[i]) continue;
    const double pseudo = std::clamp(off[i], -bound, bound) / share;
    heights_[i] = points_[i].z + (pseudo - off[i]) / std::sqrt(points_[i].weight);
  }
  const double freedom = std::max(0.1 * count, count - smoother_.degrees_of_freedom());
  noise_ = std::max(kLeastNoise, std::sqrt(squares / freedom) / share);
}

bool StripFit::fit(const StripRoughness& roughness) {
  constexpr int kRounds = 5;
  if (heights_.empty()) {
    used_.assign(points_.size(), 0);
    heights_.resize(points_.size());
    for (std::size_t i = 0; i < points_.size(); ++i) {
      used_[i] = smoother_.inside(points_[i]);
      heights_[i] = points_[i].z;
    }
  }
  for (int round = 0; round < kRounds; ++round) {
    if (!solve(roughness)) return false;
    reweigh(round >= 1);
  }
  return solve(roughness);
}

std::vector<double> StripFit::seen_across(double first, std::size_t count) const {
  std::vector<double> out(2 * count, 0.0);
  for (std::size_t i = 0; i < points_.size(); ++i) {
    if (!used_[i]) continue;
    const StripPoint& point = points_[i];
    for (const double s : {std::floor(point.s - first), std::ceil(point.s - first)}) {
      if (!(s >= 0.0) || s >= static_cast<double>(count)) continue;
      double& seen = out[2 * static_cast<std::size_t>(s) + (point.v > 0.0 ? 1 : 0)];
      seen = std::max(seen, std::abs(point.v));
    }
  }
  return out;
}

StripRoughness estimate_roughness(std::vector<StripFit>* fits, const StripRoughness* start,
                                  int num_threads) {
  StripRoughness best = start ? *start : StripRoughness();
  if (!start) best.level = best.tilt = 3e-3;
  constexpr std::size_t kParameters = 6;
  using Logs = std::array<double, kParameters>;
  const Logs low = {std::log(1e-9), std::log(1e-11), std::log(1e-7),
                    std::log(2.0),  std::log(1e-5),  std::log(1e-5)};
  const Logs high = {std::log(1e-1),   std::log(1e-2), std::log(10.0),
                     std::log(1000.0), std::log(1.0),  std::log(0.1)};
  // One of them, or roughness from the smooth part into the one that fades.
  constexpr std::array<Logs, kParameters + 2> kDirections = {{{1, 0, 0, 0, 0, 0},
                                                              {0, 1, 0, 0, 0, 0},
                                                              {0, 0, 1, 0, 0, 0},
                                                              {0, 0, 0, 1, 0, 0},
                                                              {0, 0, 0, 0, 1, 0},
                                                              {0, 0, 0, 0, 0, 1},
                                                              {-1, 0, 0, 0, 1, 0},
                                                              {0, -1, 0, 0, 0, 1}}};
  const auto roughness_of = [&](const Logs& logs) {
    StripRoughness out = best;
    out.along = std::exp(logs[0]);
    out.twist = std::exp(logs[1]);
    out.across = std::exp(logs[2]);
    out.length = std::exp(logs[3]);
    out.level = std::exp(logs[4]);
    out.tilt = std::exp(logs[5]);
    return out;
  };
  Logs logs = {std::log(best.along),  std::log(best.twist), std::log(best.across),
               std::log(best.length), std::log(best.level), std::log(best.tilt)};
  std::vector<double> parts(fits->size());
  const auto deviance = [&](const Logs& at) {
    parallel_for(fits->size(), num_threads, [&](std::size_t i) {
      StripFit& fit = (*fits)[i];
      parts[i] = fit.smoother().used() < 6 ? 0.0
                 : fit.smoother().solve(roughness_of(at), fit.noise())
                     ? fit.smoother().deviance()
                     : std::numeric_limits<double>::infinity();
    });
    double sum = 0.0;
    for (const double part : parts) sum += part;
    return sum;
  };
  // Factors by place: expectation and maximisation.
  const auto update_bends = [&] {
    std::vector<std::vector<double>> energies(fits->size());
    std::vector<double> counts(fits->size(), 0.0);
    parallel_for(fits->size(), num_threads, [&](std::size_t i) {
      StripSmoother& smoother = (*fits)[i].smoother();
      if (smoother.used() < 6 || !smoother.solve(roughness_of(logs), (*fits)[i].noise())) return;
      smoother.add_bends(&energies[i], &counts[i]);
    });
    std::vector<double> sums;
    double count = 0.0;
    for (std::size_t i = 0; i < fits->size(); ++i) {
      sums.resize(std::max(sums.size(), energies[i].size()), 0.0);
      for (std::size_t j = 0; j < energies[i].size(); ++j) sums[j] += energies[i][j];
      count += counts[i];
    }
    if (!(count > 0.0)) return;
    for (double& sum : sums) sum = std::clamp(sum / count, kLeastBend, kMostBend);
    best.bends = sums;
  };
  // Compass search, in rounds between which the pseudo-data follow the fit.
  std::vector<std::vector<double>> rounds = {{1.0, 0.5}, {0.5, 0.25}};
  if (!start) rounds.insert(rounds.begin(), {2.0, 1.0});
  for (const std::vector<double>& steps : rounds) {
    parallel_for(fits->size(), num_threads,
                 [&](std::size_t i) { (*fits)[i].fit(roughness_of(logs)); });
    double least = deviance(logs);
    for (const double step : steps) {
      for (bool moved = true; moved;) {
        moved = false;
        for (const Logs& direction : kDirections) {
          for (const double sign : {1.0, -1.0}) {
            bool better = true;
            while (better) {
              Logs next = logs;
              for (std::size_t k = 0; k < kParameters; ++k) {
                next[k] = std::clamp(next[k] + sign * step * direction[k], low[k], high[k]);
              }
              if (next == logs) break;
              const double there = deviance(next);
              better = there < least - 0.1;
              if (better) {
                logs = next;
                least = there;
                moved = true;
              }
            }
          }
        }
      }
    }
    for (int i = 0; i < kBendRounds; ++i) update_bends();
  }
  return roughness_of(logs);
}

Edge find_edge(const std::function<double(double)>& height, double seen, double noise) {
  constexpr double kStep = 0.125, kFirst = 1.0, kBefore = 0.4, kLength = 2.5;
  constexpr double kLeast = 0.05, kNone = 0.02;   // m off the line of what lies inside
  constexpr double kSteep = 0.25, kSharp = 0.25;  // m, and rise over run against that line
  const double least = kLeast + 0.5 * noise;
  for (double v = kFirst + kBefore; v <= seen; v += kStep) {
    const double to = v - kBefore, from = std::max(0.0, to - kLength);
    // Least squares.
    double n = 0.0, x = 0.0, z = 0.0, xx = 0.0, xz = 0.0;
    for (double at = from; at <= to + 1e-9; at += kStep) {
      const double here = height(at);
      n += 1.0;
      x += at;
      z += here;
      xx += at * at;
      xz += at * here;
    }
    const double slope = (n * xz - x * z) / (n * xx - x * x), level = (z - slope * x) / n;
    const auto off = [&](double at) { return std::abs(height(at) - level - slope * at); };
    if (!(off(v) > least) || !(off(std::min(seen, v + kStep)) > least)) continue;
    // A kerb, a ditch or a bank is steep; ground that bends is still the road's.
    double steepest = 0.0;
    for (double at = to; at + kSteep <= std::min(seen, v + kSteep) + 1e-9; at += kStep) {
      steepest = std::max(steepest, std::abs((height(at + kSteep) - height(at)) / kSteep - slope));
    }
    if (!(steepest > kSharp)) continue;
    double edge = v;
    while (edge > to && off(edge) > kNone) edge -= 0.25 * kStep;
    return {edge, level, slope};
  }
  return {};
}

double refine_edge(const Edge& edge, const std::vector<SidePoint>& points, double noise) {
  constexpr double kBefore = 0.5, kBeyond = 0.75, kFar = 0.3;  // m about the edge
  constexpr double kNone = 0.02;
  constexpr std::size_t kFew = 4;
  struct Off {
    double distance, off;
  };
  std::vector<Off> near;
  std::vector<double> far;
  for (const SidePoint& point : points) {
    const double beyond = point.distance - edge.distance;
    if (beyond < -kBefore || beyond > kBeyond) continue;
    near.push_back({point.distance, point.height - edge.level - edge.slope * point.distance});
    if (beyond > kFar) far.push_back(near.back().off);
  }
  if (far.size() < kFew || near.size() < 3 * kFew) return edge.distance;
  const double level = upper_median(&far), sign = level < 0.0 ? -1.0 : 1.0;
  const double bound = std::min(0.5 * std::abs(level), kNone + 1.5 * noise);
  if (!(bound > 0.5 * kNone)) return edge.distance;
  std::sort(near.begin(), near.end(),
            [](const Off& a, const Off& b) { return a.distance < b.distance; });
  // The fewest points that are on the wrong side.
  long wrong = 0;
  for (const Off& point : near) wrong += sign * point.off < bound ? 1 : 0;
  long least = wrong;
  double first = near.front().distance, last = first;
  for (std::size_t i = 0; i < near.size(); ++i) {
    wrong += sign * near[i].off < bound ? -1 : 1;
    const double next = i + 1 < near.size() ? near[i + 1].distance : near[i].distance;
    const double between = 0.5 * (near[i].distance + next);
    if (wrong < least) {
      least = wrong;
      first = last = between;
    } else if (wrong == least) {
      last = between;
    }
  }
  return 0.5 * (first + last);
}

void smooth_edges(std::vector<double>* edges) {
  constexpr std::size_t kHalf = 3;
  const std::size_t count = edges->size();
  std::vector<double> medians(count);
  for (std::size_t k = 0; k < count; ++k) {
    std::vector<double> near;
    for (std::size_t j = k < kHalf ? 0 : k - kHalf; j <= std::min(count - 1, k + kHalf); ++j) {
      near.push_back(std::isfinite((*edges)[j]) ? (*edges)[j]
                                                : std::numeric_limits<double>::infinity());
    }
    medians[k] = upper_median(&near);
  }
  for (std::size_t k = 0; k < count; ++k) {
    (*edges)[k] = kNaN;
    if (!std::isfinite(medians[k])) continue;
    double sum = 0.0, n = 0.0;
    for (std::size_t j = k < kHalf ? 0 : k - kHalf; j <= std::min(count - 1, k + kHalf); ++j) {
      if (!std::isfinite(medians[j])) continue;
      sum += medians[j];
      n += 1.0;
    }
    (*edges)[k] = sum / n;
  }
}

}  // namespace camber::detail
