#include "camber/cloud/file_reader.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

namespace camber {
namespace {
constexpr std::size_t kChunk = std::size_t{1} << 18;  // fits the second-level cache
}  // namespace

FileReader::FileReader(const std::filesystem::path& path) : name_(path.string()) {
  descriptor_ = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  if (descriptor_ < 0) {
    throw InputError(name_, std::string("cannot be opened: ") + std::strerror(errno));
  }
  struct stat status {};
  const bool known = ::fstat(descriptor_, &status) == 0;
  if (!known || !S_ISREG(status.st_mode)) {
    ::close(descriptor_);
    throw InputError(name_, known && S_ISDIR(status.st_mode)
                                ? "found a folder, expected a file"
                                : "not a regular file, so its size cannot be checked");
  }
  size_ = static_cast<std::uint64_t>(status.st_size);
  ::posix_fadvise(descriptor_, 0, 0, POSIX_FADV_SEQUENTIAL);
}

FileReader::FileReader(const void* data, std::size_t size, std::string name)
    : name_(std::move(name)),
      size_(size),
      data_(static_cast<const unsigned char*>(data)),
      available_(size) {}

FileReader::~FileReader() {
  if (descriptor_ >= 0) ::close(descriptor_);
}

bool FileReader::fill(std::size_t bytes) {
  if (available_ >= bytes) return true;
  if (bytes > remaining()) {
    if (available_ < remaining()) read_more(static_cast<std::size_t>(remaining()));
    return false;
  }
  read_more(bytes);
  return true;
}

void FileReader::read_more(std::size_t bytes) {
  const std::size_t rest =
      static_cast<std::size_t>(std::min<std::uint64_t>(remaining(), std::max(bytes, kChunk)));
  if (rest > capacity_) {
    // The window never outgrows the file, so a lying size in a header cannot make it huge.
    std::unique_ptr<unsigned char[]> larger(new unsigned char[rest]);
    if (available_ > 0) std::memcpy(larger.get(), data_, available_);
    buffer_ = std::move(larger);
    capacity_ = rest;
  } else if (available_ > 0) {
    std::memmove(buffer_.get(), data_, available_);
  }
  data_ = buffer_.get();
  while (available_ < rest) {
    const ssize_t got = ::read(descriptor_, buffer_.get() + available_, rest - available_);
    if (got < 0 && errno == EINTR) continue;
    if (got < 0)
      fail_at(position_ + available_, std::string("reading failed: ") + std::strerror(errno));
    if (got == 0) {
      fail_at(position_ + available_, "the file became shorter while it was being read");
    }
    available_ += static_cast<std::size_t>(got);
  }
}

bool FileReader::skip(std::uint64_t bytes) {
  if (bytes > remaining()) return false;
  while (bytes > available_) {
    bytes -= available_;
    consume(available_);
    fill(1);
  }
  consume(static_cast<std::size_t>(bytes));
  return true;
}

void FileReader::fail_at(std::uint64_t byte, const std::string& reason) const {
  throw InputError(name_, "byte " + std::to_string(byte), reason);
}

bool LineReader::next(std::string_view& line, std::size_t limit) {
  release();
  std::size_t searched = 0, length = 0;
  while (true) {
    const char* const start = file_.text();
    const std::size_t fresh = file_.available() - searched;
    const void* const found = fresh > 0 ? std::memchr(start + searched, end_, fresh) : nullptr;
    if (found != nullptr) {
      length = static_cast<std::size_t>(static_cast<const char*>(found) - start);
      pending_ = length + 1;
      break;
    }
    searched = file_.available();
    if (searched > limit) {
      length = searched;
      break;
    }
    if (searched == file_.remaining()) {  // the last line, without an end
      if (searched == 0) return false;
      length = pending_ = searched;
      break;
    }
    // Doubling keeps a long line linear in its length.
    file_.fill(static_cast<std::size_t>(std::min<std::uint64_t>(
        file_.remaining(), std::max<std::uint64_t>(2 * std::uint64_t{searched}, 1))));
  }
  ++line_;
  if (length > limit) {
    fail("found a line of more than " + std::to_string(limit) + " bytes, expected shorter ones");
  }
  line = std::string_view(file_.text(), length);
  if (end_ == '\n' && !line.empty() && line.back() == '\r') line.remove_suffix(1);
  return true;
}

void LineReader::fail(const std::string& reason) const {
  throw InputError(file_.name(), "line " + std::to_string(line_), reason);
}

std::string shown(std::string_view text) {
  constexpr std::size_t kLongest = 60;
  static const char* const kDigits = "0123456789abcdef";
  std::string out = "'";
  for (const char c : text.substr(0, kLongest)) {
    const unsigned char byte = static_cast<unsigned char>(c);
    if (byte >= 0x20 && byte < 0x7f) {
      out += c;
    } else {
      out += "\\x";
      out += kDigits[byte >> 4];
      out += kDigits[byte & 15];
    }
  }
  return out + (text.size() > kLongest ? "...'" : "'");
}

}  // namespace camber
