// Any bytes as an OpenDRIVE file: roads of a length, whose surfaces answer anywhere, or an
// InputError.

#include <cmath>
#include <cstdlib>
#include <string>

#include "camber/core/errors.h"
#include "camber/export/opendrive_reader.h"
#include "memory_file.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const MemoryFile file(data, size);
  try {
    const camber::XodrFile found = camber::read_xodr(file.path());
    if (found.roads.empty()) std::abort();
    for (const camber::XodrRoad& road : found.roads) {
      if (!(road.length > 0.0) || road.plan.empty()) std::abort();
      const camber::XodrSurface surface(road);
      for (const double share : {0.0, 0.5, 1.0}) {
        const double s = share * road.length;
        if (surface.left(s) < 0.0 || surface.right(s) < 0.0) std::abort();
        surface.point(s, surface.left(s));
      }
    }
  } catch (const camber::InputError&) {
    // what a reader of untrusted files answers
  }
  return 0;
}
