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

FileBytes::FileBytes(int descriptor, std::uint64_t size, std::string name)
    : descriptor_(descriptor), size_(size), name_(std::move(name)) {}

FileBytes::FileBytes(const void* data, std::size_t size, std::string name)
    : data_(static_cast<const unsigned char*>(data)), size_(size), name_(std::move(name)) {}

FileBytes::~FileBytes() {
  if (descriptor_ >= 0) ::close(descriptor_);
}

std::string FileBytes::read(std::uint64_t start, std::uint64_t length) const {
  if (start > size_ || length > size_ - start) {
    fail_at(size_, "found the end of the file, expected " + std::to_string(length) +
                       " bytes from byte " + std::to_string(start));
  }
  if (data_ != nullptr || length == 0) {
    return length == 0 ? std::string()
                       : std::string(reinterpret_cast<const char*>(data_) + start,
                                     static_cast<std::size_t>(length));
  }
  std::string out(static_cast<std::size_t>(length), '\0');
  std::size_t done = 0;
  while (done < out.size()) {
    const ssize_t got = ::pread(descriptor_, out.data() + done, out.size() - done,
                                static_cast<off_t>(start + done));
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) fail_at(start + done, std::string("reading failed: ") + std::strerror(errno));
    if (got == 0) fail_at(start + done, "the file became shorter while it was being read");
    done += static_cast<std::size_t>(got);
  }
  return out;
}

void FileBytes::fail_at(std::uint64_t byte, const std::string& reason) const {
  throw InputError(name_, "byte " + std::to_string(byte), reason);
}

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
      memory_(data),
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

std::shared_ptr<const FileBytes> FileReader::bytes() const {
  if (descriptor_ < 0) {
    return std::make_shared<FileBytes>(memory_, static_cast<std::size_t>(size_), name_);
  }
  const int copy = ::fcntl(descriptor_, F_DUPFD_CLOEXEC, 0);
  if (copy < 0) throw InputError(name_, std::string("cannot be read: ") + std::strerror(errno));
  return std::make_shared<FileBytes>(copy, size_, name_);
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
  ends_ = pending_ == length ? "" : end_ == '\n' ? "LF" : "CR";
  if (end_ == '\n' && !line.empty() && line.back() == '\r') {
    line.remove_suffix(1);
    ends_ = "CR LF";
  }
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
