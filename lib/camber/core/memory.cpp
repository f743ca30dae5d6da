#include "camber/core/memory.h"

#include <fcntl.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>  // defines __GLIBC__

#include "camber/core/errors.h"

#if defined(__GLIBC__)
#include <malloc.h>
#endif

namespace camber {
namespace {

/// Pages of this process: the first number of /proc/self/statm is all, the sixth those of data.
/// Usable in a signal handler. @return false where there is no such file.
bool count_pages(std::size_t* all, std::size_t* data) noexcept {
  const int file = ::open("/proc/self/statm", O_RDONLY | O_CLOEXEC);
  if (file < 0) return false;
  char text[256];
  const ssize_t length = ::read(file, text, sizeof text);
  ::close(file);
  std::size_t numbers[6] = {}, field = 0;
  for (ssize_t i = 0; i < length && field < 6; ++i) {
    if (text[i] >= '0' && text[i] <= '9') {
      numbers[field] = 10 * numbers[field] + static_cast<std::size_t>(text[i] - '0');
    } else {
      ++field;
    }
  }
  *all = numbers[0];
  *data = numbers[5];
  return field >= 5;
}

std::optional<std::size_t> left_of(int resource, std::size_t used) noexcept {
  rlimit limit{};
  if (::getrlimit(static_cast<__rlimit_resource_t>(resource), &limit) != 0 ||
      limit.rlim_cur == RLIM_INFINITY) {
    return std::nullopt;
  }
  return limit.rlim_cur > used ? static_cast<std::size_t>(limit.rlim_cur) - used : 0;
}

}  // namespace

std::optional<std::size_t> free_address_space() noexcept {
  std::size_t all = 0, data = 0;
  if (!count_pages(&all, &data)) return std::nullopt;
  const auto page = static_cast<std::size_t>(::sysconf(_SC_PAGESIZE));
  const std::optional<std::size_t> space = left_of(RLIMIT_AS, all * page);
  const std::optional<std::size_t> heap = left_of(RLIMIT_DATA, data * page);
  if (space && heap) return std::min(*space, *heap);
  return space ? space : heap;
}

void require_address_space(std::size_t bytes, const std::string& what) {
  const std::optional<std::size_t> left = free_address_space();
  if (!left || *left >= bytes) return;
  constexpr std::size_t kMegabyte = 1'000'000;
  throw MachineError("out of memory: " + what + " needs some " + std::to_string(bytes / kMegabyte) +
                     " MB more, and the limit of address space (ulimit -v, -d) leaves " +
                     std::to_string(*left / kMegabyte) + " MB");
}

void keep_freed_memory() {
#if defined(__GLIBC__)
  constexpr int kMiB = 1 << 20;
  mallopt(M_MMAP_THRESHOLD, 256 * kMiB);
  mallopt(M_TRIM_THRESHOLD, 512 * kMiB);
  mallopt(M_TOP_PAD, 64 * kMiB);
#endif
}

}  // namespace camber
