#include "standard_streams.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <initializer_list>

namespace camber::tools {

void open_standard_streams() {
  for (const int stream : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO}) {
    if (::fcntl(stream, F_GETFD) != -1 || errno != EBADF) continue;
    // The lowest free number is taken. Opened for reading, so that writing fails.
    if (::open("/dev/null", O_RDONLY) < 0) return;
  }
  std::signal(SIGPIPE, SIG_IGN);
  std::signal(SIGXFSZ, SIG_IGN);
}

int finish_standard_output(int exit_code) {
  const bool lost = std::ferror(stdout) != 0;  // an earlier write
  errno = 0;
  // Network file systems report a full disk when a file is closed.
  const bool failed = std::fflush(stdout) != 0 || ::close(::dup(STDOUT_FILENO)) != 0;
  const int reason = errno;
  if (exit_code != 0 || (!lost && !failed)) return exit_code;
  std::fprintf(stderr, "camber: standard output cannot be written%s%s\n", reason ? ": " : "",
               reason ? std::strerror(reason) : "");
  return 3;
}

}  // namespace camber::tools
