#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace camber {

/// Sorts items by their `code`, of which no bits above the lowest `bits` are set; equal codes stay
/// in their order. Digits that all items share cost one pass over them.
template <class Item>
void radix_sort(std::vector<Item>* items, int bits = 64) {
  constexpr int kBits = 11;
  constexpr std::size_t kBuckets = std::size_t{1} << kBits;
  std::vector<Item> sorted(items->size());
  for (int shift = 0; shift < bits; shift += kBits) {
    std::array<std::size_t, kBuckets> starts{};
    for (const Item& item : *items) ++starts[item.code >> shift & (kBuckets - 1)];
    std::size_t sum = 0, most = 0;
    for (std::size_t& count : starts) {
      const std::size_t here = count;
      most = here > most ? here : most;
      count = sum;
      sum += here;
    }
    if (most == items->size()) continue;
    for (const Item& item : *items) sorted[starts[item.code >> shift & (kBuckets - 1)]++] = item;
    items->swap(sorted);
  }
}

}  // namespace camber
