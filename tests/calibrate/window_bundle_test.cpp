#include "camber/calibrate/window_bundle.h"

#include <gtest/gtest.h>

#include "calibrate/simulated_drive.h"

namespace camber {
namespace {

test::SimulatedDriveOptions small_drive() {
  test::SimulatedDriveOptions out;
  out.lens = {640, 360, 420.0, 322.0, 176.0, -0.15, 0.02};
  out.key_frames = 5;
  out.turn = 0.03;
  out.points = 150;
  return out;
}

const BundleLoss kLoss{0.2, 2.0};

TEST(WindowBundle, ErrorsAtTheTruthAreTheNoise) {
  const auto options = small_drive();
  const auto windows = test::true_windows(test::simulate_drive(options), 5);
  ASSERT_EQ(windows.size(), 1U);
  double sum = 0.0, count = 0.0;
  for (const Eigen::Vector2d& e : WindowBundle::errors(windows[0], options.lens)) {
    sum += e.squaredNorm();
    count += 2.0;
  }
  ASSERT_GT(count, 200.0);
  EXPECT_NEAR(std::sqrt(sum / count), options.pixel_sigma, 4.0 * 0.2 / std::sqrt(2.0 * count));
}

/// At the minimum over poses and points the reduced gradient is the derivative of the least cost by
/// the lens, and the reduced information nearly its second derivative.
TEST(WindowBundle, ReducedSystemIsThatOfTheLeastCost) {
  const auto options = small_drive();
  const auto windows = test::true_windows(test::simulate_drive(options), 5);
  const auto least = [&](const DriveLens& lens) {
    WindowBundle bundle(windows[0]);
    double cost = WindowBundle::cost(bundle.window(), lens, kLoss), damping = 1e-4;
    for (int i = 0; i < 60; ++i) {
      bundle.reduce(lens, kLoss, damping);
      bundle.try_step(DriveLens::Vector::Zero());
      const double now = WindowBundle::cost(bundle.tried(), lens, kLoss);
      damping *= now < cost ? 0.2 : 10.0;
      if (now < cost) {
        bundle.accept();
        cost = now;
      }
    }
    return std::make_pair(cost, bundle.reduce(lens, kLoss, 0.0));
  };
  const auto at = least(options.lens);
  const double steps[DriveLens::kSize] = {1e-3, 0.5, 0.5, 2e-3, 2e-3, 2e-3, 2e-3};
  for (int k = 0; k < DriveLens::kSize; ++k) {
    const DriveLens::Vector step = steps[k] * DriveLens::Vector::Unit(k);
    const double more = least(options.lens.with(options.lens.parameters() + step)).first;
    const double less = least(options.lens.with(options.lens.parameters() - step)).first;
    const double slope = (more - less) / (2.0 * steps[k]);
    const double curvature = (more - 2.0 * at.first + less) / (steps[k] * steps[k]);
    const double own = at.second.information(k, k);
    EXPECT_NEAR(at.second.gradient(k), slope, 0.03 * std::abs(slope) + 0.05 * std::sqrt(own)) << k;
    // Gauss and Newton's, with the Cauchy loss's weights in place of its second derivative.
    EXPECT_GT(own, 0.7 * curvature) << k;
    EXPECT_LT(own, 1.6 * curvature) << k;
  }
}

TEST(WindowBundle, StepsReachTheMinimum) {
  const auto options = small_drive();
  const auto windows = test::true_windows(test::simulate_drive(options), 5);
  CalibrationWindow off = windows[0];
  off.frame_from_reference[0].set_translation(off.frame_from_reference[0].translation() +
                                              Eigen::Vector3d(0.02, -0.01, 0.03));
  WindowBundle bundle(off);
  const double truth = WindowBundle::cost(windows[0], options.lens, kLoss);
  EXPECT_GT(WindowBundle::cost(off, options.lens, kLoss), 1.3 * truth);
  for (int i = 0; i < 12; ++i) {
    bundle.reduce(options.lens, kLoss, 1e-4);
    bundle.try_step(DriveLens::Vector::Zero());
    bundle.accept();
  }
  EXPECT_LT(WindowBundle::cost(bundle.window(), options.lens, kLoss), truth);
}

TEST(WindowBundle, APointBehindACameraCosts) {
  auto windows = test::true_windows(test::simulate_drive(small_drive()), 5);
  const DriveLens lens = small_drive().lens;
  const double before = WindowBundle::cost(windows[0], lens, kLoss);
  windows[0].points[0].direction *= -1.0;
  EXPECT_GT(WindowBundle::cost(windows[0], lens, kLoss), before + 10.0);
}

}  // namespace
}  // namespace camber
