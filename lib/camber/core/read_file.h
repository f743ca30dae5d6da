#pragma once

#include <cstddef>
#include <filesystem>
#include <fstream>
#include <string>
#include <string_view>

namespace camber {

/// A file's bytes to read. @throws InputError if it is missing, a folder or cannot be opened.
std::ifstream open_file(const std::filesystem::path& path);

/// The whole of a file of at most `max_bytes`. @throws InputError if it is missing, a folder,
/// unreadable or larger.
std::string read_whole_file(const std::filesystem::path& path,
                            std::size_t max_bytes = std::size_t{1} << 30);

/// Text from outside, made fit for a message: control and non-ASCII bytes as '?', clipped.
std::string printable(std::string_view text, std::size_t max_length = 40);

}  // namespace camber
