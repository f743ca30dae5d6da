#include "camber/calibrate/lens_estimate.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>

#include "calibrate/simulated_drive.h"
#include "camber/core/random.h"

namespace camber {
namespace {

LensEstimateOptions independent_errors() {
  LensEstimateOptions out;
  out.correlation = 1.0;
  out.focal_floor = out.principal_floor = out.distortion_floor = 0.0;
  out.least_sigma = 0.02;
  return out;
}

std::vector<WindowBundle> windows_of(const test::SimulatedDriveOptions& options) {
  std::vector<WindowBundle> out;
  for (CalibrationWindow& window : test::true_windows(test::simulate_drive(options), 8)) {
    out.emplace_back(std::move(window));
  }
  return out;
}

test::SimulatedDriveOptions turning_drive(std::uint64_t seed) {
  test::SimulatedDriveOptions out;
  out.lens = {640, 360, 420.0, 326.0, 183.0, -0.12, 0.0};
  out.key_frames = 22;
  out.turn = 0.02;
  out.points = 350;
  out.seed = seed;
  return out;
}

/// With independent errors the stated covariance is right: chi-square of the five parameters over
/// many draws of noise and drive.
TEST(LensEstimate, CovarianceIsThatOfTheErrors) {
  constexpr int kDraws = 200;
  double chi = 0.0, chi_f = 0.0;
  int inside = 0;
  for (int draw = 0; draw < kDraws; ++draw) {
    const auto options = turning_drive(static_cast<std::uint64_t>(draw));
    auto windows = windows_of(options);
    const LensPrior prior = lens_prior_of_cars(640, 360);
    // The prior is true of the drives: a wrong one would be an error of its own.
    LensPrior at_truth = prior;
    at_truth.mean = options.lens;
    const CounterRandom random(static_cast<std::uint64_t>(draw), 9);
    DriveLens::Vector off;
    for (int k = 0; k < DriveLens::kSize; ++k) {
      off(k) = prior.sigma(k) * random.normal(static_cast<std::uint64_t>(k));
    }
    at_truth.mean = options.lens.with(options.lens.parameters() + off);
    const LensEstimate estimate =
        estimate_lens(options.lens, at_truth, independent_errors(), &windows);
    const DriveLens::Vector error = estimate.lens.parameters() - options.lens.parameters();
    chi += error.dot(estimate.covariance.ldlt().solve(error)) / DriveLens::kSize;
    const double z = error(0) / estimate.sigma(0);
    chi_f += z * z;
    inside += std::abs(z) < 2.0 ? 1 : 0;
  }
  // Mean chi-square over its freedom: 1 +- 0.04 of seven, 1 +- 0.1 of one. The score's spread over
  // three windows, where it is larger, adds to the sigma: below 1 is expected.
  EXPECT_LT(chi / kDraws, 1.25);
  EXPECT_GT(chi / kDraws, 0.5);
  EXPECT_LT(chi_f / kDraws, 1.35);
  EXPECT_GT(chi_f / kDraws, 0.4);
  EXPECT_GE(inside, 180);
}

TEST(LensEstimate, FindsTheLensFromAWrongStart) {
  for (const double factor : {0.7, 1.4}) {
    const auto options = turning_drive(5);
    auto windows = windows_of(options);
    DriveLens start = lens_prior_of_cars(640, 360).mean;
    start.f = factor * options.lens.f;
    const LensEstimate estimate =
        estimate_lens(start, lens_prior_of_cars(640, 360), independent_errors(), &windows);
    EXPECT_LT(std::abs(std::log(estimate.lens.f / options.lens.f)), 4.0 * estimate.sigma(0))
        << factor;
    EXPECT_LT(estimate.sigma(0), 0.03) << factor;
    EXPECT_NEAR(estimate.pixel_sigma, options.pixel_sigma, 0.03) << factor;
  }
}

/// Along a straight line without any shaking every focal length gives the same pictures.
TEST(LensEstimate, AStraightDriveLeavesTheFocalLengthOpen) {
  auto options = turning_drive(3);
  options.turn = 0.0;
  options.shake = 0.0;
  auto windows = windows_of(options);
  const LensPrior prior = lens_prior_of_cars(640, 360);
  const LensEstimate estimate = estimate_lens(options.lens, prior, independent_errors(), &windows);
  // The rotations that noise feigns leave a little of what a turn would show.
  EXPECT_GT(estimate.sigma(0), 0.15);
  EXPECT_LE(estimate.sigma(0), 1.0001 * prior.sigma(0));
}

/// One point in six moves on its own.
TEST(LensEstimate, LeavesOutWhatMoves) {
  const auto options = turning_drive(7);
  auto windows = windows_of(options);
  std::size_t before = 0, moving = 0;
  for (WindowBundle& bundle : windows) {
    CalibrationWindow window = bundle.window();
    before += window.points.size();
    for (std::size_t i = 0; i < window.points.size(); i += 6) {
      ++moving;
      for (WindowObservation& seen : window.points[i].seen) {
        seen.pixel += seen.frame * seen.frame * Eigen::Vector2d(0.7, -0.4);
      }
    }
    bundle.set_window(std::move(window));
  }
  const LensEstimate estimate =
      estimate_lens(options.lens, lens_prior_of_cars(640, 360), independent_errors(), &windows);
  EXPECT_LT(std::abs(std::log(estimate.lens.f / options.lens.f)), 4.0 * estimate.sigma(0));
  EXPECT_LT(estimate.points, before - moving / 2);
  EXPECT_GT(estimate.points, before - 2 * moving);
}

TEST(LensEstimate, TheSameForAnyNumberOfThreads) {
  const auto options = turning_drive(1);
  LensEstimate estimates[2];
  for (int t = 0; t < 2; ++t) {
    auto windows = windows_of(options);
    LensEstimateOptions with_threads;
    with_threads.num_threads = t + 1;
    estimates[t] =
        estimate_lens(options.lens, lens_prior_of_cars(640, 360), with_threads, &windows);
  }
  EXPECT_EQ(estimates[0].lens.parameters(), estimates[1].lens.parameters());
  EXPECT_EQ(estimates[0].covariance, estimates[1].covariance);
}

TEST(LensEstimate, RefusesNothing) {
  std::vector<WindowBundle> none;
  const LensPrior prior = lens_prior_of_cars(640, 360);
  EXPECT_THROW(estimate_lens(prior.mean, prior, {}, &none), std::invalid_argument);
  EXPECT_THROW(lens_prior_of_cars(0, 360), std::invalid_argument);
}

}  // namespace
}  // namespace camber
