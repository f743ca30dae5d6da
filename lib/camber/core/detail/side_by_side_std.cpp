#include <algorithm>
#include <atomic>
#include <exception>
#include <mutex>
#include <system_error>
#include <thread>
#include <vector>

#include "camber/core/detail/side_by_side.h"

namespace camber::detail {

void run_side_by_side(std::size_t count, int threads,
                      const std::function<void(std::size_t)>& body) {
  // Relaxed, so that indices order nothing between threads: the sanitizer sees what only start and
  // end of the loop order.
  std::atomic<std::size_t> next{0};
  std::atomic<bool> failed{false};
  std::mutex mutex;
  std::exception_ptr first;
  const auto work = [&] {
    while (!failed.load(std::memory_order_relaxed)) {
      const std::size_t i = next.fetch_add(1, std::memory_order_relaxed);
      if (i >= count) return;
      try {
        body(i);
      } catch (...) {
        const std::lock_guard<std::mutex> lock(mutex);
        if (!first) first = std::current_exception();
        failed.store(true, std::memory_order_relaxed);
      }
    }
  };
  std::vector<std::thread> others;
  const std::size_t most = std::min(count, static_cast<std::size_t>(threads));
  others.reserve(most - 1);
  for (std::size_t k = 1; k < most; ++k) {
    try {
      others.emplace_back(work);
    } catch (const std::system_error&) {
      break;  // the machine has no more: those that there are do the work
    }
  }
  work();
  for (std::thread& thread : others) thread.join();
  if (first) std::rethrow_exception(first);
}

}  // namespace camber::detail
