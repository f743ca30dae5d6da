#pragma once

#include <Eigen/Core>
#include <array>
#include <limits>
#include <vector>

namespace camber {

using TrianglePoints = std::array<Eigen::Vector3d, 3>;

/// Where a ray meets a triangle.
struct RayHit {
  double distance = std::numeric_limits<double>::infinity();  ///< in lengths of the direction
  int triangle = -1;                                          ///< -1: none
};

/// Bounding volume hierarchy over triangles, for exact visibility. Both sides of a triangle count.
/// Answers do not depend on the order of the build: equal distances go to the lower index.
class TriangleBvh {
 public:
  TriangleBvh() = default;
  explicit TriangleBvh(std::vector<TrianglePoints> triangles);

  bool empty() const { return triangles_.empty(); }
  const std::vector<TrianglePoints>& triangles() const { return triangles_; }

  /// Nearest hit with a distance in (nearest, farthest).
  RayHit cast(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction, double nearest,
              double farthest) const;
  /// Whether anything lies between.
  bool blocked(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction, double nearest,
               double farthest) const;

 private:
  struct Node {
    std::array<float, 3> low, high;  ///< rounded outwards
    int first = 0;                   ///< leaf: into order_; inner: the right child (left is next)
    int count = 0;                   ///< 0: inner
  };
  int build(int first, int count, std::vector<Eigen::Vector3d>& centers);
  template <bool kAny>
  RayHit traverse(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction, double nearest,
                  double farthest) const;

  std::vector<TrianglePoints> triangles_;
  std::vector<int> order_;
  std::vector<Node> nodes_;
};

}  // namespace camber
