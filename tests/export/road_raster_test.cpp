#include "camber/export/road_raster.h"

#include <gtest/gtest.h>

#include <cmath>

#include "camber/core/errors.h"

namespace camber {
namespace {

using Eigen::Vector3d;

/// Level ground 2 m to either side of the x axis, and a bridge 6 m above its second half.
class Bridge : public HeightSource {
 public:
  GroundSample at(const Vector3d& place) const override {
    GroundSample sample;
    if (std::abs(place.y()) > 2.0 || place.x() < 0.0) return sample;
    sample.height = place.x() > 10.0 && place.z() > 3.0 ? 6.0 : 0.1 * place.y();
    sample.sigma = 0.01;
    sample.normal = Vector3d(0.0, -0.1, 1.0).normalized();
    return sample;
  }
  double resolution() const override { return 0.2; }
};

TEST(RoadRaster, CellsAreAskedAtTheirCentresOnTheLinesLevel) {
  for (const double level : {0.0, 6.0}) {
    const SmoothLine line({{12.03, 0, level}, {20.03, 0, level}}, 0.01);
    const RoadRaster raster = make_road_raster(Bridge(), line, nullptr, {});
    EXPECT_DOUBLE_EQ(raster.cell, 0.2);
    EXPECT_NEAR(std::remainder(raster.west, 0.2), 0.0, 1e-9);
    EXPECT_LE(raster.west, 12.03);
    EXPECT_GE(raster.north, 2.0);
    EXPECT_EQ(raster.columns, 41u);  // 12.0 to 20.2
    EXPECT_EQ(raster.rows, 20u);
    ASSERT_EQ(raster.heights.size(), raster.columns * raster.rows);
    for (std::size_t row = 0; row < raster.rows; ++row) {
      for (std::size_t column = 0; column < raster.columns; ++column) {
        const std::size_t at = row * raster.columns + column;
        const double y = 1.9 - 0.2 * static_cast<double>(row);
        EXPECT_NEAR(raster.center(row, column).y(), y, 1e-9);
        EXPECT_NEAR(raster.heights[at], level > 3.0 ? 6.0 : 0.1 * y, 1e-6);
        EXPECT_NEAR(raster.slopes[at], std::atan(0.1), 1e-6);
        EXPECT_FLOAT_EQ(raster.sigmas[at], 0.01f);
      }
    }
    EXPECT_TRUE(raster.colors.empty());
  }
}

TEST(RoadRaster, ASlantingLineLeavesTheCornersOpen) {
  RoadRasterOptions options;
  options.left = options.right = 0.5;
  const SmoothLine line({{0, -2, 0}, {20, 2, 0}}, 0.01);
  const RoadRaster raster = make_road_raster(Bridge(), line, nullptr, options);
  const Eigen::Vector2d along = Eigen::Vector2d(20, 4).normalized();
  int known = 0;
  for (std::size_t row = 0; row < raster.rows; ++row) {
    for (std::size_t column = 0; column < raster.columns; ++column) {
      const Eigen::Vector2d d = raster.center(row, column) - Eigen::Vector2d(0, -2);
      const double aside = std::abs(along.x() * d.y() - along.y() * d.x());
      const bool seen = !std::isnan(raster.heights[row * raster.columns + column]);
      known += seen;
      if (seen) {
        EXPECT_LE(aside, 0.5 + 0.2);  // a cell whose edge the strip touches
      } else if (d.x() > 1.0 && d.x() < 19.0) {
        EXPECT_GE(aside, 0.5 - 0.2);
      }
    }
  }
  EXPECT_GT(known, 450);  // 20 m^2 in cells of 0.04 m^2
}

TEST(RoadRaster, Refusals) {
  const SmoothLine away({{0, 50, 0}, {20, 50, 0}}, 0.01), line({{0, 0, 0}, {20, 0, 0}}, 0.01);
  EXPECT_THROW(make_road_raster(Bridge(), away, nullptr, {}), NoAnswerError);
  RoadRasterOptions options;
  options.cell = 0.001;
  EXPECT_THROW(make_road_raster(Bridge(), line, nullptr, options), NoAnswerError);
  options.cell = -1.0;
  EXPECT_THROW(make_road_raster(Bridge(), line, nullptr, options), std::invalid_argument);
}

}  // namespace
}  // namespace camber
