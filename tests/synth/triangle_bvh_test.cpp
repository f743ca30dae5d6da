#include "camber/synth/triangle_bvh.h"

#include <gtest/gtest.h>

#include "camber/core/random.h"

namespace camber {
namespace {

std::vector<TrianglePoints> random_triangles(int count, std::uint64_t seed) {
  const CounterRandom random(seed);
  std::vector<TrianglePoints> out(count);
  for (int i = 0; i < count; ++i) {
    for (int k = 0; k < 3; ++k) {
      for (int a = 0; a < 3; ++a) {
        const std::uint64_t at = 12 * static_cast<std::uint64_t>(i);
        out[i][k][a] =
            random.uniform(at + a, -10.0, 10.0) + random.uniform(at + 3 + 3 * k + a, -3, 3);
      }
    }
  }
  return out;
}

TEST(TriangleBvh, FindsWhatEveryTriangleAloneWouldSay) {
  const std::vector<TrianglePoints> triangles = random_triangles(500, 7);
  const TriangleBvh all(triangles);
  std::vector<TriangleBvh> single;
  for (const TrianglePoints& triangle : triangles) single.emplace_back(std::vector{triangle});
  const CounterRandom random(8);
  int hits = 0;
  for (int i = 0; i < 400; ++i) {
    Eigen::Vector3d origin, direction;
    for (int a = 0; a < 3; ++a) {
      origin[a] = random.uniform(6 * i + a, -8.0, 8.0);
      direction[a] = random.uniform(6 * i + 3 + a, -1.0, 1.0);
    }
    if (i % 10 == 0) direction[i / 10 % 3] = 0.0;  // parallel to a side of the boxes
    RayHit expected;
    for (std::size_t t = 0; t < single.size(); ++t) {
      const RayHit hit = single[t].cast(origin, direction, 0.0, 1e9);
      if (hit.distance < expected.distance) expected = {hit.distance, static_cast<int>(t)};
    }
    const RayHit found = all.cast(origin, direction, 0.0, 1e9);
    EXPECT_EQ(found.triangle, expected.triangle);
    EXPECT_EQ(found.distance, expected.distance);
    EXPECT_EQ(all.blocked(origin, direction, 0.0, 1e9), expected.triangle >= 0);
    if (expected.triangle >= 0) {
      ++hits;
      EXPECT_FALSE(all.blocked(origin, direction, 0.0, 0.999 * expected.distance));
    }
  }
  EXPECT_GT(hits, 100);
}

TEST(TriangleBvh, EqualDistancesGoToTheLowerIndex) {
  std::vector<TrianglePoints> triangles;
  for (int i = 0; i < 20; ++i) {
    triangles.push_back(
        {Eigen::Vector3d(-1, -1, 5), Eigen::Vector3d(1, -1, 5), Eigen::Vector3d(0, 1, 5)});
  }
  const RayHit hit = TriangleBvh(triangles).cast({0, 0, 0}, {0, 0, 2}, 0.0, 100.0);
  EXPECT_EQ(hit.triangle, 0);
  EXPECT_NEAR(hit.distance, 2.5, 1e-12);
}

TEST(TriangleBvh, EmptyBlocksNothing) {
  const TriangleBvh none;
  EXPECT_TRUE(none.empty());
  EXPECT_EQ(none.cast({0, 0, 0}, {0, 0, 1}, 0.0, 1e9).triangle, -1);
  EXPECT_FALSE(none.blocked({0, 0, 0}, {0, 0, 1}, 0.0, 1e9));
}

}  // namespace
}  // namespace camber
