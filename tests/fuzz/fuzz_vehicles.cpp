// Any bytes as vehicles.json: read, or refused with an InputError.

#include "camber/core/errors.h"
#include "camber/scene/results.h"
#include "memory_file.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const MemoryFile file(data, size);
  try {
    camber::read_vehicles(file.path());
  } catch (const camber::InputError&) {
    // what a reader of untrusted files answers
  }
  return 0;
}
