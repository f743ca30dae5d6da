// Any bytes as a KITTI label file, as its side file of tilts and as keypoints of its cars: rows
// whose form is known, or refused with an InputError.

#include "camber/import/kitti_keypoints.h"
#include "camber/import/kitti_labels.h"
#include "camber/pipeline/kitti_boxes.h"
#include "memory_file.h"
#include "read_or_refuse.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const MemoryFile file(data, size);
  read_or_refuse([&] { camber::read_kitti_labels(file.path()); });
  read_or_refuse([&] { camber::read_tilts(file.path(), 3); });
  read_or_refuse([&] { camber::read_kitti_keypoints(file.path()); });
  return 0;
}
