#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <vector>

#include "camber/cloud/las_file.h"
#include "camber/cloud/point_stream.h"

namespace camber {

/// How many points each part of a LAZ file has that is coded apart from all others, in the order of
/// the file; empty where there are no such parts, or where they are not known.
std::vector<std::uint64_t> las_chunks(const LasFile& las);

/// Opens some of these parts of a LAS or LAZ file: the others are not read.
/// @param chunks  numbers into las_chunks() of the file, ascending
/// @throws InputError also where the file has no such parts.
std::unique_ptr<PointSource> open_las_chunks(const std::filesystem::path& path,
                                             const ReadOptions& options,
                                             const std::vector<std::size_t>& chunks);

}  // namespace camber
