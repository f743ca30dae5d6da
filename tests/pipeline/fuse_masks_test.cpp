// What a mask calls road against where it lies.

#include "camber/pipeline/stages/fuse_masks.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>

namespace camber {
namespace {

/// Height of the ground above a level plane 1.65 m below the camera, at (x, z).
using Ground2 = std::function<double(double, double)>;

struct MadeGround {
  Correspondences matches;
  GroundPoints seen;
  std::vector<Eigen::Vector3d> points;  ///< one a grid point; z 0: none
};

/// A ground as every fourth pixel of a KITTI-like camera sees it from 5 to 40 m.
MadeGround made(const Ground2& height) {
  const PinholeCamera camera = [] {
    PinholeCamera out;
    out.width = 1242;
    out.height = 375;
    out.fx = out.fy = 721.5;
    out.cx = 609.6;
    out.cy = 172.9;
    return out;
  }();
  MadeGround out;
  out.matches.step = 4;
  out.matches.columns = (camera.width + 3) / 4;
  out.matches.rows = (camera.height + 3) / 4;
  const auto total = static_cast<std::size_t>(out.matches.columns * out.matches.rows);
  out.seen.is_ground.assign(total, 0);
  out.points.assign(total, Eigen::Vector3d::Zero());
  for (int row = 0; row < out.matches.rows; ++row) {
    for (int column = 0; column < out.matches.columns; ++column) {
      const auto i = static_cast<std::size_t>(row * out.matches.columns + column);
      const Eigen::Vector2d pixel(4.0 * column, 4.0 * row);
      out.matches.pixels.push_back(pixel.cast<float>());
      const Eigen::Vector3d ray = camera.ray(pixel);
      double z = 5.0;  // the first place where the ray is below the ground
      while (z < 40.0 && ray.y() * z < 1.65 - height(ray.x() * z, z)) z += 0.01;
      if (z <= 5.0 || z >= 40.0) continue;
      out.seen.is_ground[i] = 1;
      out.points[i] = ray * z;
      out.seen.points.grid.push_back(static_cast<int>(i));
      out.seen.points.rays.push_back(ray);
      out.seen.points.inverse_depth.push_back(1.0 / z);
      out.seen.points.sigma_own.push_back(0.005 / z);
    }
  }
  out.seen.is_roadway = out.seen.is_ground;
  return out;
}

std::vector<std::uint8_t> off(const MadeGround& ground) {
  return stages::off_road_surface(ground.matches, ground.seen, {{0.0, -1.0, 0.0}, 1.65},
                                  {0.0, 0.0, 1.0}, 1.0);
}

/// Share of the grid points in a range of x that are off.
double share(const MadeGround& ground, double from, double to) {
  const std::vector<std::uint8_t> marks = off(ground);
  int all = 0, marked = 0;
  for (std::size_t i = 0; i < marks.size(); ++i) {
    if (!ground.seen.is_ground[i] || ground.points[i].x() < from || ground.points[i].x() > to) {
      EXPECT_TRUE(ground.seen.is_ground[i] || !marks[i]);
      continue;
    }
    ++all;
    marked += marks[i];
  }
  EXPECT_GT(all, 150);
  return static_cast<double>(marked) / all;
}

TEST(FuseMasks, HillsCrownsAndCrossSlopesAreRoad) {
  const Ground2 roads[] = {
      [](double, double) { return 0.0; },
      [](double, double z) { return 0.002 * z * z; },
      [](double, double z) { return -0.003 * z * z + 0.05 * z; },
      [](double x, double) { return 0.06 * x; },
      [](double x, double z) { return 0.001 * z * z - 0.002 * x * x; },
      [](double x, double) { return x > 5.0 ? 0.12 : 0.0; },  // a pavement within 0.2 m
  };
  for (std::size_t i = 0; i < std::size(roads); ++i) {
    SCOPED_TRACE(i);
    EXPECT_EQ(share(made(roads[i]), -8.0, 8.0), 0.0);
  }
}

TEST(FuseMasks, WhatLiesHigherOrLowerIsNot) {
  const MadeGround ground = made([](double x, double z) {
    const double road = 0.001 * z * z;
    if (x > 5.0) return road + 0.45;
    return x < -5.0 ? road - 0.3 * (-5.0 - x) : road;  // a side street that falls away
  });
  EXPECT_LT(share(ground, -5.0, 4.5), 0.002);  // a cell at the edge has points of both
  EXPECT_GT(share(ground, 5.2, 9.0), 0.9);
  EXPECT_GT(share(ground, -9.0, -6.5), 0.9);
}

TEST(FuseMasks, WhatHasRoadBeyondOrIsBadlyKnownIsKept) {
  const auto bump = [](double x, double z) {
    return std::abs(x - 4.8) < 0.6 && std::abs(z - 12.0) < 1.5 ? 0.5 : 0.0;
  };
  EXPECT_EQ(share(made(bump), -8.0, 8.0), 0.0);
  MadeGround ground = made([](double x, double) { return x > 5.0 ? 0.45 : 0.0; });
  for (double& sigma : ground.seen.points.sigma_own) sigma *= 100.0;
  EXPECT_EQ(share(ground, 5.0, 9.0), 0.0);
}

}  // namespace
}  // namespace camber
