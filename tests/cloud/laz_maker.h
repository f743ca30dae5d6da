#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace camber::test {

/// A LAZ file as other writers make them: what Camber itself never writes, too.
struct MadeLaz {
  int point_format = 3;
  int minor = 2;  ///< version 1.minor; formats from 6 on need 4
  int compressor = 2;
  int version = 0;  ///< of all items but wave packets of formats 4 and 5; 0: the usual one
  std::size_t extra_bytes = 0;
  /// Points of each chunk; all but the last are equal unless `variable`.
  std::vector<std::size_t> chunks{40, 40, 20};
  bool variable = false;
  bool table = true;
  bool offset_at_end = false;  ///< the table's place is the last 8 bytes
  /// An index: the first chunk is the root of an octree, the others lie below it, and beyond the
  /// second one in a second page. The cube is that of x, y, z in 0 to 100.
  bool copc = false;
};

/// @param records  gets the points as LAS would hold them
std::string make_laz(const MadeLaz& what, std::string* records = nullptr);

}  // namespace camber::test
