// Any bytes as one of a COLMAP model's files: the first byte says which.

#include "camber/cloud/colmap.h"
#include "cloud_input.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  const int kind = *data++ % 8;
  --size;
  const std::string extension = kind % 2 == 0 ? ".bin" : ".txt";
  try {
    switch (kind / 2) {
      case 0:
        camber::parse_colmap_cameras(data, size, "cameras" + extension);
        break;
      case 1:
        camber::parse_colmap_images(data, size, "images" + extension);
        break;
      case 2:
        camber::parse_colmap_points(data, size, "points3D" + extension);
        break;
      default:
        camber::read_cloud_memory(data, size, "points3D" + extension).cloud.validate();
    }
  } catch (const camber::InputError&) {
    // what a reader of untrusted files answers
  }
  return 0;
}
