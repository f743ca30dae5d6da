#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "camber/cloud/las_file.h"

/// How the points of a LAZ file lie in it: M. Isenburg, "LASzip: lossless compression of LiDAR
/// data", 2013, and docs/notes/laz.md.
namespace camber::laz {

inline constexpr const char* kRecordUser = "laszip encoded";
inline constexpr int kRecordId = 22204;
inline constexpr std::uint32_t kVariableChunks = UINT32_MAX;
inline constexpr std::uint32_t kUsualChunkSize = 50000;  ///< points

/// One part of a point record, in the order of the record.
struct LazItem {
  enum Type : std::uint16_t {
    kBytes = 0,
    kPoint10 = 6,
    kTime = 7,
    kColor = 8,
    kWavePacket = 9,
    kPoint14 = 10,
    kColor14 = 11,
    kColorInfrared14 = 12,
    kWavePacket14 = 13,
    kBytes14 = 14,
  };
  std::uint16_t type = 0;
  std::uint16_t size = 0;     ///< bytes
  std::uint16_t version = 0;  ///< 1 and 2 of the types up to 9, 3 and 4 of the others

  std::size_t layers() const;  ///< of types from 10 on
};

/// Points that are coded apart from all others.
struct LazChunk {
  std::uint64_t start = 0;  ///< in the file, bytes
  std::uint64_t size = 0;   ///< bytes
  std::uint64_t points = 0;
};

enum class Compressor : std::uint16_t { kOneStream = 1, kChunks = 2, kLayers = 3 };

struct LazLayout {
  Compressor compressor = Compressor::kChunks;
  std::string version;           ///< of the writer's LASzip, "3.4"
  std::uint32_t chunk_size = 0;  ///< points; kVariableChunks
  std::vector<LazItem> items;
  std::uint64_t data_start = 0;  ///< of the first chunk
  std::uint64_t data_end = 0;    ///< where the points end at the latest
  std::vector<LazChunk> chunks;
  /// Where chunks end is not known beforehand: they are decoded one after the other.
  bool sequential = false;

  std::size_t layers() const;  ///< of a chunk
};

/// The items of a point format. @param extra_bytes of a point
std::vector<LazItem> items_of(int point_format, std::size_t extra_bytes);

/// Reads how a file's points are compressed; sets its `laz`, `points` and `points_end`.
/// @param record  LASzip's record
/// @param lenient what is whole is kept; notes name what is not
/// @throws InputError "file: byte N: found ..., expected ...".
void read_layout(LasFile* las, const LasRecord& record, bool lenient,
                 std::vector<std::string>* notes);

/// The content of LASzip's record.
std::string layout_record(const LazLayout& layout);

/// The table of chunks, as it stands behind them.
std::string chunk_table(const LazLayout& layout);

}  // namespace camber::laz
