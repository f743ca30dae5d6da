#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "camber/cloud/detail/unnamed_file.h"

namespace camber::laz {

/// A node of the octree: of level 0 there is one, a cell of level L is split into 2^L an axis.
struct OctreeKey {
  std::int32_t level = 0;
  std::array<std::int32_t, 3> cell{};  ///< x, y, z
};

/// The cube that all points lie in, in the units of the file.
struct OctreeCube {
  std::array<double, 3> low{};
  double side = 1.0;
};

struct OctreeOptions {
  std::size_t record_length = 0;            ///< bytes; x, y and z are the first 12
  std::array<double, 3> scale{}, offset{};  ///< of the coordinates
  OctreeCube cube;
  std::size_t memory = std::size_t{256} << 20;  ///< bytes of records that are held at once
  std::filesystem::path beside;  ///< file in whose folder the others are for the time
};

/// Points of a node an axis: the side of a node holds so many cells, and of the points in a cell
/// one stays in the node.
inline constexpr int kOctreeCells = 128;
/// A node that would have at most so many points with those below it keeps them all.
inline constexpr std::size_t kMostInLeaf = 32768;

/// Gives records to a function, in blocks of some of them, from the first to the last.
using RecordBlocks =
    std::function<void(const std::function<void(const char* records, std::size_t count)>&)>;

/// Sorts points into the levels of an octree: of each cell of a node's grid the first point stays
/// in the node, the others go to the nodes below, down to where few are left. The same for any
/// memory.
class OctreeSort {
 public:
  /// @param node  is given each node with its records, in the order of the input; a node comes
  ///              before those below it, and these before its next neighbour
  using NodeSink = std::function<void(const OctreeKey& key, std::string records)>;
  OctreeSort(const OctreeOptions& options, NodeSink node);
  ~OctreeSort();

  /// @throws OutputError where the disk is full; std::invalid_argument where more points than fit
  ///         into memory lie at one place
  void sort(std::uint64_t points, const RecordBlocks& input);

 private:
  struct Run;
  class Spill;

  std::array<std::uint32_t, 3> place_of(const char* record) const;
  void sort_subtree(const OctreeKey& key, std::uint64_t points, const RecordBlocks& input);
  void split(const OctreeKey& key, const RecordBlocks& input);
  void divide(const OctreeKey& key, const std::string& records, std::vector<std::uint32_t> order);

  OctreeOptions options_;
  NodeSink node_;
  std::array<double, 3> by_step_{}, low_{};  // places a step; the cube's corner in steps
  std::int32_t deepest_ = 0;
  std::unique_ptr<Spill> spill_;
};

}  // namespace camber::laz
