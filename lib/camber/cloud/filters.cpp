#include "camber/cloud/filters.h"

#include <cmath>
#include <stdexcept>
#include <string>

#include "camber/cloud/point_tree.h"
#include "camber/core/threads.h"

namespace camber {
namespace {

void require(bool good, const char* name, double value, const char* expected) {
  if (good) return;
  throw std::invalid_argument(std::string(name) + " = " + std::to_string(value) + ", expected " +
                              expected);
}

}  // namespace

std::vector<int> finite_points(const RoadCloud& cloud) {
  std::vector<int> kept;
  kept.reserve(cloud.size());
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    if (cloud.points[i].allFinite()) kept.push_back(static_cast<int>(i));
  }
  return kept;
}

std::vector<int> crop(const RoadCloud& cloud, const CropBox& box, bool inverted) {
  std::vector<int> kept;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Eigen::Vector3f& p = cloud.points[i];
    if (p.allFinite() && box.contains(cloud.origin + p.cast<double>()) != inverted) {
      kept.push_back(static_cast<int>(i));
    }
  }
  return kept;
}

std::vector<int> statistical_inliers(const RoadCloud& cloud, int neighbors, double deviations,
                                     int num_threads) {
  require(neighbors >= 1, "neighbors", neighbors, "at least 1");
  require(std::isfinite(deviations), "deviations", deviations, "a finite number");
  const PointTree tree(cloud.points, num_threads);
  std::vector<double> means(cloud.size(), std::numeric_limits<double>::infinity());
  if (tree.size() > 1) {
    tree.for_each_neighborhood(
        neighbors + 1, num_threads, [&](const PointTree::Neighborhood& near) {
          float sum = 0.0f;  // the first is the point itself, or another one at the same place
          for (int i = 1; i < near.count; ++i) sum += std::sqrt(near.squared_distances[i]);
          means[static_cast<std::size_t>(near.index)] = sum / static_cast<float>(near.count - 1);
        });
  }
  double sum = 0.0, squares = 0.0, count = 0.0;
  for (const double mean : means) {
    if (!std::isfinite(mean)) continue;
    sum += mean;
    squares += mean * mean;
    count += 1.0;
  }
  std::vector<int> kept;
  if (count < 2.0) return kept;
  const double mean = sum / count;
  const double variance = std::max(0.0, (squares - sum * mean) / (count - 1.0));
  const double limit = mean + deviations * std::sqrt(variance);
  kept.reserve(cloud.size());
  for (std::size_t i = 0; i < means.size(); ++i) {
    if (means[i] <= limit) kept.push_back(static_cast<int>(i));
  }
  return kept;
}

std::vector<int> radius_inliers(const RoadCloud& cloud, double radius, int neighbors,
                                int num_threads) {
  require(std::isfinite(radius) && radius > 0.0, "radius", radius, "a positive number of metres");
  require(neighbors >= 1, "neighbors", neighbors, "at least 1");
  const PointTree tree(cloud.points, num_threads);
  std::vector<unsigned char> good(cloud.size(), 0);
  constexpr std::size_t kBlock = 1024;
  const std::vector<int>& order = tree.indices();  // neighbours follow each other
  parallel_for((order.size() + kBlock - 1) / kBlock, num_threads, [&](std::size_t block) {
    const std::size_t end = std::min(order.size(), (block + 1) * kBlock);
    for (std::size_t i = block * kBlock; i < end; ++i) {
      const std::size_t at = static_cast<std::size_t>(order[i]);
      good[at] = tree.count_within(cloud.points[at], static_cast<float>(radius), neighbors + 1) >
                 neighbors;
    }
  });
  std::vector<int> kept;
  for (std::size_t i = 0; i < good.size(); ++i) {
    if (good[i] != 0) kept.push_back(static_cast<int>(i));
  }
  return kept;
}

}  // namespace camber
