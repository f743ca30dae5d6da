#include "camber/core/read_file.h"

#include <cerrno>
#include <cstring>
#include <vector>

#include "camber/core/errors.h"

namespace camber {

std::ifstream open_file(const std::filesystem::path& path) {
  std::error_code error;
  if (std::filesystem::is_directory(path, error)) {
    throw InputError(path.string(), "is a folder, expected a file");
  }
  errno = 0;
  std::ifstream in(path, std::ios::binary);
  if (!in) {
    const int reason = errno;
    throw InputError(path.string(), reason == ENOENT || reason == ENOTDIR
                                        ? "no such file"
                                        : std::string("cannot be opened: ") +
                                              (reason ? std::strerror(reason) : "unknown reason"));
  }
  return in;
}

std::string read_whole_file(const std::filesystem::path& path, std::size_t max_bytes) {
  std::ifstream in = open_file(path);
  std::string text;
  std::error_code error;
  const auto size = std::filesystem::file_size(path, error);
  if (!error && size <= max_bytes) text.reserve(static_cast<std::size_t>(size));
  std::vector<char> buffer(1 << 16);
  while (in.read(buffer.data(), static_cast<std::streamsize>(buffer.size())), in.gcount() > 0) {
    if (text.size() + static_cast<std::size_t>(in.gcount()) > max_bytes) {
      throw InputError(path.string(), "is larger than " + std::to_string(max_bytes) +
                                          " bytes, the most that is read");
    }
    text.append(buffer.data(), static_cast<std::size_t>(in.gcount()));
  }
  if (in.bad()) throw InputError(path.string(), "reading failed");
  return text;
}

std::string printable(std::string_view text, std::size_t max_length) {
  std::string out;
  for (const char c : text.substr(0, max_length)) out += (c >= 0x20 && c < 0x7f) ? c : '?';
  if (text.size() > max_length) out += "...";
  return out;
}

}  // namespace camber
