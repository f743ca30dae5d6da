#pragma once

#include <cstddef>
#include <functional>

namespace camber {

/// Threads to use for a requested number: itself if positive, else OMP_NUM_THREADS if set to a
/// positive number, else all of the machine's. At most four for each of the machine's, or 64: a
/// hundred thousand have no memory for their stacks, and results do not depend on the number.
int resolve_num_threads(int requested);

/// Calls body(i) for every i in [0, count), on at most `num_threads` threads (<= 0: see
/// resolve_num_threads). Order is not defined: each call must write only to places of its own, and
/// sums must be made afterwards in index order, so that results do not depend on the threads.
/// Of what bodies throw the lowest index's is rethrown, and no higher index is begun. @throws
/// InterruptedError between two calls once request_interruption() was called.
void parallel_for(std::size_t count, int num_threads, const std::function<void(std::size_t)>& body);

}  // namespace camber
