// Borders of the road in drawn images of a level road with ragged masks: where they are found.

#include "camber/scale/road_edge_detection.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <stdexcept>

#include "camber/core/random.h"

namespace camber {
namespace {

constexpr double kHeight = 1.65;  // m
const PinholeCamera kCamera{1242, 375, 720.0, 720.0, 610.0, 172.0};
constexpr int kTop = 190;  // first row of the ground, 66 m
constexpr double kLeft = -4.2, kRight = 3.6;

double depth_of(double v) { return kCamera.fy * kHeight / (v - kCamera.cy); }

struct Drawn {
  GrayImage image;
  std::vector<std::uint8_t> road, hidden;
  GroundRaster ground;
};

std::size_t index(int u, int v) {
  return static_cast<std::size_t>(v) * static_cast<std::size_t>(kCamera.width) +
         static_cast<std::size_t>(u);
}

/// Asphalt between kerbs 0.15 m wide and pavements; `bend`: curvature of the road, 1/m. The mask's
/// edges go astray by up to 6 px over stretches of a dozen rows, and it has wrong regions.
Drawn draw(double bend) {
  Drawn out;
  out.image = {kCamera.width, kCamera.height, {}};
  const auto total =
      static_cast<std::size_t>(kCamera.width) * static_cast<std::size_t>(kCamera.height);
  out.image.pixels.assign(total, 180);
  out.road.assign(total, 0);
  out.hidden.assign(total, 0);
  out.ground.top = kTop;
  const CounterRandom random(7, 0);
  std::uint64_t counter = 0;
  for (int v = kTop; v < kCamera.height; ++v) {
    const double astray_left = 6.0 * std::sin(0.31 * v), astray_right = 5.0 * std::cos(0.23 * v);
    for (int u = 0; u < kCamera.width; ++u) {
      constexpr int kParts = 4;
      double grey = 0.0;
      for (int a = 0; a < kParts; ++a) {
        const double z = depth_of(v - 0.5 + (a + 0.5) / kParts);
        for (int b = 0; b < kParts; ++b) {
          const double x =
              (u - 0.5 + (b + 0.5) / kParts - kCamera.cx) / kCamera.fx * z - 0.5 * bend * z * z;
          const double beyond = std::max(kLeft - x, x - kRight);
          grey += (beyond < 0 ? 90.0 : beyond < 0.15 ? 170.0 : 125.0) / (kParts * kParts);
        }
      }
      grey += 3.0 * random.normal(counter++);
      out.image.pixels[index(u, v)] =
          static_cast<std::uint8_t>(std::lround(std::clamp(grey, 0.0, 255.0)));
      const double z = depth_of(v), shift = 0.5 * bend * z * z;
      const double left = kCamera.cx + kCamera.fx * (kLeft + shift) / z + astray_left;
      const double right = kCamera.cx + kCamera.fx * (kRight + shift) / z + astray_right;
      out.road[index(u, v)] = u > left && u < right;
      // Wrong regions, of the road beside it and of none on it.
      if (std::hypot(u - 560.0, v - 300.0) < 14.0) out.road[index(u, v)] = 0;
      if (std::hypot(u - left + 30.0, v - 260.0) < 8.0) out.road[index(u, v)] = 1;
      out.ground.inverse_depth.push_back(static_cast<float>(1.0 / z));
      out.ground.visible.push_back(1);
    }
  }
  return out;
}

RoadEdges find(const Drawn& drawn, int threads = 1) {
  return detect_road_edges(drawn.image, kCamera, drawn.ground, drawn.road, drawn.hidden,
                           Eigen::Vector3d(0, 0, 1), threads);
}

/// How far the edge's pixels are from one line along the road near `x`, px; its place in *at.
std::vector<double> off_line(const std::vector<RoadEdgePixel>& edge, double bend, double* at) {
  std::vector<double> places, out;
  const auto place = [&](const RoadEdgePixel& p) {
    const double z = depth_of(p.row);
    return (p.column - kCamera.cx) / kCamera.fx * z - 0.5 * bend * z * z;
  };
  for (const RoadEdgePixel& p : edge) places.push_back(place(p));
  std::nth_element(places.begin(), places.begin() + static_cast<long>(places.size() / 2),
                   places.end());
  *at = places[places.size() / 2];
  for (const RoadEdgePixel& p : edge) {
    out.push_back(std::abs(place(p) - *at) * kCamera.fx / depth_of(p.row));
  }
  std::sort(out.begin(), out.end());
  return out;
}

TEST(RoadEdges, OneEdgeIsFollowedToAFractionOfAPixelUnderARaggedMask) {
  for (const double bend : {0.0, 1.0 / 150.0, -1.0 / 200.0}) {
    const RoadEdges found = find(draw(bend));
    for (const auto& [edge, where] :
         {std::pair{&found.left, kLeft}, std::pair{&found.right, kRight}}) {
      ASSERT_GT(edge->size(), 90U) << bend << " " << where;
      double at = 0.0;
      const std::vector<double> off = off_line(*edge, bend, &at);
      // Either edge of the kerb will do.
      EXPECT_NEAR(std::abs(at), std::abs(where) + 0.075, 0.11) << bend;
      EXPECT_LT(off[off.size() / 2], 0.25) << bend << " " << where;
      EXPECT_LT(off[off.size() * 95 / 100], 1.0) << bend << " " << where;
      EXPECT_LT(edge->back().row, 202) << "39 m";
      for (std::size_t i = 1; i < edge->size(); ++i) {
        EXPECT_LT((*edge)[i].row, (*edge)[i - 1].row);
      }
    }
  }
}

TEST(RoadEdges, WhatAVehicleHidesIsLeftOut) {
  Drawn drawn = draw(0.0);
  // A parked car over the right edge, 9 to 14 m ahead.
  const int near = 304, far = 257;
  for (int v = far; v <= near; ++v) {
    for (int u = 780; u < 1040; ++u) {
      drawn.road[index(u, v)] = 0;
      drawn.hidden[index(u, v)] = 1;
      drawn.image.pixels[index(u, v)] = static_cast<std::uint8_t>(30 + (7 * u + 3 * v) % 90);
    }
  }
  const RoadEdges found = find(drawn);
  double at = 0.0;
  const std::vector<double> off = off_line(found.right, 0.0, &at);
  EXPECT_NEAR(at, kRight + 0.075, 0.11);
  EXPECT_LT(off[off.size() * 95 / 100], 1.0);
  int breaks = 0, beyond = 0;
  for (std::size_t i = 0; i < found.right.size(); ++i) {
    const RoadEdgePixel& p = found.right[i];
    EXPECT_FALSE(p.row > far && p.row < near) << p.row;
    beyond += p.row < far;
    breaks += i > 0 && !p.continues;
  }
  EXPECT_GT(beyond, 30);
  EXPECT_GE(breaks, 1);
}

TEST(RoadEdges, WithoutARoadOrABorderThereIsNone) {
  Drawn drawn = draw(0.0);
  std::fill(drawn.road.begin(), drawn.road.end(), std::uint8_t{0});
  EXPECT_TRUE(find(drawn).left.empty());
  std::fill(drawn.road.begin(), drawn.road.end(), std::uint8_t{1});
  EXPECT_TRUE(find(drawn).right.empty());
}

TEST(RoadEdges, TheSameForAnyNumberOfThreads) {
  const Drawn drawn = draw(0.0);
  const RoadEdges one = find(drawn, 1), many = find(drawn, 3);
  ASSERT_EQ(one.left.size(), many.left.size());
  for (std::size_t i = 0; i < one.left.size(); ++i) {
    EXPECT_EQ(one.left[i].column, many.left[i].column);
  }
}

TEST(RoadEdges, SizesThatDisagreeAreRefused) {
  Drawn drawn = draw(0.0);
  drawn.hidden.pop_back();
  EXPECT_THROW(find(drawn), std::invalid_argument);
}

}  // namespace
}  // namespace camber
