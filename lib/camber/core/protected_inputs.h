#pragma once

#include <filesystem>
#include <vector>

namespace camber {

/// From now on no output takes the place of one of these files or folders, under any of its names
/// (links), nor that of a folder that holds one: files and folders written atomically
/// (core/atomic_file.h) refuse, and so do the checks before. Names of nothing are skipped. For a
/// program that reads them, writes its results and ends.
void protect_inputs(const std::vector<std::filesystem::path>& inputs);

/// @throws UsageError if a file at `path` would take the place of a protected input.
void refuse_protected_file(const std::filesystem::path& path);

/// @throws UsageError if what a folder at `path` would replace is a protected input or holds one.
void refuse_protected_folder(const std::filesystem::path& path);

}  // namespace camber
