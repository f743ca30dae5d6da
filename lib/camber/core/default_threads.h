#pragma once

namespace camber {

/// Threads that resolve_num_threads() answers with where none are requested, in the whole process;
/// <= 0: as if it was never set.
void set_default_num_threads(int count) noexcept;

}  // namespace camber
