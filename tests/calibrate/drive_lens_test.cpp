#include "camber/calibrate/drive_lens.h"

#include <gtest/gtest.h>

#include "camber/geometry/lens_map.h"

namespace camber {
namespace {

DriveLens wide_lens() { return {960, 540, 520.0, 470.0, 281.0, -0.21, 0.03}; }

TEST(DriveLens, ProjectsAsTheLensOfAManifest) {
  const DriveLens lens = wide_lens();
  const LensMap map(lens.pinhole(), lens.distortion());
  for (const Eigen::Vector3d& p : {Eigen::Vector3d(0.1, 0.2, 1.0), Eigen::Vector3d(-3.0, 1.1, 5.0),
                                   Eigen::Vector3d(0.0, 0.0, 2.0)}) {
    const auto raw = map.raw_from_pinhole(*lens.pinhole().project(p));
    ASSERT_TRUE(raw);
    EXPECT_LT((*lens.pixel(p) - *raw).norm(), 1e-9);
  }
  EXPECT_FALSE(lens.pixel({0.0, 0.0, -1.0}));
}

TEST(DriveLens, DerivativesAreTheNumericOnes) {
  const DriveLens lens = wide_lens();
  const Eigen::Vector3d p(1.3, -0.7, 2.1);
  const auto at = lens.project(p);
  ASSERT_TRUE(at);
  EXPECT_LT((at->pixel - *lens.pixel(p)).norm(), 1e-12);
  constexpr double kStep = 1e-6;
  for (int k = 0; k < 3; ++k) {
    const Eigen::Vector3d step = kStep * Eigen::Vector3d::Unit(k);
    const Eigen::Vector2d numeric = (*lens.pixel(p + step) - *lens.pixel(p - step)) / (2 * kStep);
    EXPECT_LT((at->by_point.col(k) - numeric).norm(), 1e-5) << k;
  }
  for (int k = 0; k < DriveLens::kSize; ++k) {
    const DriveLens::Vector step = kStep * DriveLens::Vector::Unit(k);
    const Eigen::Vector2d numeric = (*lens.with(lens.parameters() + step).pixel(p) -
                                     *lens.with(lens.parameters() - step).pixel(p)) /
                                    (2 * kStep);
    EXPECT_LT((at->by_lens.col(k) - numeric).norm(), 1e-4) << k;
  }
}

TEST(DriveLens, RayIsTheInverse) {
  const DriveLens lens = wide_lens();
  for (int x = 0; x < lens.width; x += 119) {
    for (int y = 0; y < lens.height; y += 77) {
      const Eigen::Vector2d pixel(x, y);
      const auto ray = lens.ray(pixel);
      ASSERT_TRUE(ray) << x << " " << y;
      EXPECT_LT((*lens.pixel(*ray) - pixel).norm(), 1e-8);
    }
  }
  // A pixel beyond the radius at which r - 0.35 r^3 turns back.
  const DriveLens folded{960, 540, 300.0, 480.0, 270.0, -0.35, 0.0};
  EXPECT_FALSE(folded.ray({959.0, 0.0}));
}

}  // namespace
}  // namespace camber
