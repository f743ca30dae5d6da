#pragma once

#include <string>
#include <vector>

#include "camber/cloud/file_reader.h"

namespace camber::detail {

/// The columns of a file of little-endian float32 without a header: x y z (and others).
struct BinLayout {
  std::vector<std::string> columns;  ///< one a float
  bool kitti = false;                ///< x y z intensity, as the format's name promises
};

/// Finds how many floats a point has: KITTI 4 (x y z reflectance), nuScenes 5 (with a ring), others
/// 3 or 6. With the right number each column is one quantity; with a wrong one the columns are
/// mixtures of several and spread farther. So the mean logarithm of the columns' standard
/// deviations is least for the right one. It is taken from at most 107 kB of the file.
/// @param lenient  a file that is cut within a point is taken, too
/// @throws InputError where the size fits no number of floats, where several fit equally well, or
///         where the best has no known columns; the message names them.
BinLayout find_bin_layout(const FileBytes& file, bool lenient);

}  // namespace camber::detail
