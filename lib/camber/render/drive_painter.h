#pragma once

#include <cstddef>
#include <memory>

#include "camber/image/image_io.h"
#include "camber/render/drive_content.h"
#include "camber/render/overlay.h"

namespace camber {

/// Draws the frames of a drive, each as one picture of even sides: the image with the road's
/// patches ahead, coloured by their grade, and the vehicles in it; below it the bird's-eye view
/// around the camera and the profile with the place of the frame. Colours and scales are the
/// drive's, the same in every frame. Needs no rendering back end. Same input, same pixels.
class DrivePainter {
 public:
  /// @param content  kept by reference.
  explicit DrivePainter(const DriveContent& content);
  ~DrivePainter();
  DrivePainter(const DrivePainter&) = delete;
  DrivePainter& operator=(const DrivePainter&) = delete;

  int width() const;   ///< pixels
  int height() const;  ///< pixels

  /// The image with road and vehicles alone. @param frame  index into drive->frames.
  /// @param photo  of the camera's size. @param memory  of the pictures before; may be nullptr.
  Image overlay(const Image& photo, std::size_t frame, LabelMemory* memory) const;
  /// The whole picture. @param overlay  as overlay() gives it.
  Image picture(const Image& overlay, std::size_t frame) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace camber
