#pragma once

#include <map>
#include <string>

#include "camber/image/frame_pixels.h"
#include "camber/scene/scene.h"
#include "convert.h"

namespace camber::python {

/// A scene with the images that Python holds: arrays, or functions that give one.
struct PythonScene {
  struct Pixels {
    py::object image, segmentation, road_mask;  // unset or None: not given
  };
  Scene scene;
  std::string path;  ///< of the manifest, empty: made in Python
  std::map<int, Pixels> pixels;

  /// The pixels of its frames, copied out of the arrays when they are asked for; it must outlive
  /// the source. Takes the interpreter's lock.
  FramePixelSource source() const;
};

}  // namespace camber::python
