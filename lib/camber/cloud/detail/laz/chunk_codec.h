#pragma once

#include <memory>
#include <string>
#include <vector>

#include "camber/cloud/detail/laz/arithmetic_decoder.h"
#include "camber/cloud/detail/laz/laz_format.h"

namespace camber::laz {

/// Attributes that lie in layers of their own and may be left out.
enum Wanted : std::uint32_t {
  kWantZ = 1u << 1,
  kWantClass = 1u << 2,
  kWantFlags = 1u << 3,
  kWantIntensity = 1u << 4,
  kWantAngle = 1u << 5,
  kWantUser = 1u << 6,
  kWantSource = 1u << 7,
  kWantTime = 1u << 8,
  kWantColor = 1u << 9,
  kWantInfrared = 1u << 10,
  kWantWavePacket = 1u << 11,
  kWantBytes = 1u << 12,
  kWantAll = UINT32_MAX,
};

/// The points of one chunk, from the first on.
class ChunkDecoder {
 public:
  virtual ~ChunkDecoder() = default;
  /// Decodes the next records.
  /// @param out  room for `count` records
  /// @return     how many are whole; fewer where the chunk's bytes end before or are damaged
  virtual std::size_t decode(unsigned char* out, std::size_t count) = 0;
  /// Whether, after its last point, bytes are left over or damage was seen: then points are wrong.
  virtual bool suspicious() const = 0;
};

/// @param begin, end  the chunk's bytes; with a feed those that are there yet
/// @param position    with a feed: gets where in its bytes the decoder is
std::unique_ptr<ChunkDecoder> make_pointwise_decoder(const std::vector<LazItem>& items,
                                                     const unsigned char* begin,
                                                     const unsigned char* end,
                                                     ByteFeed* feed = nullptr,
                                                     const unsigned char** position = nullptr);

/// @param bytes   the whole chunk; must outlive the decoder
/// @param points  of the chunk; its head must have the same number
/// @param wanted  Wanted
/// @return        null where the chunk's head is damaged; `reason` is why
std::unique_ptr<ChunkDecoder> make_layered_decoder(const std::vector<LazItem>& items,
                                                   const std::string& bytes, std::uint64_t points,
                                                   std::uint32_t wanted, std::string* reason);

/// All points of a chunk, coded.
/// @param items    with the versions to write
/// @param records  `count` of them, at least one
std::string encode_chunk(const std::vector<LazItem>& items, const unsigned char* records,
                         std::size_t count);

}  // namespace camber::laz
