#include "cloud/memory_meter.h"

#include <malloc.h>

#include <algorithm>
#include <atomic>
#include <cstdlib>
#include <new>

namespace {
std::atomic<std::size_t> g_held{0};
std::atomic<std::size_t> g_peak{0};

void* take(std::size_t size) {
  void* const block = std::malloc(size > 0 ? size : 1);
  if (block == nullptr) throw std::bad_alloc();
  const std::size_t held =
      g_held.fetch_add(::malloc_usable_size(block)) + ::malloc_usable_size(block);
  std::size_t peak = g_peak.load();
  while (peak < held && !g_peak.compare_exchange_weak(peak, held)) {
  }
  return block;
}

void give_back(void* block) {
  if (block == nullptr) return;
  g_held.fetch_sub(::malloc_usable_size(block));
  std::free(block);
}
}  // namespace

void* operator new(std::size_t size) { return take(size); }
void* operator new[](std::size_t size) { return take(size); }
void operator delete(void* block) noexcept { give_back(block); }
void operator delete[](void* block) noexcept { give_back(block); }
void operator delete(void* block, std::size_t) noexcept { give_back(block); }
void operator delete[](void* block, std::size_t) noexcept { give_back(block); }

namespace camber::test {

MemoryMeter::MemoryMeter() : start_(g_held.load()) { g_peak = start_; }

std::size_t MemoryMeter::peak() const { return g_peak.load() - start_; }

}  // namespace camber::test
