// Any bytes as surface.json: a surface that can be asked, or refused with an InputError.

#include "camber/core/errors.h"
#include "camber/scene/results.h"
#include "memory_file.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const MemoryFile file(data, size);
  try {
    const camber::RoadSurface surface = camber::read_surface(file.path());
    surface.query({0.0, 1.6, 10.0});
  } catch (const camber::InputError&) {
    // what a reader of untrusted files answers
  }
  return 0;
}
