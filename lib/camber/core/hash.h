#pragma once

#include <filesystem>
#include <string>
#include <string_view>

namespace camber {

/// XXH3 128-bit hash of a file's bytes as 32 hexadecimal digits, to distinguish inputs (not
/// for security). @throws InputError if the file cannot be read.
std::string hash_file(const std::filesystem::path& path);

/// The same of bytes in memory.
std::string hash_bytes(std::string_view bytes);

}  // namespace camber
