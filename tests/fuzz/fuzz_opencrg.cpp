#include <cmath>

#include "camber/core/errors.h"
#include "camber/export/opencrg.h"
#include "memory_file.h"

/// Any bytes as an OpenCRG file: a road that answers anywhere, or an InputError.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const MemoryFile file(data, size);
  try {
    const camber::CrgData crg = camber::read_crg(file.path());
    for (const bool modify : {false, true}) {
      const camber::CrgRoad road(crg, modify);
      if (road.sections() != crg.sections()) std::abort();
      for (const double u : {-1e9, 0.0, 0.3, 7.0, 1e9}) {
        for (const double v : {-1e9, -0.2, 0.0, 3.0, 1e9}) {
          road.height(u, v);
          if (std::isfinite(road.position(u, v).norm())) road.height_at(u, v);
        }
      }
    }
  } catch (const camber::InputError&) {
    // what a reader of untrusted files answers
  }
  return 0;
}
