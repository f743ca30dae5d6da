// Any bytes as a PNG or JPEG image: decoded completely, or refused with an InputError.

#include "camber/core/errors.h"
#include "camber/image/image_io.h"
#include "memory_file.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const MemoryFile file(data, size);
  try {
    const camber::Image image = camber::read_color_image(file.path());
    const std::size_t pixels = static_cast<std::size_t>(image.width) * image.height;
    if (image.channels != 3 || image.data.size() != 3 * pixels) std::abort();
  } catch (const camber::InputError&) {
    // what a reader of untrusted files answers
  }
  return 0;
}
