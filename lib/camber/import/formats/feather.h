#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

namespace camber {

/// A column of a table. Of its values there are as many as the table has rows, in the list of its
/// kind; those that are missing are 0, NaN and "".
struct FeatherColumn {
  enum class Kind {
    kInteger,   ///< signed or not, also truth values, dates, times and durations in their unit
    kUnsigned,  ///< of 64 bits
    kNumber,    ///< floating point
    kText,      ///< UTF-8, also by a dictionary
    kOther,     ///< nested, binary, decimal, null: not read
  };
  std::string name;
  std::string type;  ///< "int64", "double", "utf8", "dictionary of utf8", "list", ...
  Kind kind = Kind::kOther;
  std::vector<std::int64_t> integers;
  std::vector<std::uint64_t> unsigneds;
  std::vector<double> numbers;
  std::vector<std::string> texts;
  std::vector<std::uint8_t> missing;  ///< one a row; empty: none is

  /// A value as text that reads back to it; "" where it is missing or kOther.
  std::string text(std::size_t row) const;
};

struct FeatherTable {
  std::size_t rows = 0;
  std::vector<FeatherColumn> columns;
};

/// Whether a file's first bytes are those of one that read_feather() reads, or of its first
/// version, which that names.
bool is_feather(std::string_view bytes);
bool is_feather(const std::filesystem::path& path);  ///< false also where it cannot be opened

/// A file of Apache Arrow's (Feather, version 2): record batches plain or compressed by lz4 or
/// zstd. Every place that the file states is checked against its size, and memory follows what the
/// data gives, at most 1 GiB. Apache Arrow, "Arrow Columnar Format", 1.x (IPC file format) and its
/// File.fbs, Message.fbs, Schema.fbs.
/// @throws InputError "file: byte N: found, expected".
FeatherTable read_feather(const std::filesystem::path& path);
/// The same of bytes in memory. @param name  for messages
FeatherTable read_feather(std::string bytes, const std::string& name);

}  // namespace camber
