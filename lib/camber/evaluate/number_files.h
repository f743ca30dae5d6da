#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <utility>
#include <vector>

namespace camber {

/// A 4 x 4 transform as text: 16 numbers row by row, or 12 for its first three rows; blanks, commas
/// or semicolons between them, # to the end of a line is left out.
/// @throws InputError also for a matrix that cannot be inverted or whose last row is not 0 0 0 1.
Eigen::Matrix4d read_transform(const std::filesystem::path& path);

/// Corresponding places as text, in the same form: rows x y z of the one, x y z of the other.
/// @throws InputError.
std::vector<std::pair<Eigen::Vector3d, Eigen::Vector3d>> read_point_pairs(
    const std::filesystem::path& path);

}  // namespace camber
