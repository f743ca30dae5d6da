#include "camber/plane/detail/repeated_values.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <utility>

#include "camber/plane/detail/plane_sample.h"

namespace camber::detail {
namespace {

struct Level {
  double value;
  std::size_t count;
};

/// Values that more than one of the points has, ascending.
std::vector<Level> shared_levels(std::vector<float> values) {
  std::sort(values.begin(), values.end());
  std::vector<Level> levels;
  for (auto at = values.begin(); at != values.end();) {
    const auto end = std::upper_bound(at, values.end(), *at);
    const auto count = static_cast<std::size_t>(end - at);
    if (count > 1) levels.push_back({static_cast<double>(*at), count});
    at = end;
  }
  return levels;
}

}  // namespace

double coordinate_step(const std::vector<float>& values, double rounding) {
  constexpr std::size_t kFewestLevels = 3, kSureLevels = 6;
  constexpr double kMostShare = 0.8, kNearlyAll = 0.98, kStray = 0.02;  // of the values
  constexpr double kTolerance = 0.05;                                   // of a step
  const std::vector<Level> levels = shared_levels(values);
  if (levels.size() < kFewestLevels) return 0.0;
  const double count = static_cast<double>(values.size());
  double shared = 0.0;
  for (const Level& level : levels) shared += static_cast<double>(level.count);
  if (shared < (levels.size() < kSureLevels ? kNearlyAll : kMostShare) * count) return 0.0;
  double step = levels.back().value - levels.front().value;
  for (std::size_t k = 1; k < levels.size(); ++k) {
    step = std::min(step, levels[k].value - levels[k - 1].value);
  }
  if (!(step > 8.0 * rounding)) return 0.0;
  // From the level with most values outwards, so that an error of the step stays small.
  const auto most =
      std::max_element(levels.begin(), levels.end(),
                       [](const Level& l, const Level& r) { return l.count < r.count; });
  double stray = 0.0;
  const auto walk = [&](std::ptrdiff_t direction) {
    for (auto at = most - levels.begin() + direction;
         at >= 0 && at < static_cast<std::ptrdiff_t>(levels.size()); at += direction) {
      const Level& level = levels[static_cast<std::size_t>(at)];
      const double away = std::abs(level.value - most->value), steps = std::round(away / step);
      if (std::abs(away - steps * step) > kTolerance * step + rounding) {
        stray += static_cast<double>(level.count);
      } else if (steps > 0.0) {
        step = away / steps;
      }
    }
  };
  walk(1);
  walk(-1);
  return stray > kStray * count ? 0.0 : step;
}

double take_copies(const PointColumns& source, std::vector<std::uint32_t>* rows) {
  constexpr std::size_t kRun = 64;      // rows beside one in which its copies are counted
  constexpr double kFewestPairs = 5.0;  // of far rows that show copies
  constexpr double kLeast = 1.05;
  constexpr std::size_t kFewestPlaces = 3;  // fewer carry no plane, and the caller names why
  const std::size_t n = source.size, count = rows->size();
  using Place = std::array<float, 3>;
  const auto place = [&](std::size_t row) {
    const std::size_t i = source.stride * row;
    return Place{source.x[i], source.y[i], source.z[i]};
  };
  const bool all = count + kRun >= n;
  double beside = 0.0, pairs = 0.0;
  std::vector<std::pair<Place, std::uint32_t>> sorted;
  sorted.reserve(count);
  for (const std::uint32_t row : *rows) {
    const Place own = place(row);
    sorted.emplace_back(own, row);
    if (all) continue;
    for (std::size_t r = row + 1; r < std::min<std::size_t>(n, row + kRun) && place(r) == own; ++r)
      beside += 1.0;
    for (std::size_t r = row; r > 0 && row - r + 1 < kRun && place(r - 1) == own; --r)
      beside += 1.0;
  }
  std::sort(sorted.begin(), sorted.end());
  std::vector<std::uint32_t> once;
  double before = 0.0;  // rows of this place
  for (std::size_t k = 0; k < count; ++k) {
    const auto& [own, row] = sorted[k];
    if (k == 0 || own != sorted[k - 1].first) {
      once.push_back(row);
      before = 0.0;
    } else if (all || row - sorted[k - 1].second >= kRun) {
      pairs += before;  // those nearer are counted as beside it
    }
    before += 1.0;
  }
  const double m = static_cast<double>(std::max<std::size_t>(count, 1));
  double copies = 1.0 + beside / m;
  if (all) copies += 2.0 * pairs / m;
  if (!all && pairs >= kFewestPairs) copies += 2.0 * pairs * static_cast<double>(n) / (m * m);
  if (copies < kLeast || once.size() < kFewestPlaces) return 1.0;
  std::sort(once.begin(), once.end());
  *rows = std::move(once);
  return copies;
}

void count_places_once(double copies, plane_kernels::Moments* influence) {
  // A place's copies err alike: their sum has the variance of `copies` times as many errors.
  for (double* sum : {&influence->i1, &influence->iu, &influence->iv, &influence->iuu,
                      &influence->iuv, &influence->ivv}) {
    *sum *= copies;
  }
}

double rounding_deviation(double step) { return step / std::sqrt(12.0); }

double shared_rounding(double step, double noise, double range) {
  if (!(step > 0.0)) return 0.0;
  const double deviation = rounding_deviation(step);
  const double before = std::sqrt(std::max(noise * noise - deviation * deviation, 0.0)) / step;
  // The first term of the sawtooth's Fourier series, which noise blurs least.
  const double blurred = std::exp(-2.0 * M_PI * M_PI * before * before);
  return deviation * blurred * std::min(1.0, step / (M_PI * std::max(range, 1e-300)));
}

}  // namespace camber::detail
