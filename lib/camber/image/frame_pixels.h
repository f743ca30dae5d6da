#pragma once

#include <functional>
#include <map>

#include "camber/image/image.h"
#include "camber/image/image_io.h"
#include "camber/image/undistortion.h"

namespace camber {

/// What the files of a frame would hold, given in memory: pixels as the camera gave them, distorted
/// where the scene has a lens. What is empty is read from the frame's file, if it has one.
struct FramePixels {
  Image image;         ///< 1 or 3 channels
  Image segmentation;  ///< 1 channel, read through the scene's classes
  Image road_mask;     ///< 1 channel, non-zero: road
};

/// Gives the pixels of a frame by its id. Called from one thread at a time, in the order of the
/// frames; an exception that it throws ends the run. Empty: all frames have files.
using FramePixelSource = std::function<FramePixels(int frame_id)>;

/// The source of frames that all lie in memory.
FramePixelSource pixels_in_memory(std::map<int, FramePixels> frames);

/// Pixels in memory as a run needs them.
/// @param frame_id  for the message.
/// @throws std::invalid_argument for an image that is not as Image requires, has neither 1 nor 3
///         channels or not the size of lens.raw().
FrameImage make_frame_image(Image pixels, const Undistortion& lens, int frame_id);

/// Labels or a mask in memory. @param name  of the kind, for the message.
/// @throws std::invalid_argument unless they have one channel and the size of lens.raw().
Image make_frame_labels(const Image& pixels, const Undistortion& lens, int frame_id,
                        const char* name);

}  // namespace camber
