#include "camber/scale/speed_noise.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>

namespace camber {
namespace {

// The independent part f of the stated variance. Up to 1 it is a share, f = sin^2(angle) with all
// angles alike (Jeffreys' prior of a share: most sensors are the one or the other); beyond, where
// the samples scatter more than is stated, it falls with its square as far as five standard
// deviations.
constexpr int kShares = 12;
constexpr std::array<double, 9> kExcess = {1.0, 1.25, 1.6, 2.0, 3.0, 4.0, 6.0, 9.0, 25.0};
constexpr double kExcessPrior = 0.25;  ///< probability of the latter
/// A stated variance that the scatter exceeds this much is none of the scatter's: all of it may be
/// common.
constexpr double kNotItsOwn = 2.0;
/// m/s^2 in a second, random walk of the acceleration: cruising, in traffic, braking.
constexpr std::array<double, 3> kRoughness = {0.05, 0.2, 0.8};
constexpr double kPi = 3.14159265358979323846;
constexpr double kAcceleration = 3.0;  ///< m/s^2, standard deviation before anything is known

/// Logarithm of the samples' likelihood, but for a constant.
double log_likelihood(const std::vector<TimedSpeed>& samples, double independent,
                      double roughness) {
  const double q = roughness * roughness;
  double speed = samples[0].speed, acceleration = 0.0;
  double p00 = independent * samples[0].sigma * samples[0].sigma, p01 = 0.0,
         p11 = kAcceleration * kAcceleration;
  double sum = 0.0;
  for (std::size_t i = 1; i < samples.size(); ++i) {
    const double h = samples[i].time_s - samples[i - 1].time_s;
    speed += h * acceleration;
    p00 += h * (2.0 * p01 + h * p11) + q * h * h * h / 3.0;
    p01 += h * p11 + q * h * h / 2.0;
    p11 += q * h;
    const double variance = p00 + independent * samples[i].sigma * samples[i].sigma;
    const double innovation = samples[i].speed - speed;
    sum -= 0.5 * (std::log(variance) + innovation * innovation / variance);
    const double k0 = p00 / variance, k1 = p01 / variance;
    speed += k0 * innovation;
    acceleration += k1 * innovation;
    p11 -= k1 * p01;
    p01 -= k0 * p01;
    p00 -= k0 * p00;
  }
  return sum;
}

}  // namespace

SpeedNoise speed_noise(const std::vector<TimedSpeed>& samples) {
  for (std::size_t i = 0; i < samples.size(); ++i) {
    const TimedSpeed& s = samples[i];
    if (!(s.sigma > 0.0) || !std::isfinite(s.speed) ||
        (i > 0 && !(s.time_s > samples[i - 1].time_s))) {
      throw std::invalid_argument(
          fmt::format("speed {} m/s +- {} at {} s, expected a positive sigma and ascending times",
                      s.speed, s.sigma, s.time_s));
    }
  }
  if (samples.size() < 3) return {};
  struct Cell {
    double independent, common, prior;
  };
  std::vector<Cell> cells;
  for (int i = 0; i < kShares; ++i) {
    const double sine = std::sin(0.5 * kPi * (i + 0.5) / kShares);
    cells.push_back({sine * sine, 1.0 - sine * sine, (1.0 - kExcessPrior) / kShares});
  }
  for (std::size_t i = 0; i + 1 < kExcess.size(); ++i) {
    const double from = kExcess[i], to = kExcess[i + 1];
    cells.push_back({std::sqrt(from * to), from < kNotItsOwn ? 0.0 : 1.0,
                     kExcessPrior * (1.0 / from - 1.0 / to)});
  }
  std::vector<double> logs;
  for (const Cell& cell : cells) {
    for (const double roughness : kRoughness) {
      logs.push_back(log_likelihood(samples, cell.independent, roughness));
    }
  }
  const double best = *std::max_element(logs.begin(), logs.end());
  double total = 0.0;
  SpeedNoise out{0.0, 0.0};
  for (std::size_t i = 0; i < logs.size(); ++i) {
    const Cell& cell = cells[i / kRoughness.size()];
    const double weight = cell.prior * std::exp(logs[i] - best);
    total += weight;
    out.independent += weight * cell.independent;
    out.common += weight * cell.common;
  }
  out.independent /= total;
  out.common /= total;
  return out;
}

}  // namespace camber
