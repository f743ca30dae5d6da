#pragma once

#include <cstddef>
#include <functional>

namespace camber::detail {

/// Calls body(i) for every i in [0, count) on at most `threads` threads (> 1), the caller's among
/// them; may be nested. Once a body has thrown no further index is begun, and the first exception
/// is rethrown. The build chooses one of two: side_by_side_tbb.cpp, or side_by_side_std.cpp for the
/// thread sanitizer, which takes TBB's own synchronisation for races.
void run_side_by_side(std::size_t count, int threads, const std::function<void(std::size_t)>& body);

}  // namespace camber::detail
