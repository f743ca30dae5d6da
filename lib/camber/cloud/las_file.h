#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "camber/cloud/coordinate_system.h"
#include "camber/cloud/file_reader.h"

namespace camber {
namespace laz {
struct LazLayout;
}

/// A variable-length record of a LAS file, before the points or (extended) behind them.
struct LasRecord {
  std::string user_id;
  int record_id = 0;
  std::string description;
  bool extended = false;
  std::uint64_t start = 0;    ///< of its header in the file, bytes
  std::uint64_t content = 0;  ///< of its content
  std::uint64_t length = 0;   ///< of its content
};

/// One description of extra bytes (user LASF_Spec, record 4).
struct LasExtraBytes {
  std::string name, description;
  int type = 0;  ///< 1 to 30; 0: `options` bytes of which nothing is known
  int options = 0;
  std::size_t elements = 0;   ///< 1 to 3; of type 0 none
  std::size_t size = 0;       ///< bytes a point
  std::uint64_t content = 0;  ///< where the description starts in the file
  std::array<double, 3> scale{1.0, 1.0, 1.0}, offset{0.0, 0.0, 0.0};

  bool scaled() const { return (options & 0x18) != 0; }
};

/// What a LAS file holds beside its points: the ASPRS specifications 1.0 to 1.5.
struct LasFile {
  int minor = 2;  ///< version 1.minor
  std::uint16_t file_source_id = 0, global_encoding = 0;
  std::string system_identifier, generating_software;
  int creation_day = 0, creation_year = 0;
  std::size_t header_size = 0, record_length = 0;
  int point_format = 0;
  std::uint64_t legacy_count = 0, declared_count = 0;
  std::vector<std::uint64_t> points_by_return;  ///< 5, from version 1.4 on 15
  std::array<double, 3> scale{1, 1, 1}, offset{0, 0, 0}, minimum{0, 0, 0}, maximum{0, 0, 0};
  std::vector<LasRecord> records;             ///< those before the points first
  std::vector<LasExtraBytes> extra_bytes;     ///< of all records that describe some, in their order
  std::uint64_t records_end = 0;              ///< where the last record before the points ends
  std::uint64_t points_start = 0;             ///< bytes
  std::uint64_t points = 0;                   ///< those that the file has room for
  std::uint64_t points_end = 0;               ///< of LAZ: with the table of its chunks
  std::uint64_t tail_end = 0;                 ///< of what stands behind the points
  std::shared_ptr<const laz::LazLayout> laz;  ///< how the points are compressed; none: they are not
  CoordinateSystem crs;
  std::shared_ptr<const FileBytes> bytes;

  std::size_t standard_length() const;  ///< of the point format, bytes
  std::size_t extra_length() const { return record_length - standard_length(); }
  std::size_t described_length() const;  ///< of the extra bytes, by their descriptions
  /// What in the header contradicts the file, one sentence each.
  std::vector<std::string> contradictions() const;
};

/// Reads header and records, each size checked against the file's before memory is taken.
/// @param lenient what can be read is kept; what is not sound goes to `notes`
/// @throws InputError "file: byte N: found ..., expected ...".
LasFile read_las_file(std::shared_ptr<const FileBytes> bytes, bool lenient,
                      std::vector<std::string>* notes);

}  // namespace camber
