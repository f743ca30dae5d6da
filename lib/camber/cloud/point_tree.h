#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <vector>

namespace camber {

namespace detail {
struct PointTreeView;
struct PointTreeBox {
  float low[4], high[4];  ///< three axes and a zero
};
}  // namespace detail

/// Exact nearest neighbours among 3D points: a balanced k-d tree whose points lie in memory in the
/// order of its leaves. It keeps a copy of the points; those that are not finite are left out.
/// Immutable after construction: any number of threads may search it.
class PointTree {
 public:
  struct Neighbor {
    int index = -1;                ///< into the points that the tree was made of
    float squared_distance = 0.f;  ///< m^2
  };

  /// @param points at most 2^31 - 1. The tree is the same for any number of threads.
  explicit PointTree(const std::vector<Eigen::Vector3f>& points, int num_threads = 1);

  /// Number of (finite) points.
  std::size_t size() const { return index_.size(); }

  /// The nearest min(k, size()) points by ascending distance, equal distances by ascending index.
  /// A query that is not finite has none. `out` is overwritten.
  void nearest(const Eigen::Vector3f& query, int k, std::vector<Neighbor>& out) const;

  /// The nearest point if it is closer than `largest_distance`, else index -1.
  Neighbor nearest(const Eigen::Vector3f& query, float largest_distance) const;

  /// The nearest point of a query, and how far the next one is, which shows where rounding leaves
  /// the nearest open.
  struct NearestPair {
    int index = -1;
    float squared_distance = 0.f;         ///< m^2
    float second_squared_distance = 0.f;  ///< m^2; infinite if the tree holds one point alone
  };

  /// The nearest point of each query (index -1 for those that are not finite), far faster than one
  /// search after the other: those of a leaf of a tree of the queries go together. On at most
  /// `num_threads` threads; the result does not depend on them. Of several points at the same
  /// distance any one may be given, always the same.
  std::vector<NearestPair> nearest_pair_of_all(const std::vector<Eigen::Vector3f>& queries,
                                               int num_threads) const;

  /// The same for the points of one leaf of another tree.
  struct LeafNeighbors {
    int begin = 0, count = 0;        ///< the queries, in x(), y(), z() of their tree
    const float *x, *y, *z;          ///< the queries, shifted
    const int* positions = nullptr;  ///< of their nearest, in x(), y(), z() of this one; -1: none
    const float* squared_distances = nullptr;         ///< m^2
    const float* second_squared_distances = nullptr;  ///< m^2; infinite if there is none
  };

  /// Calls visit for each leaf of a tree of queries, to which `shift` is added (m), on at most
  /// `num_threads` threads; calls are not in order, and two may happen at once.
  void for_each_leaf_of(const PointTree& queries, const Eigen::Vector3d& shift, int num_threads,
                        const std::function<void(const LeafNeighbors&)>& visit) const;

  /// The points at most `radius` away, in the same order. `out` is overwritten.
  void within(const Eigen::Vector3f& query, float radius, std::vector<Neighbor>& out) const;

  /// Number of points at most `radius` away, counted up to `enough`.
  int count_within(const Eigen::Vector3f& query, float radius, int enough) const;

  /// The neighbourhood of one of the tree's own points.
  struct Neighborhood {
    int index = -1;                            ///< the point, into the original points
    Eigen::Vector3f point;                     ///< the point itself
    int count = 0;                             ///< of its neighbours
    const int* positions = nullptr;            ///< of the neighbours in x(), y(), z(), by distance
    const float* squared_distances = nullptr;  ///< ascending; the first is the point itself, 0
  };

  /// Calls visit for each point with its k nearest points (itself included), far faster than
  /// searching one by one, on at most `num_threads` threads; calls are not in order, and two may
  /// happen at once.
  void for_each_neighborhood(int k, int num_threads,
                             const std::function<void(const Neighborhood&)>& visit) const;

  /// The points in the tree's order (behind the last some zeros), and their indices in the original
  /// points.
  const std::vector<float>& x() const { return x_; }
  const std::vector<float>& y() const { return y_; }
  const std::vector<float>& z() const { return z_; }
  const std::vector<int>& indices() const { return index_; }

 private:
  detail::PointTreeView view() const;

  // A complete binary tree of 2^levels_ leaves: node i has the children 2 i and 2 i + 1, the root
  // is 1; leaf l is node 2^levels_ + l.
  int levels_ = 0;
  std::vector<detail::PointTreeBox> boxes_;  // of the points below each node
  std::vector<int> leaf_start_;              // first position of each leaf, and the end
  std::vector<float> x_, y_, z_;
  std::vector<int> index_;
};

}  // namespace camber
