#include "camber/scale/speed_noise.h"

#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>

#include "camber/core/random.h"

namespace camber {
namespace {

constexpr double kStep = 0.1;  // s

/// A drive that slows down and speeds up again, m/s.
double driven(double time) { return 12.0 + 3.0 * std::sin(0.5 * time); }

/// Speeds with an error of `independent` and one of `common` stated standard deviations of 2 %.
std::vector<TimedSpeed> drive(int count, double independent, double common,
                              const CounterRandom& random, std::uint64_t* drawn) {
  const double shared = random.normal((*drawn)++);
  std::vector<TimedSpeed> out;
  for (int i = 0; i < count; ++i) {
    const double error = independent * random.normal((*drawn)++) + common * shared;
    const double speed = driven(kStep * i);
    out.push_back({kStep * i, speed * (1.0 + 0.02 * error), 0.02 * speed});
  }
  return out;
}

TEST(SpeedNoise, IsSplitByTheScatter) {
  const CounterRandom random(3);
  std::uint64_t drawn = 0;
  const SpeedNoise smooth = speed_noise(drive(100, 0.0, 1.0, random, &drawn));
  EXPECT_LT(smooth.independent, 0.02);
  EXPECT_GT(smooth.common, 0.98);
  // A hundred samples give a variance within 15 %.
  const SpeedNoise scattered = speed_noise(drive(400, 1.0, 0.0, random, &drawn));
  EXPECT_NEAR(scattered.independent, 1.0, 0.2);
  EXPECT_LT(scattered.common, 0.2);
  const SpeedNoise both = speed_noise(drive(400, std::sqrt(0.5), std::sqrt(0.5), random, &drawn));
  EXPECT_NEAR(both.independent, 0.5, 0.15);
  EXPECT_NEAR(both.common, 0.5, 0.15);
  // Scatter of three stated standard deviations: what is stated is none of it.
  const SpeedNoise rough = speed_noise(drive(400, 3.0, 0.0, random, &drawn));
  EXPECT_NEAR(rough.independent, 9.0, 3.0);
  EXPECT_GT(rough.common, 0.98);
}

TEST(SpeedNoise, OfTooFewSamplesIsAHalfEach) {
  for (const auto& samples : {std::vector<TimedSpeed>(), {{0.0, 10.0, 0.2}, {0.1, 11.0, 0.2}}}) {
    EXPECT_EQ(speed_noise(samples).independent, 0.5);
    EXPECT_EQ(speed_noise(samples).common, 0.5);
  }
}

TEST(SpeedNoise, CoversTheDistance) {
  // The distance over the middle nine of thirty speeds lies within two standard deviations.
  const CounterRandom random(11);
  std::uint64_t drawn = 0;
  const auto inside = [&](double independent, double common) {
    int count = 0;
    constexpr int kRuns = 400;
    for (int run = 0; run < kRuns; ++run) {
      const std::vector<TimedSpeed> samples = drive(30, independent, common, random, &drawn);
      const SpeedNoise noise = speed_noise(samples);
      double error = 0.0, sum = 0.0, squares = 0.0;
      for (int i = 11; i < 20; ++i) {
        const double weight = i == 11 || i == 19 ? 0.5 * kStep : kStep;
        const TimedSpeed& s = samples[static_cast<std::size_t>(i)];
        error += weight * (s.speed - driven(s.time_s));
        sum += weight * s.sigma;
        squares += weight * weight * s.sigma * s.sigma;
      }
      const double sigma = std::sqrt(noise.independent * squares + noise.common * sum * sum);
      count += std::abs(error) < 2.0 * sigma ? 1 : 0;
    }
    return static_cast<double>(count) / kRuns;
  };
  // 95.4 % +- 1.04 % of 400 runs.
  EXPECT_GT(inside(0.0, 1.0), 0.92);
  EXPECT_LT(inside(0.0, 1.0), 0.99);
  EXPECT_GT(inside(std::sqrt(0.5), std::sqrt(0.5)), 0.91);
  EXPECT_LT(inside(std::sqrt(0.5), std::sqrt(0.5)), 0.99);
  // Thirty samples do not rule out a small common part: cautious.
  EXPECT_GT(inside(1.0, 0.0), 0.95);
}

TEST(SpeedNoise, RefusesWhatIsNoDrive) {
  EXPECT_THROW(speed_noise({{0.0, 10.0, 0.2}, {0.0, 10.0, 0.2}}), std::invalid_argument);
  EXPECT_THROW(speed_noise({{0.0, 10.0, 0.0}}), std::invalid_argument);
  EXPECT_THROW(speed_noise({{0.0, std::nan(""), 0.1}}), std::invalid_argument);
}

}  // namespace
}  // namespace camber
