#include "camber/scale/detail/bar_finder.h"

#include <cmath>
#include <limits>

#include "camber/core/threads.h"

namespace camber::detail {
namespace {

constexpr double kNearest = 2.0, kFarthest = 75.0;  // m
constexpr double kWidest = 15.0;                    // m to each side

/// Mean intensity between two columns, pixel u covering [u - 0.5, u + 0.5].
double mean(const std::vector<float>& sum, double from, double to) {
  const auto upto = [&](double x) {
    const double y = std::clamp(x + 0.5, 0.0, static_cast<double>(sum.size() - 1));
    const auto i = std::min(static_cast<std::size_t>(y), sum.size() - 2);
    const double f = y - static_cast<double>(i);
    return (1.0 - f) * sum[i] + f * sum[i + 1];
  };
  return (upto(to) - upto(from)) / (to - from);
}

}  // namespace

std::vector<float> BarFinder::sums(int v) const {
  std::vector<float> out(static_cast<std::size_t>(image_.width) + 1);
  const std::uint8_t* row = image_.row(v);
  float sum = 0.0F;
  for (int u = 0; u < image_.width; ++u) {
    out[static_cast<std::size_t>(u)] = sum;
    sum += row[u];
  }
  out.back() = sum;
  return out;
}

float BarFinder::contrast(const std::vector<float>& sum, double u, double bar) const {
  const double half = 0.5 * bar, gap = half + 0.75, side = std::max(1.5, 0.75 * bar);
  if (u - gap - side < 0 || u + gap + side > image_.width - 1) {
    return std::numeric_limits<float>::quiet_NaN();
  }
  const double middle = mean(sum, u - half, u + half);
  const double left = mean(sum, u - gap - side, u - gap);
  const double right = mean(sum, u + gap, u + gap + side);
  return static_cast<float>(middle - std::max(left, right));
}

std::vector<Bar> BarFinder::row(int v, bool repeated) const {
  const std::vector<float> sum = sums(v);
  std::vector<float> contrasts(static_cast<std::size_t>(image_.width),
                               std::numeric_limits<float>::quiet_NaN());
  for (int u = 0; u < image_.width; ++u) {
    const double rho = inverse_depth(u, v);
    if (rho > 1.0 / kFarthest && rho < 1.0 / kNearest && visible(u, v) &&
        std::abs(u - camera_.cx) < kWidest * camera_.fx * rho) {
      contrasts[static_cast<std::size_t>(u)] = contrast(sum, u, width_px(rho));
    }
  }
  std::vector<Bar> out;
  std::vector<float> around;
  for (std::size_t u = 1; u + 1 < contrasts.size(); ++u) {
    const float before = contrasts[u - 1], here = contrasts[u], next = contrasts[u + 1];
    if (!(here >= kLeastContrast && here > before && here >= next)) continue;
    // The spread of contrasts within two metres of the quieter side: on the other may be a car.
    const double reach = std::max(16.0, 2.0 * camera_.fx * inverse_depth(static_cast<int>(u), v));
    const auto step = static_cast<int>(std::max(1.0, reach / 40.0));
    // A bar's own edges reach into the contrasts beside it.
    const int flank = 2 + static_cast<int>(2.0 * width_px(inverse_depth(static_cast<int>(u), v)));
    float noise = std::numeric_limits<float>::infinity();
    for (const int side : {-1, 1}) {
      around.clear();
      for (int k = flank; k <= static_cast<int>(reach); k += step) {
        const int x = static_cast<int>(u) + side * k;
        if (x < 0 || x >= image_.width) break;
        const float c = contrasts[static_cast<std::size_t>(x)];
        if (std::isfinite(c)) around.push_back(c);
      }
      if (around.size() < 8) continue;
      const auto at = [&](double share) {
        const auto k = static_cast<std::ptrdiff_t>(share * static_cast<double>(around.size() - 1));
        std::nth_element(around.begin(), around.begin() + k, around.end());
        return around[static_cast<std::size_t>(k)];
      };
      noise = std::min(noise, std::max(1.0F, (at(0.75) - at(0.25)) / 1.35F));
    }
    if (here < (repeated ? 2.0F * kLeastContrast : 3.5F * noise)) continue;
    const float bend = before - 2.0F * here + next;
    const float shift = bend < 0 ? std::clamp(0.5F * (before - next) / bend, -0.5F, 0.5F) : 0.0F;
    out.push_back({static_cast<float>(u) + shift, here, noise});
  }
  return out;
}

std::vector<std::vector<Bar>> find_bars(const BarFinder& finder, int top, int height, bool repeated,
                                        int num_threads) {
  const auto rows = static_cast<std::size_t>(std::max(0, height - top));
  std::vector<std::vector<Bar>> out(rows);
  parallel_for((rows + 15) / 16, num_threads, [&](std::size_t band) {
    for (std::size_t k = 16 * band; k < std::min(rows, 16 * (band + 1)); ++k) {
      out[k] = finder.row(top + static_cast<int>(k), repeated);
    }
  });
  return out;
}

}  // namespace camber::detail
