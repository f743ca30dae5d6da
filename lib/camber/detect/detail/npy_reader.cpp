#include "camber/detect/detail/npy_reader.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cstring>
#include <fstream>
#include <limits>
#include <optional>

#include "camber/core/errors.h"
#include "camber/core/read_file.h"

namespace camber::internal {
namespace {

/// What stands after a key of the header, a Python dictionary.
std::string_view after_key(std::string_view header, const std::string& key) {
  const auto at = header.find("'" + key + "':");
  if (at == std::string_view::npos) return {};
  header.remove_prefix(at + key.size() + 3);
  header.remove_prefix(std::min(header.find_first_not_of(' '), header.size()));
  return header;
}

/// "(3, 64, 64)"; nothing for another form.
std::optional<std::vector<std::size_t>> shape_of(std::string_view text) {
  const auto end = text.find(')');
  if (text.empty() || text.front() != '(' || end == std::string_view::npos) return std::nullopt;
  std::vector<std::size_t> out;
  std::size_t value = 0;
  bool digits = false;
  for (const char c : text.substr(1, end)) {  // with the bracket, which ends the last number
    if (c >= '0' && c <= '9') {
      if (value > std::numeric_limits<std::uint32_t>::max()) return std::nullopt;
      value = 10 * value + static_cast<std::size_t>(c - '0');
      digits = true;
    } else if (c == ',' || c == ')') {
      if (digits) out.push_back(value);
      value = 0;
      digits = false;
    } else if (c != ' ') {
      return std::nullopt;
    }
  }
  return out;
}

template <typename Value>
NpyArray<Value> read(const std::filesystem::path& path, const std::string& type,
                     const std::vector<std::size_t>& columns, std::size_t rows) {
  const auto fail = [&](const std::string& reason) { throw InputError(path.string(), reason); };
  std::ifstream file(path, std::ios::binary);
  if (!file) fail("cannot be read");
  char start[10] = {};
  file.read(start, sizeof start);
  if (!file || std::memcmp(start, "\x93NUMPY\x01", 7) != 0) {
    fail("found no array of NumPy (.npy, version 1)");
  }
  const std::size_t length =
      static_cast<unsigned char>(start[8]) + 256U * static_cast<unsigned char>(start[9]);
  std::string header(length, ' ');
  file.read(header.data(), static_cast<std::streamsize>(length));
  if (!file) fail("the header is cut off");
  const auto shape = shape_of(after_key(header, "shape"));
  const std::string_view found_type = after_key(header, "descr").substr(0, type.size() + 2);
  const bool row_major = after_key(header, "fortran_order").substr(0, 5) == "False";
  const auto fits = [](std::size_t wanted, std::size_t found) {
    return wanted == kAnySide ? found >= 1 && found <= 1024 : wanted == found;
  };
  if (!shape || found_type != "'" + type + "'" || !row_major ||
      shape->size() != columns.size() + 1 ||
      !std::equal(columns.begin(), columns.end(), shape->begin() + 1, fits)) {
    std::vector<std::string> wanted;
    for (const std::size_t n : columns) wanted.push_back(n == kAnySide ? "any" : std::to_string(n));
    fail(fmt::format("found the header {}, expected type {} and the shape (N, {})",
                     printable(header.substr(0, header.find_last_not_of(" \n") + 1), 120), type,
                     fmt::join(wanted, ", ")));
  }
  std::size_t row = 1;  // values
  for (std::size_t k = 1; k < shape->size(); ++k) row *= (*shape)[k];
  const std::uintmax_t stored =
      (std::filesystem::file_size(path) - sizeof start - length) / (row * sizeof(Value));
  if (shape->front() > stored) {
    fail(fmt::format("holds {} rows, its header states {}", stored, shape->front()));
  }
  NpyArray<Value> out;
  out.shape = *shape;
  out.shape[0] = std::min(rows, out.shape[0]);
  const std::size_t size = out.shape[0] * row;
  out.values.resize(size);
  file.read(reinterpret_cast<char*>(out.values.data()),
            static_cast<std::streamsize>(size * sizeof(Value)));
  if (!file) fail(fmt::format("ends before its {} rows", out.shape[0]));
  return out;
}

}  // namespace

NpyArray<std::uint8_t> read_npy_bytes(const std::filesystem::path& path,
                                      const std::vector<std::size_t>& columns, std::size_t rows) {
  return read<std::uint8_t>(path, "|u1", columns, rows);
}

NpyArray<float> read_npy_floats(const std::filesystem::path& path,
                                const std::vector<std::size_t>& columns, std::size_t rows) {
  return read<float>(path, "<f4", columns, rows);
}

}  // namespace camber::internal
