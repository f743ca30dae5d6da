#include "camber/geometry/lens_map.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace camber {
namespace {

const PinholeCamera kRaw{1280, 720, 700.0, 702.0, 642.0, 355.0};

LensDistortion lens(LensModel model, std::vector<double> coefficients, PinholeCamera raw = kRaw) {
  LensDistortion out;
  out.model = model;
  out.coefficients = std::move(coefficients);
  out.raw = raw;
  return out;
}

std::vector<LensDistortion> lenses() {
  const PinholeCamera wide{1280, 720, 420.0, 420.0, 640.0, 360.0};
  return {lens(LensModel::kBrown, {-0.35, 0.12, 0.0, 0.0}),
          lens(LensModel::kBrown, {-0.31, 0.12, 0.0008, -0.0005, -0.02}),
          lens(LensModel::kBrown, {0.5, -0.1, 0.0004, 0.0003, 0.01, 0.85, 0.02, 0.001}),
          lens(LensModel::kFisheye, {0.02, -0.01, 0.003, -0.001}, wide),
          lens(LensModel::kNone, {})};
}

TEST(LensMap, ThereAndBackIsTheSamePixel) {
  for (const LensDistortion& l : lenses()) {
    const PinholeCamera camera = undistorted_camera(l);
    const LensMap map(camera, l);
    int found = 0;
    for (double v = 0; v < l.raw.height; v += 40) {
      for (double u = 0; u < l.raw.width; u += 40) {
        const auto pixel = map.pinhole_from_raw({u, v});
        if (!pixel) continue;
        const auto again = map.raw_from_pinhole(*pixel);
        ASSERT_TRUE(again);
        EXPECT_LT((*again - Eigen::Vector2d(u, v)).norm(), 1e-6);
        ++found;
      }
    }
    EXPECT_GT(found, 500) << to_string(l.model);  // of 576; corners are beyond the model
  }
}

// Worked by hand: a ray at (0.5, -0.2) with k1 = -0.3, p1 = 0.001, p2 = 0.002.
TEST(LensMap, BrownsModelByHand) {
  const LensDistortion l =
      lens(LensModel::kBrown, {-0.3, 0.0, 0.001, 0.002}, {100, 100, 1.0, 1.0, 0.0, 0.0});
  const LensMap map({100, 100, 1.0, 1.0, 0.0, 0.0}, l);
  const auto raw = map.raw_from_pinhole({0.5, -0.2});
  ASSERT_TRUE(raw);
  // r^2 = 0.29, 1 + k1 r^2 = 0.913; x: 0.4565 + 2 p1 x y + p2 (r^2 + 2 x^2); y likewise.
  EXPECT_NEAR(raw->x(), 0.4565 - 0.0002 + 0.002 * 0.79, 1e-12);
  EXPECT_NEAR(raw->y(), -0.1826 + 0.001 * 0.37 - 0.0004, 1e-12);
}

TEST(LensMap, FisheyeIsTheAngle) {
  const LensDistortion l =
      lens(LensModel::kFisheye, {0.0, 0.0, 0.0, 0.0}, {400, 400, 100.0, 100.0, 200.0, 200.0});
  const LensMap map({400, 400, 100.0, 100.0, 200.0, 200.0}, l);
  const auto raw = map.raw_from_pinhole({300.0, 200.0});  // 45 degrees
  ASSERT_TRUE(raw);
  EXPECT_NEAR(raw->x(), 200.0 + 100.0 * std::atan(1.0), 1e-9);
  EXPECT_FALSE(map.pinhole_from_raw({200.0 + 100.0 * 1.6, 200.0}));  // beyond 90 degrees
}

TEST(LensMap, ThePolynomialsTurnBackIsNotUsed) {
  // r (1 - 0.35 r^2) is largest at r = 0.976.
  const LensDistortion l = lens(LensModel::kBrown, {-0.35, 0.0, 0.0, 0.0});
  const LensMap map(kRaw, l);
  EXPECT_TRUE(map.raw_from_pinhole({kRaw.cx + 0.97 * kRaw.fx, kRaw.cy}));
  EXPECT_FALSE(map.raw_from_pinhole({kRaw.cx + 0.98 * kRaw.fx, kRaw.cy}));
  EXPECT_FALSE(map.pinhole_from_raw({kRaw.cx + 0.75 * kRaw.fx, kRaw.cy}));  // beyond 0.651
}

TEST(LensMap, TheCameraLosesNoRowOfRoad) {
  for (const LensDistortion& l : lenses()) {
    const PinholeCamera camera = undistorted_camera(l);
    EXPECT_EQ(camera.fx, l.raw.fx);
    EXPECT_LE(camera.width, 2 * l.raw.width + 2);
    EXPECT_LE(camera.height, 2 * l.raw.height + 2);
    const LensMap map(camera, l);
    for (double u = 0.3 * l.raw.width; u < 0.7 * l.raw.width; u += 20) {
      const auto pixel = map.pinhole_from_raw({u, l.raw.height - 1.0});
      ASSERT_TRUE(pixel);
      EXPECT_TRUE(camera.contains(*pixel)) << to_string(l.model) << " " << u;
    }
  }
  const LensDistortion none = lens(LensModel::kNone, {});
  const PinholeCamera same = undistorted_camera(none);
  EXPECT_EQ(same.width, kRaw.width);
  EXPECT_NEAR(same.cx, kRaw.cx, 1.0);
}

TEST(LensMap, RefusesAnotherNumberOfCoefficients) {
  EXPECT_THROW(LensMap(kRaw, lens(LensModel::kFisheye, {0.1})), std::invalid_argument);
}

}  // namespace
}  // namespace camber
