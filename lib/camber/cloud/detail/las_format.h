#pragma once

#include <cstring>

#include "camber/cloud/point_stream.h"

/// What the reader and the writer of LAS files share: the tables of the ASPRS specifications.
namespace camber::detail {

inline constexpr std::size_t kLasRecordHeader = 54;  ///< bytes of a variable-length record's header
inline constexpr std::size_t kLasExtendedHeader = 60;  ///< of one behind the points
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

/// Puts bytes, or a number, at a place of a string that has room there.
inline void store(std::string& out, std::size_t at, const void* data, std::size_t size) {
  std::memcpy(out.data() + at, data, size);
}
template <typename T>
void store(std::string& out, std::size_t at, T value) {
  store(out, at, &value, sizeof value);
}

/// Standard part of a point record. Offsets in bytes, -1: not there.
struct LasPointFormat {
  std::size_t size = 0;
  bool extended = false;  ///< formats 6 to 10
  int time = -1, color = -1, infrared = -1, wave = -1;
};

/// @param id  0 to 10
LasPointFormat las_point_format(int id);

inline constexpr int kLasOverlapClass = 12;  ///< of formats 0 to 5; the others have a flag

/// The one of formats 6 to 8 that holds what points of a format have, but for wave packets.
int las_extended_format(int id);

/// The class of a point.
int las_class_of(const unsigned char* record, const LasPointFormat& format);

/// The standard part of a record in one of formats 6 to 8. Of formats 0 to 5 (LAS 1.4) return
/// numbers, flags and the class get wider fields, whole degrees of scan angles become multiples of
/// 0.006, class 12 the overlap flag and class 1; times that there are none of are 0.
void extend_las_record(const unsigned char* from, const LasPointFormat& from_format,
                       unsigned char* to, const LasPointFormat& to_format);

/// Type of a value of extra bytes, or of each of its two or three.
/// @param id  1 to 30, as in the description of extra bytes
ScalarType las_extra_type(int id);

/// A variable-length record with its header. @param content at most 65535 bytes.
std::string las_record(const char* user, std::uint16_t id, const char* description,
                       const std::string& content);

/// One description of extra bytes: one value of a type a point.
std::string describe_extra_bytes(const std::string& name, ScalarType type);

/// Whether a record states the coordinate system.
bool is_projection_record(const std::string& user_id, int record_id);

/// Whether points of a format take this system as well-known text: formats 6 to 10 must, others do
/// where it has no code.
bool takes_wkt(const CoordinateSystem& crs, int point_format);

/// The records that state a coordinate system; adds their number to `count`. None for a system
/// that is neither text nor a code.
std::string projection_records(const CoordinateSystem& crs, int point_format, std::uint32_t* count);

}  // namespace camber::detail
