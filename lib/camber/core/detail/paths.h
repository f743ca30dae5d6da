#pragma once

#include <filesystem>

namespace camber::paths {

/// Absolute, without links, "." and "..", and without a slash at the end, as far as it exists.
std::filesystem::path resolved(const std::filesystem::path& path);

/// Whether `path` is `folder` or lies in it; both resolved.
bool lies_in(const std::filesystem::path& path, const std::filesystem::path& folder);

/// Whether what `name` names, or a link on that name itself, is the folder or lies in it.
/// @param folder  resolved
bool holds_name(const std::filesystem::path& folder, const std::filesystem::path& name);

}  // namespace camber::paths
