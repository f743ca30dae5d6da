// Any bytes as boxes of another program: boxes of numbers that can be used, or an InputError.

#include <cmath>
#include <cstdlib>
#include <optional>
#include <utility>

#include "camber/core/errors.h"
#include "camber/import/formats/detections.h"
#include "memory_file.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const MemoryFile file(data, size);
  camber::DetectionOptions options;
  options.image_size = [](const std::string&) {
    return std::make_optional(std::pair<int, int>(1280, 720));
  };
  try {
    for (const camber::DetectedImage& image :
         camber::read_detections(file.path(), options).images) {
      for (const camber::DetectedBox& box : image.boxes) {
        const double sum = box.box.x1 + box.box.y1 + box.box.x2 + box.box.y2;
        if (!std::isfinite(sum)) std::abort();
      }
    }
  } catch (const camber::InputError&) {
    // what a reader of untrusted files answers
  }
  return 0;
}
