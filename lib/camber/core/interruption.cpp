#include "camber/core/interruption.h"

#include <atomic>

#include "camber/core/errors.h"

namespace camber {
namespace {

std::atomic<bool> g_requested{false};
static_assert(std::atomic<bool>::is_always_lock_free, "a signal handler sets it");

}  // namespace

void request_interruption() noexcept { g_requested.store(true, std::memory_order_relaxed); }

bool interruption_requested() noexcept { return g_requested.load(std::memory_order_relaxed); }

void reset_interruption() noexcept { g_requested.store(false, std::memory_order_relaxed); }

void throw_if_interrupted() {
  if (interruption_requested()) throw InterruptedError();
}

}  // namespace camber
