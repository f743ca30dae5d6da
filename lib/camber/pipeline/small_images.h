#pragma once

#include <cstddef>

#include "camber/image/frame_pixels.h"
#include "camber/image/undistortion.h"
#include "camber/image/video.h"
#include "camber/scene/scene.h"

namespace camber {

/// Small images of a scene's frames: shrunk() of near_parallax.h, undistorted.
class SmallImages {
 public:
  /// @param scene, pixels  kept by reference.
  SmallImages(const Scene& scene, const FramePixelSource& pixels);
  /// @param place  in scene.frames; a video is read on as long as these ascend.
  /// @throws NoAnswerError for a frame without an image; InputError.
  GrayImage read(std::size_t place);

 private:
  const Scene& scene_;
  const FramePixelSource& pixels_;
  Undistortion lens_;
  FrameImageReader images_;
};

}  // namespace camber
