#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cstdint>
#include <utility>
#include <vector>

#include "camber/cloud/road_cloud.h"
#include "camber/plane/plane_solver.h"

namespace camber {

/// Frame in which a road is taken apart: z up, origin at a pivot amid the points.
struct LevelFrame {
  Eigen::Matrix3d level_from_cloud = Eigen::Matrix3d::Identity();  ///< rotation
  Eigen::Vector3d pivot = Eigen::Vector3d::Zero();  ///< m, true coordinates, cloud origin included

  Eigen::Vector3d to_level(const Eigen::Vector3d& x) const {
    return level_from_cloud * (x - pivot);
  }
  Eigen::Vector3d to_cloud(const Eigen::Vector3d& x) const {
    return level_from_cloud.transpose() * x + pivot;
  }
};

/// Points of a cloud in a level frame, ordered so that each of many small pieces of ground
/// ("leaves" of about 32 points, whatever the density) is a run of rows that begins at a multiple
/// of the kernels' lane count. Built by halving in plan; far strays do not distort it. The frame
/// and the halving depend on where the points lie among each other, not on their order, nor, but
/// for rounding, on where and how turned about up the cloud is.
class GroundTree {
 public:
  static constexpr std::uint32_t kPadding = 0xFFFFFFFFu;

  struct Leaf {
    std::size_t begin = 0, end = 0;  ///< rows that hold points
    std::size_t padded_end = 0;      ///< rows with the padding, a multiple of kLanes from begin
    Eigen::Array2f low, high;        ///< box in plan, m, without the outermost points
    std::uint64_t name = 0;          ///< by the way from the root: other leaves do not change it
  };
  /// Neighbouring leaves that hold a few hundred points together.
  struct Block {
    std::size_t first = 0, last = 0;  ///< leaves [first, last)
    std::uint64_t name = 0;           ///< as a leaf's
  };

  /// @param most_points  clouds with more are represented by about so many, drawn by place
  /// The tree is the same for any number of threads.
  GroundTree(const RoadCloud& cloud, const Eigen::Vector3d& up, std::uint64_t seed,
             std::size_t most_points, int num_threads = 1);

  const LevelFrame& frame() const { return frame_; }
  PointArrays& points() { return points_; }
  const PointArrays& points() const { return points_; }
  /// Index into the cloud of each row, kPadding for padding.
  const std::vector<std::uint32_t>& cloud_index() const { return cloud_index_; }
  const std::vector<Leaf>& leaves() const { return leaves_; }
  const std::vector<Block>& blocks() const { return blocks_; }
  /// Leaves whose boxes touch a leaf's, or whose parts of the plan do, with no wide gap between the
  /// points; ascending, itself not included.
  const std::vector<std::vector<int>>& neighbours() const { return neighbours_; }
  /// For the points of leaves [first, last), in the order of their rows, numbers by the small cells
  /// of the leaves' extent that they are in: what draws points by them draws the same ones of a
  /// cloud that was moved.
  std::vector<std::uint64_t> keys(std::size_t first, std::size_t last) const;
  std::size_t size() const { return size_; }  ///< points that are represented
  double spread() const { return spread_; }   ///< m, about 90 % lie within it of the pivot

  /// Index of the leaf to whose part of the ground a place in plan belongs.
  int locate(float x, float y) const { return locate_from(entry(x, y), x, y); }
  /// The same in two steps, of which the first, for many places, waits for memory but once.
  int entry(float x, float y) const;
  int locate_from(int entry, float x, float y) const;

 private:
  struct Node {
    int axis = 0;
    float split = 0.0f;
    int below = -1, above = -1;  ///< nodes; -1: leaf
    int leaf = -1;
    Eigen::Array2f low, high;
  };
  struct Row {
    float x, y, z;
    std::uint32_t index;
  };
  bool choose_frame(const RoadCloud& cloud, const Eigen::Vector3d& z, int num_threads);
  void take_rows(const RoadCloud& cloud, std::uint64_t seed, std::size_t most_points,
                 int num_threads);
  void sort_into_cells();
  int build_from_cells(int x0, int x1, int y0, int y1, bool in_block, std::uint64_t name);
  void join(int id, int axis, float split, int below, int above);
  int build(std::size_t begin, std::size_t end, bool in_block, Eigen::Array2f low,
            Eigen::Array2f high, std::uint64_t name);
  void finish_leaf(int id, std::size_t begin, std::size_t end, std::uint64_t name);
  static void sort_along_x(Row* rows, std::size_t count);
  void find_touching(std::size_t leaf, const Eigen::Array4f& part, std::vector<int>* stack,
                     std::vector<std::pair<int, int>>* pairs) const;
  void find_near(std::size_t leaf, std::vector<int>* stack,
                 std::vector<std::pair<int, int>>* pairs) const;
  void find_neighbours(int num_threads);
  void find_entries();
  void enter(int id, int x0, int x1, int y0, int y1);

  LevelFrame frame_;
  Eigen::Vector3f pivot_ = Eigen::Vector3f::Zero();  // relative to the cloud's origin
  Eigen::Array2f deviation_{0.0f, 0.0f};             // m, along x and y
  PointArrays points_;
  std::vector<std::uint32_t> cloud_index_;
  std::vector<Leaf> leaves_;
  std::vector<Block> blocks_;
  std::vector<Node> nodes_;
  std::vector<std::vector<int>> neighbours_;
  std::size_t size_ = 0;
  double spread_ = 0.0;

  /// Where the search for a place's leaf begins: a grid over the plan whose cells know a node that
  /// all of their places are in. Of clouds of which the tree holds a part alone.
  struct Entries {
    static constexpr int kSide = 256;
    float low[2] = {0.0f, 0.0f}, per_metre[2] = {0.0f, 0.0f};
    std::vector<int> nodes;
    /// Never falls as the value grows, so that a split is in one column or line.
    int cell(int axis, float value) const {
      const float place = (value - low[axis]) * per_metre[axis];
      return static_cast<int>(std::min(std::max(place, 0.0f), static_cast<float>(kSide - 1)));
    }
  };
  Entries entries_;

  // While building.
  struct Grid {
    int columns = 0, lines = 0;
    Eigen::Array2f low{0.0f, 0.0f}, size{1.0f, 1.0f};  // m, of the grid and of a cell
    std::vector<std::uint32_t> start;                  // of each cell's rows
    std::vector<std::uint32_t> sum;  // rows in the cells below and left of each corner
    std::vector<Row> rows;           // by cell
  };
  Grid grid_;
  std::size_t leaf_points_ = 0;
  std::vector<Row> rows_;
};

}  // namespace camber
