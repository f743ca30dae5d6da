#include "signals.h"

#include <pthread.h>
#include <semaphore.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <climits>
#include <csignal>
#include <ctime>
#include <initializer_list>

#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "camber/core/interruption.h"

namespace camber::tools {
namespace {

constexpr long kPatience = 700'000'000;  // ns for the command to stop by itself; a user expects 1 s

sem_t g_signals;
std::atomic<int> g_count{0};
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

void* end_when_told(void*) {
  while (::sem_wait(&g_signals) != 0) {
  }
  timespec until{};
  ::clock_gettime(CLOCK_MONOTONIC, &until);
  until.tv_nsec += kPatience;
  until.tv_sec += until.tv_nsec / 1'000'000'000;
  until.tv_nsec %= 1'000'000'000;
  while (::sem_clockwait(&g_signals, CLOCK_MONOTONIC, &until) != 0 && errno == EINTR) {
  }
  if (g_ending.exchange(true)) wait_for_good();
  discard_staged_outputs();
  constexpr char kSentence[] = "camber: interrupted\n";
  [[maybe_unused]] const ssize_t written = ::write(STDERR_FILENO, kSentence, sizeof kSentence - 1);
  ::_exit(InterruptedError().exit_code());
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
  ::pthread_create(&thread, &attributes, end_when_told, nullptr);
  ::pthread_attr_destroy(&attributes);
  std::signal(SIGINT, on_signal);
  for (const int signal : {SIGTERM, SIGHUP}) {
    // nohup has them ignored, and so they stay.
    if (std::signal(signal, on_signal) == SIG_IGN) std::signal(signal, SIG_IGN);
  }
}

bool ends_interrupted() {
  if (g_ending.exchange(true)) wait_for_good();
  return interruption_requested();
}

}  // namespace camber::tools
