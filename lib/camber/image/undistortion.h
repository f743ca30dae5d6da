#pragma once

#include <cstdint>
#include <vector>

#include "camber/geometry/lens_distortion.h"
#include "camber/geometry/pinhole_camera.h"
#include "camber/image/image.h"

namespace camber {

/// Takes a lens's distortion out of images: from the files' pixels to those of a pinhole camera.
class Undistortion {
 public:
  /// Nothing to take out: files are as the camera has them.
  explicit Undistortion(const PinholeCamera& camera);
  /// @throws std::invalid_argument for a camera or lens that is not valid.
  Undistortion(const PinholeCamera& camera, const LensDistortion& lens);

  bool needed() const { return !x_.empty(); }
  const PinholeCamera& camera() const { return camera_; }
  const PinholeCamera& raw() const { return raw_; }  ///< size and intrinsics of the files

  /// Colours or intensities, bicubic; black where the file shows nothing.
  /// @throws std::invalid_argument for an image that does not have the size of raw().
  Image image(const Image& file) const;
  /// Labels or masks: the nearest pixel's; 0 where the file shows nothing.
  Image labels(const Image& file) const;
  /// One byte a pixel of the camera, row-major: non-zero where the file shows nothing, with a
  /// margin. Empty if nothing is needed.
  const std::vector<std::uint8_t>& outside() const { return outside_; }

 private:
  Image remapped(const Image& file, int interpolation) const;

  PinholeCamera camera_, raw_;
  std::vector<float> x_, y_;  // px in the file, one a pixel; far outside where nothing is shown
  std::vector<std::uint8_t> outside_;
};

}  // namespace camber
