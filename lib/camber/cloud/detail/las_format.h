#pragma once

#include <cstring>

#include "camber/cloud/point_stream.h"

/// What the reader and the writer of LAS files share: the tables of the ASPRS specifications.
namespace camber::detail {

inline constexpr std::size_t kLasRecordHeader = 54;  ///< bytes of a variable-length record's header
inline constexpr std::size_t kLasExtraDescription =
    192;                                        ///< bytes of one description of extra bytes
inline constexpr double kLasAngleUnit = 0.006;  ///< degrees, scan angles of formats 6 to 10

/// A number at any alignment, in the file's byte order, which is little-endian.
template <typename T>
T load(const unsigned char* data) {
  T value;
  std::memcpy(&value, data, sizeof value);
  return value;
}

/// Standard part of a point record. Offsets in bytes, -1: not there.
struct LasPointFormat {
  std::size_t size = 0;
  bool extended = false;  ///< formats 6 to 10
  int time = -1, color = -1, infrared = -1, wave = -1;
};

/// @param id  0 to 10
LasPointFormat las_point_format(int id);

/// Type of a value of extra bytes, or of each of its two or three.
/// @param id  1 to 30, as in the description of extra bytes
ScalarType las_extra_type(int id);

}  // namespace camber::detail
