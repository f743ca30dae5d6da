#include "camber/photometric/detail/direct_kernels.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "camber/core/random.h"

namespace camber {
namespace {

constexpr int kWidth = 37, kRows = 19;

std::vector<float> drawn() {
  const CounterRandom random(11);
  std::vector<float> out;
  for (std::uint64_t k = 0; k < kWidth * kRows; ++k) {
    out.push_back(static_cast<float>(random.uniform(k, -1.0, 1.0)));
  }
  return out;
}

std::vector<ColumnSpan> whole_rows() { return std::vector<ColumnSpan>(kRows, {0, kWidth}); }

int mirrored(int i, int count) { return i < 0 ? -i : i < count ? i : 2 * (count - 1) - i; }

TEST(DirectKernels, WindowSumsMirrorTheRim) {
  const std::vector<float> values = drawn();
  std::vector<float> sums(values.size()), squares(values.size());
  window_sums(kWidth, whole_rows(), values.data(), 21, 13, sums.data(), squares.data());
  for (int y = 0; y < kRows; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      double sum = 0.0, square = 0.0;
      for (int v = y - 6; v <= y + 6; ++v) {
        for (int u = x - 10; u <= x + 10; ++u) {
          const double value =
              values[static_cast<std::size_t>(mirrored(v, kRows) * kWidth + mirrored(u, kWidth))];
          sum += value;
          square += value * value;
        }
      }
      const auto at = static_cast<std::size_t>(y * kWidth + x);
      EXPECT_NEAR(sums[at], sum, 1e-4) << x << " " << y;
      EXPECT_NEAR(squares[at], square, 1e-4) << x << " " << y;
    }
  }
}

TEST(DirectKernels, BlursByItsSigmaAndKeepsConstants) {
  std::vector<float> values(kWidth * kRows, 5.0F), out(values.size());
  blur_plane(kWidth, whole_rows(), values.data(), 1.5, out.data());
  for (const float value : out) EXPECT_NEAR(value, 5.0, 1e-5);
  values.assign(values.size(), 0.0F);
  values[9 * kWidth + 18] = 1.0F;
  blur_plane(kWidth, whole_rows(), values.data(), 1.5, out.data());
  const auto at = [&](int x, int y) { return out[static_cast<std::size_t>(y * kWidth + x)]; };
  EXPECT_NEAR(at(20, 9) / at(18, 9), std::exp(-0.5 * 4.0 / 2.25), 1e-4);
  EXPECT_NEAR(at(18, 12) / at(18, 9), std::exp(-0.5 * 9.0 / 2.25), 1e-4);
}

TEST(DirectKernels, SpansGetTheValuesOfWholeRows) {
  const std::vector<float> values = drawn();
  std::vector<ColumnSpan> spans;
  for (int y = 0; y < kRows; ++y) spans.push_back({(5 * y) % 30, (5 * y) % 30 + y % 8});
  std::vector<float> whole[3], parts[3];
  for (std::size_t k = 0; k < 3; ++k) {
    whole[k].assign(values.size(), -9.0F);
    parts[k].assign(values.size(), -9.0F);
  }
  window_sums(kWidth, whole_rows(), values.data(), 21, 13, whole[0].data(), whole[1].data());
  window_sums(kWidth, spans, values.data(), 21, 13, parts[0].data(), parts[1].data());
  blur_plane(kWidth, whole_rows(), values.data(), 1.5, whole[2].data());
  blur_plane(kWidth, spans, values.data(), 1.5, parts[2].data());
  for (int y = 0; y < kRows; ++y) {
    const ColumnSpan span = spans[static_cast<std::size_t>(y)];
    for (int x = 0; x < kWidth; ++x) {
      const auto at = static_cast<std::size_t>(y * kWidth + x);
      const bool wanted = x >= span.from && x < span.to;
      for (std::size_t k = 0; k < 3; ++k) {
        EXPECT_EQ(parts[k][at], wanted ? whole[k][at] : -9.0F) << k << " " << x << " " << y;
      }
    }
  }
}

TEST(DirectKernels, GradientsOfTheMeanOfTwoPlanes) {
  std::vector<float> a, b;
  for (int y = 0; y < 3; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      a.push_back(2.0F * static_cast<float>(x) - 3.0F * static_cast<float>(y));
      b.push_back(4.0F * static_cast<float>(x) + 1.0F * static_cast<float>(y));
    }
  }
  const float* of_a[3] = {a.data(), a.data() + kWidth, a.data() + 2 * kWidth};
  const float* of_b[3] = {b.data(), b.data() + kWidth, b.data() + 2 * kWidth};
  std::vector<float> by_x(kWidth), by_y(kWidth);
  gradient_row(kWidth, of_a, of_b, by_x.data(), by_y.data());
  for (std::size_t x = 1; x + 1 < kWidth; ++x) {
    EXPECT_NEAR(by_x[x], 3.0, 1e-4);
    EXPECT_NEAR(by_y[x], -1.0, 1e-4);
  }
}

}  // namespace
}  // namespace camber
