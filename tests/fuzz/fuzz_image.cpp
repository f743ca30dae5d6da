// Any bytes as a PNG or JPEG image, as labels and as depth: decoded completely, or refused with an
// InputError.

#include "camber/image/image_io.h"
#include "memory_file.h"
#include "read_or_refuse.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const MemoryFile file(data, size);
  camber::PinholeCamera camera;
  read_or_refuse([&] {
    const camber::ImageInfo info = camber::read_image_info(file.path());
    camera = camber::PinholeCamera{info.width, info.height, 7.0, 7.0, 1.0, 1.0};
  });
  read_or_refuse([&] {
    const camber::Image image = camber::read_color_image(file.path());
    const std::size_t pixels = static_cast<std::size_t>(image.width) * image.height;
    if (image.channels != 3 || image.data.size() != 3 * pixels) std::abort();
  });
  if (camera.width == 0) return 0;
  read_or_refuse([&] { camber::read_label_image(file.path(), camera); });
  for (const int channel : {0, 2}) {
    read_or_refuse([&] { camber::read_label_channel(file.path(), channel); });
  }
  for (const char* const encoding : {"kitti", "synthia"}) {
    read_or_refuse([&] { camber::read_depth_image(file.path(), encoding, camera); });
  }
  read_or_refuse([&] { camber::read_disparity_image(file.path(), camera, 0.5); });
  return 0;
}
