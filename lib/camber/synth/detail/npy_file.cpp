#include "camber/synth/detail/npy_file.h"

#include <fmt/format.h>

#include <cerrno>
#include <cstring>
#include <stdexcept>

#include "camber/core/errors.h"

namespace camber {

static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "the values are written as they are");

NpyFile::NpyFile(const std::filesystem::path& path, const std::string& name,
                 const std::string& type, const std::vector<std::int64_t>& shape)
    : name_(name), out_(path, std::ios::binary) {
  std::string sizes;
  left_ = type.back() - '0';
  for (const std::int64_t n : shape) {
    sizes += fmt::format("{}{}", sizes.empty() ? "" : ", ", n);
    left_ *= n;
  }
  if (shape.size() == 1) sizes += ",";
  std::string header =
      fmt::format("{{'descr': '{}', 'fortran_order': False, 'shape': ({}), }}", type, sizes);
  // Magic, length and header are a multiple of 64 bytes; the header ends with a new line.
  constexpr std::size_t kBefore = 10;
  header.append((64 - (kBefore + header.size() + 1) % 64) % 64, ' ');
  header += '\n';
  const auto length = static_cast<std::uint16_t>(header.size());
  out_.write("\x93NUMPY\x01\x00", 8);
  out_.write(reinterpret_cast<const char*>(&length), 2);
  out_ << header;
  if (!out_) throw OutputError(name_, std::strerror(errno));
}

void NpyFile::write(const void* values, std::size_t bytes) {
  if (static_cast<std::int64_t>(bytes) > left_) {
    throw std::invalid_argument("NpyFile: more values than the shape has");
  }
  left_ -= static_cast<std::int64_t>(bytes);
  out_.write(static_cast<const char*>(values), static_cast<std::streamsize>(bytes));
  if (!out_) throw OutputError(name_, std::strerror(errno));
}

void NpyFile::close() {
  if (left_ != 0) throw OutputError(name_, "the array is not complete");
  out_.close();
  if (!out_) throw OutputError(name_, std::strerror(errno));
}

}  // namespace camber
