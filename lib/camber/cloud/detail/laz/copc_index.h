#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "camber/cloud/detail/laz/laz_format.h"
#include "camber/cloud/detail/laz/octree_sort.h"

namespace camber::laz {

inline constexpr int kCopcInfoId = 1, kCopcIndexId = 1000;  ///< of its records
/// Entries of a page of the index, unless a page of one node's surroundings has more.
inline constexpr std::size_t kMostEntriesOfPage = 4096;

struct CopcNode {
  OctreeKey key;
  LazChunk chunk;
};

struct CopcIndex {
  std::string pages;            ///< content of the record, the root page first
  std::uint64_t root_size = 0;  ///< bytes of that page
};

/// @param nodes  each before those below it, and these before its next neighbour
/// @param place  where the content of the record will be in the file
CopcIndex make_copc_index(const std::vector<CopcNode>& nodes, std::uint64_t place);

struct CopcInfo {
  OctreeCube cube;
  std::uint64_t root_start = 0, root_size = 0;  ///< of the index's root page in the file
  double first_time = 0.0, last_time = 0.0;     ///< GPS times of the points
};

/// The content of the record that comes first in the file.
std::string copc_info(const CopcInfo& info);

}  // namespace camber::laz
