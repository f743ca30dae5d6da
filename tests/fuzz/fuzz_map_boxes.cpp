// Any bytes as boxes of nuScenes or Argoverse 2: boxes of a size, which go into the file again, or
// an InputError.

#include <cstdlib>
#include <vector>

#include "camber/core/errors.h"
#include "camber/import/formats/map_boxes.h"
#include "memory_file.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const MemoryFile file(data, size);
  try {
    const camber::MapBoxFile found = camber::MapBoxFile::read(file.path());
    for (const camber::MapBox& box : found.boxes()) {
      if (!(box.length > 0.0 && box.width > 0.0 && box.height > 0.0)) std::abort();
      if (!box.center.allFinite()) std::abort();
    }
    const std::vector<camber::MapBoxNote> notes(found.boxes().size(), {"ok", "", 0.1});
    if (found.encoded(found.boxes(), notes).empty()) std::abort();
  } catch (const camber::InputError&) {
    // what a reader of untrusted files answers
  }
  return 0;
}
