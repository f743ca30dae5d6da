// Any bytes as the index.json of a plan of tiles: a plan that can be used, or refused with an
// InputError.

#include <cstdlib>

#include "camber/tiles/tile_plan.h"
#include "memory_file.h"
#include "read_or_refuse.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const MemoryFile file(data, size);
  read_or_refuse([&] {
    const camber::TilePlan plan = camber::read_tile_index(file.path());
    if (plan.ground && !(plan.ground->reach() > 0.0)) std::abort();
    if (plan.tiles.empty() || plan.path_of(0).empty()) std::abort();
  });
  return 0;
}
