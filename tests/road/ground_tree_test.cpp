// The tree over the plan in which roads are taken apart.

#include "camber/road/ground_tree.h"

#include <gtest/gtest.h>

#include <cmath>

#include "camber/core/random.h"

namespace camber {
namespace {

RoadCloud rolling(std::size_t count) {
  RoadCloud cloud;
  const CounterRandom random(5);
  for (std::uint64_t i = 0; i < count; ++i) {
    // Denser ahead, so that leaves are of many sizes; a few strays.
    const double far = std::pow(random.uniform(4 * i), 3.0) * 200.0;
    const double x = i % 1000 == 0 ? 50.0 * far : far, y = random.uniform(4 * i + 1, -8, 8);
    cloud.points.emplace_back(
        Eigen::Vector3d(x, y, std::sin(0.05 * x) + 0.02 * random.normal(i)).cast<float>());
  }
  return cloud;
}

TEST(GroundTree, PlacesHaveTheLeafThatAWalkFromTheRootFinds) {
  // A part of a cloud: its tree knows where to begin.
  const GroundTree tree(rolling(60000), Eigen::Vector3d::UnitZ(), 3, 20000);
  ASSERT_LT(tree.size(), 30000u);
  const CounterRandom random(6);
  int deeper = 0;
  for (std::uint64_t i = 0; i < 20000; ++i) {
    const auto x = static_cast<float>(random.uniform(2 * i, -300, 300)),
               y = static_cast<float>(random.uniform(2 * i + 1, -15, 15));
    deeper += tree.entry(x, y) > 0 ? 1 : 0;
    ASSERT_EQ(tree.locate(x, y), tree.locate_from(0, x, y)) << x << " " << y;
  }
  EXPECT_GT(deeper, 10000);  // the others lie beside a cut of the root
}

TEST(GroundTree, SameRowsForAnyNumberOfThreads) {
  const RoadCloud cloud = rolling(600000);
  const GroundTree one(cloud, Eigen::Vector3d::UnitZ(), 3, 262144, 1),
      several(cloud, Eigen::Vector3d::UnitZ(), 3, 262144, 8);
  EXPECT_EQ(one.points().x, several.points().x);
  EXPECT_EQ(one.points().z, several.points().z);
  EXPECT_EQ(one.cloud_index(), several.cloud_index());
  EXPECT_EQ(one.neighbours(), several.neighbours());
}

}  // namespace
}  // namespace camber
