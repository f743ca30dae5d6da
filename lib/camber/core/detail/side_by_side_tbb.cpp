#include <oneapi/tbb/global_control.h>
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/task_arena.h>

#include <optional>

#include "camber/core/detail/side_by_side.h"

namespace camber::detail {

void run_side_by_side(std::size_t count, int threads,
                      const std::function<void(std::size_t)>& body) {
  // TBB prints a warning where an arena asks for more threads than the machine has.
  using Control = oneapi::tbb::global_control;
  std::optional<Control> more;
  if (static_cast<std::size_t>(threads) > Control::active_value(Control::max_allowed_parallelism)) {
    more.emplace(Control::max_allowed_parallelism, static_cast<std::size_t>(threads));
  }
  oneapi::tbb::task_arena arena(threads);
  arena.execute([&] { oneapi::tbb::parallel_for(std::size_t{0}, count, body); });
}

}  // namespace camber::detail
