// The tree against brute force.

#include "camber/cloud/point_tree.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <mutex>
#include <set>

#include "camber/cloud/morton.h"
#include "camber/core/random.h"

namespace camber {
namespace {

using Points = std::vector<Eigen::Vector3f>;

/// Uniform, on a plane, on a line, many at one place, with outliers far away.
Points make_points(int kind, std::size_t count) {
  const CounterRandom random(41, static_cast<std::uint64_t>(kind));
  Points points;
  for (std::size_t i = 0; i < count; ++i) {
    Eigen::Vector3f p(static_cast<float>(random.uniform(4 * i, -10, 10)),
                      static_cast<float>(random.uniform(4 * i + 1, -10, 10)),
                      static_cast<float>(random.uniform(4 * i + 2, -10, 10)));
    if (kind == 1) p.z() = 0.0f;
    if (kind == 2) p.y() = p.z() = 1.0f;
    if (kind == 3) p = p.array().round();
    if (kind == 4 && i % 7 == 0) p *= 1e6f;
    if (kind == 5) p.setConstant(3.0f);
    points.push_back(p);
  }
  return points;
}

std::vector<PointTree::Neighbor> brute_force(const Points& points, const Eigen::Vector3f& query) {
  std::vector<PointTree::Neighbor> all;
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (points[i].allFinite())
      all.push_back({static_cast<int>(i), (points[i] - query).squaredNorm()});
  }
  std::sort(all.begin(), all.end(), [](const auto& a, const auto& b) {
    return a.squared_distance < b.squared_distance ||
           (a.squared_distance == b.squared_distance && a.index < b.index);
  });
  return all;
}

// The order in which three squares are summed may differ by a unit or two in the last place.
constexpr float kRounding = 1e-6f;

class Tree : public ::testing::TestWithParam<int> {};

TEST_P(Tree, FindsWhatBruteForceFinds) {
  for (const std::size_t count : {1u, 2u, 15u, 16u, 17u, 33u, 1000u}) {
    Points points = make_points(GetParam(), count);
    if (count > 10) points[3].x() = std::numeric_limits<float>::quiet_NaN();
    const PointTree tree(points);
    std::vector<PointTree::Neighbor> found;
    for (std::uint64_t q = 0; q < 40; ++q) {
      const CounterRandom random(43, q);
      Eigen::Vector3f query(static_cast<float>(random.uniform(0, -12, 12)),
                            static_cast<float>(random.uniform(1, -12, 12)),
                            static_cast<float>(random.uniform(2, -12, 12)));
      if (q % 3 == 0 && points[q % count].allFinite()) query = points[q % count];
      if (q % 10 == 9) query *= 1e4f;
      const auto expected = brute_force(points, query);
      for (const int k : {1, 2, 5, 20, 2000}) {
        tree.nearest(query, k, found);
        ASSERT_EQ(found.size(), std::min<std::size_t>(static_cast<std::size_t>(k), tree.size()));
        for (std::size_t i = 0; i < found.size(); ++i) {
          const float d = expected[i].squared_distance;
          ASSERT_NEAR(found[i].squared_distance, d, kRounding * d) << "k " << k << " i " << i;
          const float own =
              (points[static_cast<std::size_t>(found[i].index)] - query).squaredNorm();
          ASSERT_NEAR(own, d, kRounding * d);
          if (i > 0) {
            ASSERT_TRUE(found[i - 1].squared_distance < found[i].squared_distance ||
                        (found[i - 1].squared_distance == found[i].squared_distance &&
                         found[i - 1].index < found[i].index));
          }
        }
      }
      // A radius between two distances, so that rounding does not matter.
      const std::size_t wanted = std::min<std::size_t>(10, expected.size() - 1);
      float radius = 0.0f;
      if (wanted + 1 < expected.size()) {
        const float a = expected[wanted].squared_distance,
                    b = expected[wanted + 1].squared_distance;
        if (b - a <= 1e-4f * b) continue;
        radius = std::sqrt(0.5f * (a + b));
      } else {
        radius = 2.0f * std::sqrt(expected.back().squared_distance) + 1.0f;
      }
      tree.within(query, radius, found);
      ASSERT_EQ(found.size(), wanted + 1);
      EXPECT_EQ(tree.count_within(query, radius, 1000000), static_cast<int>(wanted) + 1);
      EXPECT_EQ(tree.count_within(query, radius, 1), 1);
      const PointTree::Neighbor one = tree.nearest(query, radius);
      EXPECT_NEAR(one.squared_distance, expected[0].squared_distance,
                  kRounding * expected[0].squared_distance);
    }
  }
}

TEST_P(Tree, NeighborhoodsAndNearestOfAllAgreeWithSingleSearches) {
  Points points = make_points(GetParam(), 3000);
  points[17].y() = std::numeric_limits<float>::infinity();
  const PointTree tree(points);
  std::vector<PointTree::Neighbor> expected;
  std::set<int> seen;
  std::mutex mutex;
  tree.for_each_neighborhood(9, 4, [&](const PointTree::Neighborhood& near) {
    const std::lock_guard<std::mutex> lock(mutex);
    ASSERT_TRUE(seen.insert(near.index).second);
    ASSERT_EQ(near.count, 9);
    ASSERT_EQ(near.point, points[static_cast<std::size_t>(near.index)]);
    tree.nearest(near.point, 9, expected);
    for (int i = 0; i < 9; ++i) {
      const std::size_t at = static_cast<std::size_t>(near.positions[i]);
      const Eigen::Vector3f p(tree.x()[at], tree.y()[at], tree.z()[at]);
      ASSERT_EQ(p, points[static_cast<std::size_t>(tree.indices()[at])]);
      ASSERT_EQ(near.squared_distances[i], expected[static_cast<std::size_t>(i)].squared_distance);
      ASSERT_NEAR((p - near.point).squaredNorm(), near.squared_distances[i],
                  kRounding * near.squared_distances[i]);
    }
  });
  EXPECT_EQ(seen.size(), 2999u);

  Points queries = make_points((GetParam() + 1) % 5, 5000);
  queries[5].z() = std::numeric_limits<float>::quiet_NaN();
  const auto one_thread = tree.nearest_pair_of_all(queries, 1);
  const auto pairs = PointTree(points, 8).nearest_pair_of_all(queries, 8);
  for (std::size_t i = 0; i < queries.size(); ++i) {
    EXPECT_EQ(one_thread[i].index, pairs[i].index);
    if (i == 5) {
      EXPECT_EQ(pairs[i].index, -1);
      continue;
    }
    tree.nearest(queries[i], 2, expected);
    ASSERT_EQ(pairs[i].squared_distance, expected[0].squared_distance);
    ASSERT_EQ(pairs[i].second_squared_distance, expected[1].squared_distance);
  }
}

INSTANTIATE_TEST_SUITE_P(Kinds, Tree, ::testing::Range(0, 6));

TEST(PointTree, WithNothingToFind) {
  std::vector<PointTree::Neighbor> found(3);
  const PointTree empty(Points{});
  empty.nearest({0, 0, 0}, 5, found);
  EXPECT_TRUE(found.empty());
  EXPECT_EQ(empty.nearest({0, 0, 0}, 1.0f).index, -1);
  EXPECT_EQ(empty.nearest_pair_of_all({{0, 0, 0}}, 1)[0].index, -1);
  EXPECT_EQ(empty.count_within({0, 0, 0}, 1.0f, 3), 0);
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const PointTree none(Points{{nan, 0, 0}});
  EXPECT_EQ(none.size(), 0u);
  const PointTree one(Points{{1, 0, 0}});
  EXPECT_EQ(one.nearest_pair_of_all({{0, 0, 0}}, 1)[0].index, 0);
  EXPECT_TRUE(std::isinf(one.nearest_pair_of_all({{0, 0, 0}}, 1)[0].second_squared_distance));
  one.nearest({nan, 0, 0}, 1, found);
  EXPECT_TRUE(found.empty());
  one.nearest({0, 0, 0}, 0, found);
  EXPECT_TRUE(found.empty());
  EXPECT_EQ(one.nearest({0, 0, 0}, 0.5f).index, -1);
  EXPECT_EQ(one.nearest({0, 0, 0}, 1.5f).index, 0);
  one.within({0, 0, 0}, nan, found);
  EXPECT_TRUE(found.empty());
}

TEST(MortonOrder, IsAPermutationThatKeepsNeighboursTogether) {
  Points points = make_points(0, 5000);
  points[10].x() = std::numeric_limits<float>::quiet_NaN();
  points[20] = points[30];
  const std::vector<int> order = morton_order(points);
  EXPECT_EQ(std::set<int>(order.begin(), order.end()).size(), points.size());
  EXPECT_EQ(order.back(), 10);
  const auto at = [&](int index) {
    return std::find(order.begin(), order.end(), index) - order.begin();
  };
  EXPECT_EQ(at(30), at(20) + 1);  // equal codes keep their order
  double along = 0.0, before = 0.0;
  for (std::size_t i = 0; i + 2 < order.size(); ++i) {
    along += (points[static_cast<std::size_t>(order[i])] -
              points[static_cast<std::size_t>(order[i + 1])])
                 .norm();
    if (i != 9 && i != 10) before += (points[i] - points[i + 1]).norm();
  }
  EXPECT_LT(along, 0.15 * before);
  EXPECT_TRUE(morton_order({}).empty());
  EXPECT_EQ(morton_order({{1, 1, 1}, {1, 1, 1}}), std::vector<int>({0, 1}));
  // The eight corners of a cube, by hand: x is the lowest bit.
  Points corners;
  for (int i = 7; i >= 0; --i) {
    corners.emplace_back(static_cast<float>(i & 1), static_cast<float>(i >> 1 & 1),
                         static_cast<float>(i >> 2));
  }
  EXPECT_EQ(morton_order(corners), std::vector<int>({7, 6, 5, 4, 3, 2, 1, 0}));
}

}  // namespace
}  // namespace camber
