#include "camber/plane/detail/plane_sample.h"

#include <algorithm>
#include <cmath>

#include "camber/core/random.h"
#include "camber/plane/detail/repeated_values.h"
#include "camber/plane/noise_model.h"

namespace camber::detail {

using Eigen::Vector3d;

namespace {

constexpr std::size_t kOrdered = 4096;  // of the subset, points in order of neighbourhood
constexpr std::size_t kScored = 2048;   // of those, points that score a hypothesis
constexpr std::size_t kLeaf = 32;       // points of a neighbourhood that shows the noise

/// Rays that met nothing: many sensors' drivers write all three coordinates as 0. A few such points
/// may be of the surface; more would be a surface without noise.
void drop_no_returns(const PointColumns& source, std::vector<std::uint32_t>* rows) {
  constexpr std::ptrdiff_t kFew = 3;
  const auto zero = [&](std::uint32_t row) {
    const std::size_t i = source.stride * row;
    return source.x[i] == 0.0f && source.y[i] == 0.0f && source.z[i] == 0.0f;
  };
  if (std::count_if(rows->begin(), rows->end(), zero) <= kFew) return;
  rows->erase(std::remove_if(rows->begin(), rows->end(), zero), rows->end());
}

/// Rows of the subset: one from each of equal slices of the input; of a small cloud all that are
/// usable.
std::vector<std::uint32_t> draw_rows(const PointColumns& source, std::uint64_t seed) {
  const std::size_t n = source.size;
  const CounterRandom random(seed, 1);
  const auto finite = [&](std::size_t i) {
    const float x = source.x[source.stride * i], y = source.y[source.stride * i],
                z = source.z[source.stride * i];
    return std::abs(x) < 1e15f && std::abs(y) < 1e15f && std::abs(z) < 1e15f;
  };
  std::vector<std::uint32_t> chosen;
  if (n > kPlaneSample) {
    // One from each of equal slices of the input, fetched from memory well ahead of its use.
    constexpr std::size_t kAhead = 24;
    const double slice = static_cast<double>(n) / static_cast<double>(kPlaneSample);
    const auto pick = [&](std::size_t k) {
      return std::min(
          n - 1, static_cast<std::size_t>((static_cast<double>(k) + random.uniform(k)) * slice));
    };
    std::array<std::size_t, kAhead> coming;
    for (std::size_t k = 0; k < kAhead; ++k) coming[k] = pick(k);
    chosen.reserve(kPlaneSample);
    for (std::size_t k = 0; k < kPlaneSample; ++k) {
      const std::size_t i = coming[k % kAhead];
      if (k + kAhead < kPlaneSample) {
        const std::size_t next = coming[k % kAhead] = pick(k + kAhead);
        __builtin_prefetch(source.x + source.stride * next);
        if (source.stride == 1) {
          __builtin_prefetch(source.y + next);
          __builtin_prefetch(source.z + next);
        }
      }
      if (finite(i)) chosen.push_back(static_cast<std::uint32_t>(i));
    }
  }
  if (n <= kPlaneSample || chosen.size() < kPlaneSample / 2) {
    // Few points, or few usable ones among many: from all that are usable.
    chosen.clear();
    for (std::size_t i = 0; i < n; ++i) {
      if (finite(i)) chosen.push_back(static_cast<std::uint32_t>(i));
    }
    if (chosen.size() > kPlaneSample) {
      const double slice = static_cast<double>(chosen.size()) / static_cast<double>(kPlaneSample);
      std::vector<std::uint32_t> fewer;
      for (std::size_t k = 0; k < kPlaneSample; ++k) {
        const auto i =
            static_cast<std::size_t>((static_cast<double>(k) + random.uniform(k)) * slice);
        fewer.push_back(chosen[std::min(i, chosen.size() - 1)]);
      }
      chosen = fewer;
    }
  }
  drop_no_returns(source, &chosen);
  return chosen;
}

/// Orders rows so that those near each other in it are near in space.
class NeighbourhoodOrder {
 public:
  /// @param level   level coordinates of all rows
  /// @param rows    to be ordered
  /// @param leaves  receives ranges of `rows`
  NeighbourhoodOrder(const std::vector<std::array<float, 2>>& level,
                     std::vector<std::uint32_t>* rows,
                     std::vector<std::pair<std::size_t, std::size_t>>* leaves)
      : level_(level), rows_(*rows), leaves_(*leaves) {}

  void split(std::size_t begin, std::size_t end);

 private:
  const std::vector<std::array<float, 2>>& level_;
  std::vector<std::uint32_t>& rows_;
  std::vector<std::pair<std::size_t, std::size_t>>& leaves_;
};

/// Halves at about the median of the wider of two level directions until about kLeaf are left.
void NeighbourhoodOrder::split(std::size_t begin, std::size_t end) {
  if (end - begin <= kLeaf * 3 / 2) {
    leaves_.emplace_back(begin, end);
    return;
  }
  // Width and middle from a few points: far strays must not decide.
  constexpr std::size_t kLook = 21;
  std::array<float, kLook> look[2];
  for (std::size_t j = 0; j < kLook; ++j) {
    const std::uint32_t k = rows_[begin + (end - begin) * (2 * j + 1) / (2 * kLook)];
    look[0][j] = level_[k][0];
    look[1][j] = level_[k][1];
  }
  std::sort(look[0].begin(), look[0].end());
  std::sort(look[1].begin(), look[1].end());
  const std::size_t axis =
      look[0][kLook - 2] - look[0][1] >= look[1][kLook - 2] - look[1][1] ? 0 : 1;
  const float middle = look[axis][kLook / 2];
  std::size_t cut = begin;
  for (std::size_t k = begin; k < end; ++k) {
    const std::uint32_t row = rows_[k];
    rows_[k] = rows_[cut];
    rows_[cut] = row;
    cut += level_[row][axis] < middle ? 1 : 0;
  }
  // Many equal coordinates leave one side empty.
  if (cut - begin < (end - begin) / 8 || end - cut < (end - begin) / 8) {
    cut = begin + (end - begin) / 2;
  }
  split(begin, cut);
  split(cut, end);
}

}  // namespace

bool choose_subset(const PointColumns& source, std::uint64_t seed, PlaneSample* sample) {
  std::vector<std::uint32_t> chosen = draw_rows(source, seed);
  sample->copies = take_copies(source, &chosen);
  const std::size_t usable = sample->usable = chosen.size();
  if (usable < 3) return false;

  PointArrays& s = sample->subset;
  s.resize(usable, source.sigma != nullptr, source.covariance != nullptr);
  for (std::size_t k = 0; k < usable; ++k) {
    const std::size_t i = source.stride * chosen[k];
    s.x[k] = source.x[i];
    s.y[k] = source.y[i];
    s.z[k] = source.z[i];
    s.w[k] = 1.0f;
  }
  if (source.sigma) {
    for (std::size_t k = 0; k < usable; ++k) s.sigma[k] = source.sigma[chosen[k]];
  }
  if (source.covariance) {
    for (std::size_t k = 0; k < usable; ++k) s.covariance[k] = source.covariance[chosen[k]];
  }
  // The pivot: medians, which no far point can move.
  const std::size_t step = std::max<std::size_t>(1, usable / 1024);
  std::vector<float> values;
  std::vector<float>* coordinates[3] = {&s.x, &s.y, &s.z};
  for (int axis = 0; axis < 3; ++axis) {
    values.clear();
    for (std::size_t k = 0; k < usable; k += step) values.push_back((*coordinates[axis])[k]);
    sample->pivot[axis] = static_cast<float>(quantile(values, 0.5));
    for (std::size_t k = 0; k < usable; ++k) (*coordinates[axis])[k] -= sample->pivot[axis];
  }
  values.clear();
  for (std::size_t k = 0; k < usable; k += step) {
    values.push_back(static_cast<float>(s.point(k).norm()));
  }
  sample->spread = quantile(values, 0.9);
  if (!(sample->spread > 0.0)) {
    for (std::size_t k = 0; k < usable; ++k)
      sample->spread = std::max(sample->spread, s.point(k).norm());
  }
  // Rounding of the input, and of the sums in float.
  const double magnitude =
      static_cast<double>(std::max(
          {std::abs(sample->pivot[0]), std::abs(sample->pivot[1]), std::abs(sample->pivot[2])})) +
      sample->spread;
  sample->least_noise = std::max(1.2e-7 * magnitude, 4e-7 * sample->spread);
  return true;
}

void order_by_neighbourhood(const Vector3d& up, PlaneSample* sample) {
  Vector3d e1, e2;
  UncertainPlane::make_axes(up, std::abs(up.x()) < 0.9 ? Vector3d::UnitX() : Vector3d::UnitY(), &e1,
                            &e2);
  std::vector<std::array<float, 2>> level(sample->usable);
  const auto f = [](double value) { return static_cast<float>(value); };
  const float ax = f(e1.x()), ay = f(e1.y()), az = f(e1.z()), bx = f(e2.x()), by = f(e2.y()),
              bz = f(e2.z());
  for (std::size_t k = 0; k < sample->usable; ++k) {
    level[k] = {ax * sample->subset.x[k] + ay * sample->subset.y[k] + az * sample->subset.z[k],
                bx * sample->subset.x[k] + by * sample->subset.y[k] + bz * sample->subset.z[k]};
  }
  const std::size_t step = (sample->usable + kOrdered - 1) / kOrdered;
  std::vector<std::uint32_t> order;
  for (std::size_t k = 0; k < sample->usable; k += step)
    order.push_back(static_cast<std::uint32_t>(k));
  NeighbourhoodOrder(level, &order, &sample->leaves).split(0, order.size());
  sample->ordered.take(sample->subset, order);
  const std::size_t skip = (order.size() + kScored - 1) / kScored;
  std::vector<std::uint32_t> rows;
  for (std::size_t k = skip / 2; k < order.size(); k += skip) rows.push_back(order[k]);
  sample->scored.take(sample->subset, rows);
}

}  // namespace camber::detail
