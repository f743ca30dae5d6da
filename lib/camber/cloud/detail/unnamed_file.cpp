#include "camber/cloud/detail/unnamed_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>

#include "camber/core/errors.h"

namespace fs = std::filesystem;

namespace camber::detail {

fs::path UnnamedFile::folder_of(const fs::path& beside) {
  std::error_code error;
  if (beside.empty()) return fs::temp_directory_path(error);
  fs::path target = beside;
  if (fs::is_symlink(beside, error)) {
    target = fs::weakly_canonical(beside, error);
    if (error) target = beside;
  }
  return target.has_parent_path() ? target.parent_path() : fs::path(".");
}

UnnamedFile::UnnamedFile(const fs::path& beside, std::ofstream* stream)
    : name_(beside.empty() ? "a temporary file" : beside.string()) {
  std::string path = (folder_of(beside) / ".camber-XXXXXX").string();
  descriptor_ = ::mkostemp(path.data(), O_CLOEXEC);
  if (descriptor_ < 0) fail("cannot be written");
  if (stream != nullptr) {
    errno = 0;
    stream->open(path, std::ios::binary);
  }
  const int reason = errno;
  ::unlink(path.c_str());
  if (stream != nullptr && !*stream) {
    ::close(descriptor_);
    errno = reason;
    fail("cannot be written");
  }
}

UnnamedFile::~UnnamedFile() {
  if (descriptor_ >= 0) ::close(descriptor_);
}

int UnnamedFile::release() noexcept {
  const int descriptor = descriptor_;
  descriptor_ = -1;
  return descriptor;
}

void UnnamedFile::fail(const char* what) const {
  throw OutputError(
      name_, std::string(what) + (errno == 0 ? "" : std::string(": ") + std::strerror(errno)));
}

void UnnamedFile::write(std::uint64_t at, const char* bytes, std::size_t size) const {
  while (size > 0) {
    const ssize_t done = ::pwrite(descriptor_, bytes, size, static_cast<off_t>(at));
    if (done < 0 && errno == EINTR) continue;
    if (done < 0) fail("writing failed");
    bytes += done;
    at += static_cast<std::uint64_t>(done);
    size -= static_cast<std::size_t>(done);
  }
}

void UnnamedFile::read(std::uint64_t at, char* bytes, std::size_t size) const {
  while (size > 0) {
    errno = 0;
    const ssize_t done = ::pread(descriptor_, bytes, size, static_cast<off_t>(at));
    if (done < 0 && errno == EINTR) continue;
    if (done <= 0) fail("reading what was written failed");
    bytes += done;
    at += static_cast<std::uint64_t>(done);
    size -= static_cast<std::size_t>(done);
  }
}

std::uint64_t UnnamedFile::size() const {
  struct stat status {};
  if (::fstat(descriptor_, &status) != 0) fail("reading what was written failed");
  return static_cast<std::uint64_t>(status.st_size);
}

}  // namespace camber::detail
