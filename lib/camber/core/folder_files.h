#pragma once

#include <filesystem>
#include <vector>

namespace camber {

/// A pipe, a device or a socket: opening one may wait for ever.
bool is_special_file(const std::filesystem::path& path);

/// The files of a folder in the system's order, without folders and special files. A link that
/// leads nowhere is among them. @throws InputError if it cannot be listed.
std::vector<std::filesystem::path> files_in(const std::filesystem::path& folder);

}  // namespace camber
