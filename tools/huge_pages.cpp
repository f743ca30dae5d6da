#include "huge_pages.h"

#include <fcntl.h>
#include <sys/resource.h>
#include <unistd.h>

#include <cstdlib>
#include <cstring>

namespace camber::tools {
namespace {

constexpr char kVariable[] = "GLIBC_TUNABLES";
constexpr char kHugePages[] = "glibc.malloc.hugetlb=1";  // by madvise(); glibc 2.35

/// Whether the kernel gives huge pages to who asks, and to nobody else.
bool are_given_on_request() {
  const int file = ::open("/sys/kernel/mm/transparent_hugepage/enabled", O_RDONLY | O_CLOEXEC);
  if (file < 0) return false;
  char text[64] = {};
  const ssize_t size = ::read(file, text, sizeof text - 1);
  ::close(file);
  return size > 0 && std::strstr(text, "[madvise]") != nullptr;
}

bool is_address_space_limited() {
  rlimit limit = {};
  return ::getrlimit(RLIMIT_AS, &limit) != 0 || limit.rlim_cur != RLIM_INFINITY;
}

}  // namespace

void start_with_huge_pages(char** argv) {
#if defined(__GLIBC__) && !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
  if (const char* const given = std::getenv(kVariable)) {
    if (std::strcmp(given, kHugePages) == 0) ::unsetenv(kVariable);
    return;
  }
  if (is_address_space_limited() || !are_given_on_request()) return;
  char program[4096];
  const ssize_t size = ::readlink("/proc/self/exe", program, sizeof program - 1);
  if (size <= 0) return;
  program[size] = '\0';
  if (::setenv(kVariable, kHugePages, 0) != 0) return;
  ::execv(program, argv);
  ::unsetenv(kVariable);  // it could not be started, and goes on as it is
#else
  static_cast<void>(argv);
#endif
}

}  // namespace camber::tools
