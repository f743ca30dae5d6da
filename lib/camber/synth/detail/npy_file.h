#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

namespace camber {

/// Writes one array in NumPy's format 1.0, piece by piece: a magic string, the header's length, a
/// header that gives type, order and shape, then the values, rows first, lowest byte first (NumPy
/// Enhancement Proposal 1, "A Simple File Format for NumPy Arrays").
class NpyFile {
 public:
  /// @param name   of the file in messages: its path may be a temporary one
  /// @param type   NumPy's name of the values' type: "|u1", "<f4", "<i4"
  /// @throws OutputError (name, reason)
  NpyFile(const std::filesystem::path& path, const std::string& name, const std::string& type,
          const std::vector<std::int64_t>& shape);
  void write(const void* values, std::size_t bytes);
  /// @throws OutputError also if the array is not complete.
  void close();

 private:
  std::string name_;
  std::ofstream out_;
  std::int64_t left_ = 0;  ///< bytes that are missing
};

}  // namespace camber
