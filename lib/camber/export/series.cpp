#include <algorithm>
#include <cmath>

#include "camber/export/detail/series.h"

namespace camber::detail {

void bridge(std::vector<double>* values) {
  std::size_t last = values->size();
  for (std::size_t i = 0; i < values->size(); ++i) {
    if (!std::isfinite((*values)[i])) continue;
    const double here = (*values)[i];
    const std::size_t from = last == values->size() ? 0 : last + 1;
    for (std::size_t k = from; k < i; ++k) {
      const double share = last == values->size()
                               ? 1.0
                               : static_cast<double>(k - last) / static_cast<double>(i - last);
      (*values)[k] = last == values->size() ? here : (1.0 - share) * (*values)[last] + share * here;
    }
    last = i;
  }
  if (last == values->size()) {
    std::fill(values->begin(), values->end(), 0.0);
  } else {
    std::fill(values->begin() + static_cast<long>(last) + 1, values->end(), (*values)[last]);
  }
}

std::vector<double> smoothed(const std::vector<double>& values, std::size_t half) {
  const auto n = static_cast<long>(values.size()), h = static_cast<long>(half);
  std::vector<double> out(values.size());
  for (long i = 0; i < n; ++i) {
    double w = 0.0, x = 0.0, y = 0.0, xx = 0.0, xy = 0.0;
    for (long k = std::max(0L, i - h); k <= std::min(n - 1, i + h); ++k) {
      const double d = static_cast<double>(k - i), v = values[static_cast<std::size_t>(k)];
      w += 1.0, x += d, y += v, xx += d * d, xy += d * v;
    }
    const double det = w * xx - x * x;
    out[static_cast<std::size_t>(i)] = det > 1e-9 ? (y * xx - x * xy) / det : y / w;
  }
  return out;
}

}  // namespace camber::detail
