#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <limits>
#include <memory>
#include <vector>

namespace camber {

/// The point of a triangle nearest to a place; also of degenerate triangles.
/// Ericson, "Real-Time Collision Detection", 2005, section 5.1.5.
Eigen::Vector3d nearest_on_triangle(const Eigen::Vector3d& place, const Eigen::Vector3d& a,
                                    const Eigen::Vector3d& b, const Eigen::Vector3d& c);

/// Exact distances from points to a mesh. Embree's tree, in float, finds the triangles that can be
/// nearest; their distances are measured in double. Coordinates should be small, relative to an
/// origin near the mesh: the tree is then tight. Immutable after construction: any number of
/// threads may search it.
class TriangleTree {
 public:
  struct Nearest {
    int triangle = -1;  ///< -1: none; of equally near ones, the first
    double squared_distance = std::numeric_limits<double>::infinity();
  };

  /// Triangles with a corner that is not finite as a float are left out.
  /// @param triangles indices into `vertices`, at most 2^31 - 1
  /// @throws std::invalid_argument for an index out of range.
  TriangleTree(std::vector<Eigen::Vector3d> vertices,
               const std::vector<std::array<std::uint32_t, 3>>& triangles);
  ~TriangleTree();
  TriangleTree(TriangleTree&& other) noexcept;
  TriangleTree& operator=(TriangleTree&& other) noexcept;

  bool empty() const;

  /// The nearest triangle if it is closer than the square root of `limit`.
  Nearest nearest(const Eigen::Vector3d& place,
                  double limit = std::numeric_limits<double>::infinity()) const;

  /// The same for many places (none for those that are not finite), which are taken in an order in
  /// which neighbours follow each other. The result does not depend on the number of threads.
  std::vector<Nearest> nearest_of_all(const std::vector<Eigen::Vector3d>& places,
                                      int num_threads) const;

  /// Unit normal by the order of the corners; zero for a degenerate triangle.
  Eigen::Vector3d normal(int triangle) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace camber
