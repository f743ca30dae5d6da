// Any bytes as a calibration of another program: cameras with lenses that can be used or are
// refused, or an InputError.

#include "camber/core/errors.h"
#include "camber/geometry/lens_map.h"
#include "camber/import/formats/calibration.h"
#include "memory_file.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const MemoryFile file(data, size);
  try {
    const camber::CalibrationFile read = camber::read_calibration(file.path());
    for (std::size_t i = 0; i < read.cameras.size() && i < 4; ++i) {
      for (const bool rectified : {false, true}) {
        try {
          const camber::CameraCalibration& camera =
              camber::choose_camera(read, std::to_string(i), file.path());
          const int width = camera.width.value_or(640), height = camera.height.value_or(480);
          if (width < 1 || height < 1 || width > 16384 || height > 16384) continue;
          const camber::LensDistortion lens =
              camber::lens_of(camera, rectified, width, height, file.path());
          lens.validate();
          const camber::PinholeCamera chosen = camber::undistorted_camera(lens);
          if (lens.model != camber::LensModel::kNone && chosen.width > 0) {
            camber::LensMap(chosen, lens).raw_from_pinhole({chosen.cx + 3.0, chosen.cy - 2.0});
          }
        } catch (const camber::InputError&) {
          // this camera cannot be used
        }
      }
    }
  } catch (const camber::InputError&) {
    // what a reader of untrusted files answers
  }
  return 0;
}
