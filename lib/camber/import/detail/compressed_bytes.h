#pragma once

#include <cstdint>
#include <string>
#include <string_view>

/// Blocks of files that are compressed by lz4 (frames) or zstd.
namespace camber::detail {

/// Uncompresses a block whose size is known. Memory grows with what the data gives, not with what
/// the size claims.
/// @param compression  "lz4", "zstd" or nothing
/// @param position     for messages
/// @throws InputError for another compression, or data that is not so many bytes.
std::string uncompress_block(std::string_view compression, std::string_view data,
                             std::uint64_t size, const std::string& file,
                             const std::string& position);

/// Uncompresses one zstd frame whose size stands in it. @throws InputError.
std::string uncompress_zstd(std::string_view data, const std::string& file,
                            const std::string& position);

}  // namespace camber::detail
