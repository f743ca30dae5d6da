#include "camber/core/random.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <vector>

namespace camber {
namespace {

TEST(CounterRandom, DependsOnSeedStreamAndIndexAlone) {
  const CounterRandom a(1), b(1), other_seed(2), other_stream(1, 1);
  std::vector<std::uint64_t> forward;
  for (std::uint64_t i = 0; i < 100; ++i) forward.push_back(a.bits(i));
  for (std::uint64_t i = 100; i-- > 0;) EXPECT_EQ(b.bits(i), forward[i]);
  int equal = 0;
  for (std::uint64_t i = 0; i < 100; ++i) {
    equal += other_seed.bits(i) == forward[i] ? 1 : 0;
    equal += other_stream.bits(i) == forward[i] ? 1 : 0;
  }
  EXPECT_EQ(equal, 0);
  EXPECT_EQ(std::set<std::uint64_t>(forward.begin(), forward.end()).size(), 100u);
}

TEST(CounterRandom, UniformFillsItsIntervalEvenly) {
  const CounterRandom random(5);
  constexpr int kCells = 20, kDraws = 100000;
  std::vector<int> cells(kCells, 0);
  for (std::uint64_t i = 0; i < kDraws; ++i) {
    const double value = random.uniform(i);
    ASSERT_GE(value, 0.0);
    ASSERT_LT(value, 1.0);
    ++cells[static_cast<std::size_t>(value * kCells)];
    const double scaled = random.uniform(i, -3.0, 5.0);
    ASSERT_GE(scaled, -3.0);
    ASSERT_LT(scaled, 5.0);
  }
  double chi_square = 0.0;
  for (const int count : cells) {
    const double expected = static_cast<double>(kDraws) / kCells;
    chi_square += (count - expected) * (count - expected) / expected;
  }
  EXPECT_LT(chi_square, 43.8);  // 19 degrees of freedom, exceeded once in a thousand
}

TEST(CounterRandom, BelowStaysBelowAndReachesAll) {
  const CounterRandom random(6);
  std::set<std::uint64_t> seen;
  for (std::uint64_t i = 0; i < 1000; ++i) {
    const std::uint64_t value = random.below(i, 7);
    ASSERT_LT(value, 7u);
    seen.insert(value);
    EXPECT_EQ(random.below(i, 1), 0u);
    EXPECT_LT(random.below(i, UINT64_MAX), UINT64_MAX);
  }
  EXPECT_EQ(seen.size(), 7u);
}

TEST(CounterRandom, NormalHasTheMomentsOfTheNormalDistribution) {
  const CounterRandom random(7);
  constexpr std::uint64_t kDraws = 200000;
  double sum = 0.0, squares = 0.0, fourths = 0.0;
  int beyond = 0;
  for (std::uint64_t i = 0; i < kDraws; ++i) {
    const double value = random.normal(i);
    ASSERT_TRUE(std::isfinite(value));
    sum += value;
    squares += value * value;
    fourths += value * value * value * value;
    beyond += std::abs(value) > 1.959964 ? 1 : 0;
  }
  // Four standard deviations of each estimate over 200,000 draws.
  EXPECT_NEAR(sum / kDraws, 0.0, 4.0 * 0.00224);
  EXPECT_NEAR(squares / kDraws, 1.0, 4.0 * 0.00316);
  EXPECT_NEAR(fourths / kDraws, 3.0, 4.0 * 0.0219);
  EXPECT_NEAR(static_cast<double>(beyond) / kDraws, 0.05, 4.0 * 0.00049);
}

TEST(CounterRandom, NormalAndUniformShareNoNumbers) {
  const CounterRandom random(8);
  // Were the counters shared, the first uniform would tell the normal's size.
  double correlation = 0.0;
  constexpr std::uint64_t kDraws = 20000;
  for (std::uint64_t i = 0; i < kDraws; ++i) {
    correlation += (random.uniform(2 * i) - 0.5) * (std::abs(random.normal(i)) - 0.797885);
  }
  EXPECT_NEAR(correlation / kDraws, 0.0, 4.0 * 0.289 * 0.603 / std::sqrt(double{kDraws}));
}

}  // namespace
}  // namespace camber
