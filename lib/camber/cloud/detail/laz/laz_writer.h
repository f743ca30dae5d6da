#pragma once

#include <cstdint>
#include <ostream>
#include <vector>

#include "camber/cloud/detail/laz/laz_format.h"

namespace camber::laz {

/// Writes the points of a LAZ file: chunks, coded by several threads, and their table. The bytes
/// are the same for any number of threads.
class LazWriter {
 public:
  /// @param out         seekable; stands where the points begin
  /// @param file_start  where in it the file does
  LazWriter(std::ostream& out, std::ostream::pos_type file_start, int point_format,
            std::size_t record_length);

  /// How the points are compressed, for LASzip's record.
  const LazLayout& layout() const { return layout_; }

  void write(const char* records, std::size_t count);
  /// The rest of the points, and the table; then `out` stands behind it.
  void finish();

 private:
  void write_chunks(std::size_t count);
  std::size_t points_ready() const { return records_.size() / record_length_; }

  std::ostream& out_;
  LazLayout layout_;
  std::size_t record_length_;
  std::ostream::pos_type file_start_, start_;
  std::size_t most_chunks_;  // that are coded at once
  std::vector<unsigned char> records_;
};

/// LASzip's record for points that LazWriter writes, with its header.
std::string writer_record(int point_format, std::size_t record_length);

}  // namespace camber::laz
