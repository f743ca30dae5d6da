#pragma once

#include <cstddef>
#include <functional>

namespace camber::detail {

/// Calls body(i) for every i in [0, count) on at most `threads` threads (> 1), the caller's among
/// them; may be nested. Once a body has thrown no higher index is begun, and what the lowest index
/// has thrown is rethrown: the same for any number of threads. The caller waits for no other thread
/// to begin: where none is free it does all.
void run_side_by_side(std::size_t count, int threads, const std::function<void(std::size_t)>& body);

}  // namespace camber::detail
