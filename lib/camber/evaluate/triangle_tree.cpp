#include "camber/evaluate/triangle_tree.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "camber/cloud/morton.h"
#include "camber/core/threads.h"

namespace camber {
namespace {

constexpr int kLeaf = 4;  // triangles, at most

Eigen::Vector3d nearest_on_segment(const Eigen::Vector3d& p, const Eigen::Vector3d& a,
                                   const Eigen::Vector3d& b) {
  const Eigen::Vector3d ab = b - a;
  const double length = ab.squaredNorm();
  if (!(length > 0.0)) return a;
  return a + std::clamp((p - a).dot(ab) / length, 0.0, 1.0) * ab;
}

}  // namespace

Eigen::Vector3d nearest_on_triangle(const Eigen::Vector3d& p, const Eigen::Vector3d& a,
                                    const Eigen::Vector3d& b, const Eigen::Vector3d& c) {
  const Eigen::Vector3d ab = b - a, ac = c - a, ap = p - a;
  const double d1 = ab.dot(ap), d2 = ac.dot(ap);
  if (d1 <= 0.0 && d2 <= 0.0) return a;
  const Eigen::Vector3d bp = p - b;
  const double d3 = ab.dot(bp), d4 = ac.dot(bp);
  if (d3 >= 0.0 && d4 <= d3) return b;
  const Eigen::Vector3d cp = p - c;
  const double d5 = ab.dot(cp), d6 = ac.dot(cp);
  if (d6 >= 0.0 && d5 <= d6) return c;
  const double vc = d1 * d4 - d3 * d2, vb = d5 * d2 - d1 * d6, va = d3 * d6 - d5 * d4;
  const double sum = va + vb + vc;
  // Slivers: the areas above are rounding alone.
  const bool flat = !(sum > 1e-14 * ab.squaredNorm() * ac.squaredNorm());
  if (flat || va <= 0.0 || vb <= 0.0 || vc <= 0.0) {
    // On the border; the nearest of the edges that can be it.
    Eigen::Vector3d best = nearest_on_segment(p, a, b);
    double least = (best - p).squaredNorm();
    for (const Eigen::Vector3d& q : {nearest_on_segment(p, b, c), nearest_on_segment(p, c, a)}) {
      const double d = (q - p).squaredNorm();
      if (d < least) {
        least = d;
        best = q;
      }
    }
    return best;
  }
  return a + ab * (vb / sum) + ac * (vc / sum);
}

TriangleTree::TriangleTree(std::vector<Eigen::Vector3d> vertices,
                           const std::vector<std::array<std::uint32_t, 3>>& triangles)
    : vertices_(std::move(vertices)), triangles_(triangles) {
  std::vector<Eigen::Vector3d> centers(triangles_.size());
  for (std::size_t t = 0; t < triangles_.size(); ++t) {
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (const std::uint32_t v : triangles_[t]) {
      if (v >= vertices_.size()) {
        throw std::invalid_argument("triangle " + std::to_string(t) + ": found vertex " +
                                    std::to_string(v) + ", expected below " +
                                    std::to_string(vertices_.size()));
      }
      sum += vertices_[v];
    }
    centers[t] = sum / 3.0;
    if (sum.allFinite()) order_.push_back(static_cast<int>(t));
  }
  if (order_.empty()) return;
  nodes_.reserve(order_.size());
  build(0, static_cast<int>(order_.size()), centers);
  corners_.reserve(order_.size());
  for (const int t : order_) {
    const auto& triangle = triangles_[static_cast<std::size_t>(t)];
    corners_.push_back({vertices_[triangle[0]], vertices_[triangle[1]], vertices_[triangle[2]]});
  }
}

int TriangleTree::build(int first, int count, std::vector<Eigen::Vector3d>& centers) {
  const int index = static_cast<int>(nodes_.size());
  nodes_.emplace_back();
  Eigen::Vector3d low = Eigen::Vector3d::Constant(std::numeric_limits<double>::infinity()),
                  high = -low, center_low = low, center_high = high;
  for (int i = first; i < first + count; ++i) {
    const std::size_t t = static_cast<std::size_t>(order_[static_cast<std::size_t>(i)]);
    for (const std::uint32_t v : triangles_[t]) {
      low = low.cwiseMin(vertices_[v]);
      high = high.cwiseMax(vertices_[v]);
    }
    center_low = center_low.cwiseMin(centers[t]);
    center_high = center_high.cwiseMax(centers[t]);
  }
  Node node;
  for (int axis = 0; axis < 3; ++axis) {
    const float infinity = std::numeric_limits<float>::infinity();
    node.low[axis] = std::nextafter(static_cast<float>(low[axis]), -infinity);
    node.high[axis] = std::nextafter(static_cast<float>(high[axis]), infinity);
  }
  if (count <= kLeaf) {
    node.first = first;
    node.count = count;
    nodes_[static_cast<std::size_t>(index)] = node;
    return index;
  }
  int axis = 0;
  (center_high - center_low).maxCoeff(&axis);
  const int half = count / 2;
  std::nth_element(order_.begin() + first, order_.begin() + first + half,
                   order_.begin() + first + count, [&](int a, int b) {
                     const double x = centers[static_cast<std::size_t>(a)][axis],
                                  y = centers[static_cast<std::size_t>(b)][axis];
                     return x < y || (x == y && a < b);
                   });
  build(first, half, centers);
  node.first = build(first + half, count - half, centers);
  nodes_[static_cast<std::size_t>(index)] = node;
  return index;
}

double TriangleTree::distance_to(int at, const Eigen::Vector3d& place) const {
  const Corners& t = corners_[static_cast<std::size_t>(at)];
  return (nearest_on_triangle(place, t.a, t.b, t.c) - place).squaredNorm();
}

TriangleTree::Nearest TriangleTree::nearest(const Eigen::Vector3d& place, double limit) const {
  Nearest best;
  best.squared_distance = limit;
  if (order_.empty() || !place.allFinite()) return {};
  const auto box_distance = [&](const Node& node) {
    double sum = 0.0;
    for (int axis = 0; axis < 3; ++axis) {
      const double outside = std::max(std::max(static_cast<double>(node.low[axis]) - place[axis],
                                               place[axis] - static_cast<double>(node.high[axis])),
                                      0.0);
      sum += outside * outside;
    }
    return sum;
  };
  struct Pending {
    int node;
    double bound;
  };
  Pending stack[64];  // the tree is balanced
  int height = 0;
  stack[height++] = {0, box_distance(nodes_[0])};
  while (height > 0) {
    const Pending at = stack[--height];
    if (at.bound > best.squared_distance) continue;
    int here = at.node;
    for (;;) {
      const Node& node = nodes_[static_cast<std::size_t>(here)];
      if (node.count > 0) {
        for (int i = node.first; i < node.first + node.count; ++i) {
          const double distance = distance_to(i, place);
          const int triangle = order_[static_cast<std::size_t>(i)];
          if (distance < best.squared_distance ||
              (distance == best.squared_distance && triangle < best.triangle)) {
            best = {triangle, distance};
          }
        }
        break;
      }
      int near = here + 1, far = node.first;
      double near_bound = box_distance(nodes_[static_cast<std::size_t>(near)]);
      double far_bound = box_distance(nodes_[static_cast<std::size_t>(far)]);
      if (far_bound < near_bound) {
        std::swap(near, far);
        std::swap(near_bound, far_bound);
      }
      if (far_bound <= best.squared_distance) stack[height++] = {far, far_bound};
      if (near_bound > best.squared_distance) break;
      here = near;
    }
  }
  if (best.triangle < 0) return {};
  return best;
}

std::vector<TriangleTree::Nearest> TriangleTree::nearest_of_all(
    const std::vector<Eigen::Vector3d>& places, int num_threads) const {
  std::vector<Nearest> out(places.size());
  if (order_.empty()) return out;
  std::vector<Eigen::Vector3f> rounded(places.size());
  for (std::size_t i = 0; i < places.size(); ++i) {
    rounded[i] = (places[i] - corners_[0].a).cast<float>();
  }
  const std::vector<int> order = morton_order(rounded);
  std::vector<int> position(triangles_.size(), -1);
  for (std::size_t i = 0; i < order_.size(); ++i) {
    position[static_cast<std::size_t>(order_[i])] = static_cast<int>(i);
  }
  constexpr std::size_t kBlock = 4096;
  parallel_for((order.size() + kBlock - 1) / kBlock, num_threads, [&](std::size_t block) {
    int last = -1;  // the last place's triangle is near this one too
    const std::size_t end = std::min(order.size(), (block + 1) * kBlock);
    for (std::size_t i = block * kBlock; i < end; ++i) {
      const Eigen::Vector3d& place = places[static_cast<std::size_t>(order[i])];
      if (!place.allFinite()) continue;
      double limit = std::numeric_limits<double>::infinity();
      if (last >= 0) {
        limit =
            distance_to(position[static_cast<std::size_t>(last)], place) * (1.0 + 1e-12) + 1e-300;
      }
      const Nearest found = nearest(place, limit);
      if (found.triangle < 0) continue;  // too far for numbers
      out[static_cast<std::size_t>(order[i])] = found;
      last = found.triangle;
    }
  });
  return out;
}

Eigen::Vector3d TriangleTree::normal(int triangle) const {
  const auto& t = triangles_[static_cast<std::size_t>(triangle)];
  const Eigen::Vector3d n =
      (vertices_[t[1]] - vertices_[t[0]]).cross(vertices_[t[2]] - vertices_[t[0]]);
  const double length = n.norm();
  return length > 0.0 ? Eigen::Vector3d(n / length) : Eigen::Vector3d::Zero();
}

}  // namespace camber
