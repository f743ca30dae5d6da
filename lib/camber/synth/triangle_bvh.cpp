#include "camber/synth/triangle_bvh.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numeric>

namespace camber {
namespace {

constexpr int kLeafSize = 4;

/// Moeller and Trumbore, "Fast, Minimum Storage Ray/Triangle Intersection", 1997.
bool meet(const TrianglePoints& t, const Eigen::Vector3d& origin, const Eigen::Vector3d& direction,
          double* distance) {
  const Eigen::Vector3d e1 = t[1] - t[0], e2 = t[2] - t[0];
  const Eigen::Vector3d p = direction.cross(e2);
  const double determinant = e1.dot(p);
  if (determinant == 0.0) return false;
  const double inverse = 1.0 / determinant;
  const Eigen::Vector3d s = origin - t[0];
  const double u = s.dot(p) * inverse;
  // A hair's breadth of overlap, so that no ray slips between two neighbours.
  constexpr double kSlack = 1e-9;
  if (u < -kSlack || u > 1.0 + kSlack) return false;
  const Eigen::Vector3d q = s.cross(e1);
  const double v = direction.dot(q) * inverse;
  if (v < -kSlack || u + v > 1.0 + kSlack) return false;
  *distance = e2.dot(q) * inverse;
  return true;
}

}  // namespace

TriangleBvh::TriangleBvh(std::vector<TrianglePoints> triangles) : triangles_(std::move(triangles)) {
  const int count = static_cast<int>(triangles_.size());
  order_.resize(count);
  std::iota(order_.begin(), order_.end(), 0);
  std::vector<Eigen::Vector3d> centers(count);
  for (int i = 0; i < count; ++i) {
    centers[i] = (triangles_[i][0] + triangles_[i][1] + triangles_[i][2]) / 3.0;
  }
  nodes_.reserve(static_cast<std::size_t>(count) + 1);
  if (count > 0) build(0, count, centers);
}

int TriangleBvh::build(int first, int count, std::vector<Eigen::Vector3d>& centers) {
  const int index = static_cast<int>(nodes_.size());
  nodes_.emplace_back();
  Eigen::Vector3d low = Eigen::Vector3d::Constant(std::numeric_limits<double>::infinity());
  Eigen::Vector3d high = -low, center_low = low, center_high = high;
  for (int i = first; i < first + count; ++i) {
    for (const Eigen::Vector3d& p : triangles_[order_[i]]) {
      low = low.cwiseMin(p);
      high = high.cwiseMax(p);
    }
    center_low = center_low.cwiseMin(centers[order_[i]]);
    center_high = center_high.cwiseMax(centers[order_[i]]);
  }
  for (int a = 0; a < 3; ++a) {
    constexpr float kInfinity = std::numeric_limits<float>::infinity();
    nodes_[index].low[a] = std::nextafter(static_cast<float>(low[a]), -kInfinity);
    nodes_[index].high[a] = std::nextafter(static_cast<float>(high[a]), kInfinity);
  }
  if (count <= kLeafSize) {
    nodes_[index].first = first;
    nodes_[index].count = count;
    return index;
  }
  // Median split along the longest axis; ties broken by index, so the tree is always the same.
  int axis = 0;
  (center_high - center_low).maxCoeff(&axis);
  const int middle = first + count / 2;
  std::nth_element(order_.begin() + first, order_.begin() + middle, order_.begin() + first + count,
                   [&](int a, int b) {
                     const double ca = centers[a][axis], cb = centers[b][axis];
                     return ca < cb || (ca == cb && a < b);
                   });
  build(first, count / 2, centers);
  const int right = build(middle, count - count / 2, centers);
  nodes_[index].first = right;
  nodes_[index].count = 0;
  return index;
}

template <bool kAny>
RayHit TriangleBvh::traverse(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction,
                             double nearest, double farthest) const {
  RayHit hit;
  if (nodes_.empty()) return hit;
  const Eigen::Vector3d inverse = direction.cwiseInverse();
  double limit = farthest;
  const auto enter = [&](const Node& node) {
    double t0 = nearest, t1 = limit;
    for (int a = 0; a < 3; ++a) {
      double ta = (node.low[a] - origin[a]) * inverse[a];
      double tb = (node.high[a] - origin[a]) * inverse[a];
      if (ta > tb) std::swap(ta, tb);
      // NaN (a ray inside a slab's face) compares false and leaves the interval as it is.
      if (ta > t0) t0 = ta;
      if (tb < t1) t1 = tb;
    }
    return t0 <= t1 ? t0 : std::numeric_limits<double>::infinity();
  };
  int stack[64];
  int size = 0;
  stack[size++] = 0;
  while (size > 0) {
    const int index = stack[--size];
    const Node& node = nodes_[index];
    if (std::isinf(enter(node))) continue;
    if (node.count > 0) {
      for (int i = node.first; i < node.first + node.count; ++i) {
        double distance = 0.0;
        const int triangle = order_[i];
        if (!meet(triangles_[triangle], origin, direction, &distance)) continue;
        if (distance <= nearest || distance >= farthest) continue;
        if (distance < hit.distance || (distance == hit.distance && triangle < hit.triangle)) {
          hit = {distance, triangle};
          limit = distance;
          if (kAny) return hit;
        }
      }
      continue;
    }
    const int left = index + 1, right = node.first;
    const double enter_left = enter(nodes_[left]), enter_right = enter(nodes_[right]);
    const int first = enter_left <= enter_right ? left : right;
    const int second = first == left ? right : left;
    if (!std::isinf(std::max(enter_left, enter_right))) stack[size++] = second;
    if (!std::isinf(std::min(enter_left, enter_right))) stack[size++] = first;
  }
  return hit;
}

RayHit TriangleBvh::cast(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction,
                         double nearest, double farthest) const {
  return traverse<false>(origin, direction, nearest, farthest);
}

bool TriangleBvh::blocked(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction,
                          double nearest, double farthest) const {
  return traverse<true>(origin, direction, nearest, farthest).triangle >= 0;
}

}  // namespace camber
