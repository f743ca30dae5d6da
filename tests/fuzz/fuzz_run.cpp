// Any bytes as run.json: a run that can be written again, or refused with an InputError.

#include <nlohmann/json.hpp>

#include "camber/core/errors.h"
#include "camber/scene/results.h"
#include "memory_file.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const MemoryFile file(data, size);
  try {
    camber::to_json(camber::read_run(file.path()));
  } catch (const camber::InputError&) {
    // what a reader of untrusted files answers
  }
  return 0;
}
