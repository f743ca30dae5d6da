#include "standard_streams.h"

#include <fcntl.h>
#include <poll.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <initializer_list>
#include <new>
#include <stdexcept>
#include <system_error>

#include "camber/core/errors.h"

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

namespace {

/// Whether a stream is a pipe that nobody reads.
bool is_closed_pipe(int stream) {
  pollfd state{stream, POLLOUT, 0};
  return ::poll(&state, 1, 0) == 1 && (state.revents & POLLERR) != 0;
}

}  // namespace

int finish_standard_output(int exit_code) {
  const bool lost = std::ferror(stdout) != 0;  // an earlier write
  errno = 0;
  // Network file systems report a full disk when a file is closed.
  const bool failed = std::fflush(stdout) != 0 || ::close(::dup(STDOUT_FILENO)) != 0;
  const int reason = errno;
  if (exit_code != 0 || (!lost && !failed)) return exit_code;
  // Whoever reads has seen enough: `camber --help | head`. An earlier write left no reason.
  if (reason == EPIPE || (lost && is_closed_pipe(STDOUT_FILENO))) return exit_code;
  std::fprintf(stderr, "camber: standard output cannot be written%s%s\n", reason ? ": " : "",
               reason ? std::strerror(reason) : "");
  return 3;
}

bool is_out_of_memory(const std::exception& error) {
  if (dynamic_cast<const std::bad_alloc*>(&error)) return true;
  if (dynamic_cast<const Error*>(&error)) return false;
  // Too long for a container: of a size that overflowed.
  if (dynamic_cast<const std::length_error*>(&error)) return true;
  const auto* const system = dynamic_cast<const std::system_error*>(&error);
  if (system && (system->code() == std::errc::resource_unavailable_try_again ||
                 system->code() == std::errc::not_enough_memory)) {
    return true;
  }
  // As OpenCV, TBB and VTK put it.
  for (const char* part :
       {"Insufficient memory", "Failed to allocate", "pthread_create", "Unable to allocate",
        "bad_alloc", "Cannot allocate memory", "out of memory"}) {
    if (std::strstr(error.what(), part)) return true;
  }
  return false;
}

namespace {

bool is_control(char c) { return (c >= 0 && c < 0x20) || c == 0x7f; }

/// A name that the system does not take. @return the exit code.
int report_name(const std::filesystem::filesystem_error& error) {
  constexpr int kShown = 200;  // bytes of a name that may be megabytes long
  const char* name = error.path1().c_str();
  std::fputs("camber: ", stderr);
  for (int i = 0; name[i] && i < kShown; ++i)
    std::fputc(is_control(name[i]) ? '?' : name[i], stderr);
  const int reason = error.code().value();
  std::fprintf(stderr, "%s: %s\n", std::strlen(name) > kShown ? "..." : "", std::strerror(reason));
  return reason == ENAMETOOLONG || reason == ELOOP || reason == ENOTDIR ? 2 : 3;
}

}  // namespace

std::string one_line(std::string text) {
  for (char& c : text) c = is_control(c) ? '?' : c;
  return text;
}

int report_failure(const std::exception& error) {
  if (is_out_of_memory(error)) {
    std::fputs("camber: out of memory\n", stderr);
    return 3;
  }
  const auto* const name = dynamic_cast<const std::filesystem::filesystem_error*>(&error);
  if (name) return report_name(*name);
  const auto* const ours = dynamic_cast<const Error*>(&error);
  std::fputs("camber: ", stderr);
  // OpenCV's messages have several lines.
  const char* text = error.what();
  std::size_t length = std::strlen(text);
  while (length > 0 && text[length - 1] == '\n') --length;
  for (std::size_t i = 0; i < length; ++i) {
    std::fputc(!is_control(text[i]) ? text[i] : ours ? '?' : ' ', stderr);
  }
  std::fputc('\n', stderr);
  if (ours) return ours->exit_code();
  return dynamic_cast<const std::invalid_argument*>(&error) ? 2 : 3;
}

}  // namespace camber::tools
