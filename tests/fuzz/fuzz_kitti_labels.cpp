// Any bytes as a KITTI label file: rows whose form is known, or refused with an InputError.

#include "camber/core/errors.h"
#include "camber/scene/kitti_labels.h"
#include "memory_file.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const MemoryFile file(data, size);
  try {
    camber::read_kitti_labels(file.path());
  } catch (const camber::InputError&) {
    // what a reader of untrusted files answers
  }
  return 0;
}
