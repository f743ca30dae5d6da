// Any bytes as a KITTI calibration file, and as a file of poses: numbers that can be used, or
// refused with an InputError.

#include "camber/core/errors.h"
#include "camber/import/import_kitti.h"
#include "memory_file.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const MemoryFile file(data, size);
  try {
    const camber::KittiCalibration calibration = camber::read_kitti_calibration({file.path()});
    calibration.camera(2);
    calibration.camera_from_laser(2);
  } catch (const camber::InputError&) {
    // what a reader of untrusted files answers
  }
  try {
    camber::read_kitti_poses(file.path());
  } catch (const camber::InputError&) {
  }
  return 0;
}
