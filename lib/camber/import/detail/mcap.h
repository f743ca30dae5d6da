#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "camber/cloud/file_reader.h"

/// What reading and writing MCAP share: the format of mcap.dev, version 0.
namespace camber::detail {

inline constexpr std::string_view kMcapMagic{"\x89MCAP0\r\n", 8};

enum class McapRecord : unsigned char {
  kHeader = 0x01,
  kFooter = 0x02,
  kSchema = 0x03,
  kChannel = 0x04,
  kMessage = 0x05,
  kChunk = 0x06,
  kMessageIndex = 0x07,
  kChunkIndex = 0x08,
  kStatistics = 0x0b,
  kSummaryOffset = 0x0e,
  kDataEnd = 0x0f,
};

/// CRC-32 as of zlib.
std::uint32_t mcap_crc(std::string_view bytes);

}  // namespace camber::detail
