#include "signals.h"

#include <execinfo.h>
#include <pthread.h>
#include <semaphore.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cerrno>
#include <climits>
#include <csignal>
#include <cstddef>
#include <ctime>
#include <exception>
#include <initializer_list>
#include <optional>

#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "camber/core/interruption.h"
#include "camber/core/memory.h"
#include "standard_streams.h"

namespace camber::tools {
namespace {

constexpr long kPatience = 700'000'000;  // ns for the command to stop by itself; a user expects 1 s

sem_t g_signals;
std::atomic<int> g_count{0};
std::atomic<bool> g_failed{false};  // as of watch_failures()
std::atomic<bool> g_ending{false};  // who sets it first ends the program

extern "C" void on_signal(int signal) {
  const int kept = errno;
  request_interruption();
  if (g_count.fetch_add(1) < 2) {
    ::sem_post(&g_signals);
  } else {
    std::signal(signal, SIG_DFL);
    std::raise(signal);
  }
  errno = kept;
}

[[noreturn]] void wait_for_good() {
  while (true) ::pause();
}

constexpr char kInterrupted[] = "camber: interrupted\n";
constexpr char kNoMemory[] = "camber: out of memory\n";
constexpr char kNoMemoryLibrary[] =
    "camber: out of memory: a library broke down under the limit of address space (ulimit -v, "
    "-d)\n";
constexpr char kUnexpected[] = "camber: ended by an unexpected error\n";

/// Allocates nothing.
template <std::size_t N>
[[noreturn]] void end_with(const char (&sentence)[N], int exit_code) {
  [[maybe_unused]] const ssize_t written = ::write(STDERR_FILENO, sentence, N - 1);
  ::_exit(exit_code);
}

void* end_when_signalled(void*) {
  while (::sem_wait(&g_signals) != 0) {
  }
  timespec until{};
  ::clock_gettime(CLOCK_MONOTONIC, &until);
  until.tv_nsec += kPatience;
  until.tv_sec += until.tv_nsec / 1'000'000'000;
  until.tv_nsec %= 1'000'000'000;
  while (!g_failed && ::sem_clockwait(&g_signals, CLOCK_MONOTONIC, &until) != 0 && errno == EINTR) {
  }
  if (!g_failed && g_ending.exchange(true)) wait_for_good();
  discard_staged_outputs();
  if (g_failed) end_with(kNoMemoryLibrary, 3);
  end_with(kInterrupted, InterruptedError().exit_code());
}

[[noreturn]] void on_terminate() {
  if (g_ending.exchange(true)) wait_for_good();
  // Thrown, and not caught, in one of the functions that declare that they throw nothing.
  bool no_memory = std::uncaught_exceptions() > 0;
  try {
    if (std::current_exception()) throw;
  } catch (const std::exception& error) {
    no_memory = is_out_of_memory(error);
  } catch (...) {
  }
  discard_staged_outputs();
  if (no_memory) end_with(kNoMemory, 3);
  end_with(kUnexpected, 3);
}

/// A library that used memory that it did not get. The heap may be broken: the waiting thread
/// removes what is half-written, and where it hangs this one ends the program (the next run removes
/// it).
extern "C" void on_breakdown(int signal) {
  constexpr std::size_t kScarce = std::size_t{768} << 20;
  const std::optional<std::size_t> left = free_address_space();
  if (!left || *left > kScarce) {  // a fault of another kind: as without this handler
    std::signal(signal, SIG_DFL);
    std::raise(signal);
    return;
  }
  g_ending = true;
  if (!g_failed.exchange(true)) {
    ::sem_post(&g_signals);
    const timespec patience{0, kPatience};
    ::nanosleep(&patience, nullptr);
    end_with(kNoMemoryLibrary, 3);
  }
  wait_for_good();
}

}  // namespace

void watch_signals() {
  ::sem_init(&g_signals, 0, 0);
  // A small stack: a thread's usual one counts against a limit of address space.
  pthread_attr_t attributes;
  pthread_t thread;
  ::pthread_attr_init(&attributes);
  ::pthread_attr_setstacksize(&attributes, PTHREAD_STACK_MIN + (256 << 10));
  ::pthread_attr_setdetachstate(&attributes, PTHREAD_CREATE_DETACHED);
  // Without the thread the program still stops where the library looks.
  ::pthread_create(&thread, &attributes, end_when_signalled, nullptr);
  ::pthread_attr_destroy(&attributes);
  std::signal(SIGINT, on_signal);
  for (const int signal : {SIGTERM, SIGHUP}) {
    // nohup has them ignored, and so they stay.
    if (std::signal(signal, on_signal) == SIG_IGN) std::signal(signal, SIG_IGN);
  }
}

void watch_failures() {
  std::set_terminate(on_terminate);
  if (!free_address_space()) return;
  // What glibc unwinds threads with is loaded at its first use: later, where memory is short, that
  // fails with a sentence of glibc's own.
  std::array<void*, 1> frame{};
  ::backtrace(frame.data(), 1);
  for (const int signal : {SIGSEGV, SIGBUS, SIGABRT}) std::signal(signal, on_breakdown);
}

bool ends_interrupted() {
  if (g_ending.exchange(true)) wait_for_good();
  return interruption_requested();
}

}  // namespace camber::tools
