#include "camber/core/threads.h"

#include <algorithm>
#include <atomic>
#include <cstdlib>
#include <thread>

#include "camber/core/default_threads.h"
#include "camber/core/detail/side_by_side.h"
#include "camber/core/interruption.h"

namespace camber {
namespace {
std::atomic<int> default_num_threads{0};
}

void set_default_num_threads(int count) noexcept { default_num_threads = count; }

int resolve_num_threads(int requested) {
  const unsigned count = std::thread::hardware_concurrency();
  const int machine = count > 0 ? static_cast<int>(count) : 1;
  const int most = std::max(64, 4 * machine);
  if (requested <= 0) requested = default_num_threads;
  if (requested > 0) return std::min(requested, most);
  if (const char* text = std::getenv("OMP_NUM_THREADS")) {
    const int value = std::atoi(text);
    if (value > 0) return std::min(value, most);
  }
  return machine;
}

void parallel_for(std::size_t count, int num_threads,
                  const std::function<void(std::size_t)>& body) {
  const int threads = resolve_num_threads(num_threads);
  if (threads == 1 || count < 2) {
    for (std::size_t i = 0; i < count; ++i) {
      throw_if_interrupted();
      body(i);
    }
    return;
  }
  detail::run_side_by_side(count, threads, [&](std::size_t i) {
    throw_if_interrupted();
    body(i);
  });
}

}  // namespace camber
