#pragma once

#include <cstdint>
#include <vector>

#include "camber/geometry/box.h"
#include "camber/geometry/pinhole_camera.h"
#include "camber/synth/synth_world.h"
#include "camber/synth/view_camera.h"

namespace camber {

struct CameraSensor {
  std::uint64_t seed = 0;
  int supersampling = 3;          ///< samples a pixel and direction, 1 to 6
  double blur = 0.5;              ///< px, standard deviation of the lens's blur, 0 to 3
  double noise = 1.2;             ///< grey levels of 255, standard deviation, 0 to 30
  double exposure_change = 0.04;  ///< relative, from frame to frame, 0 to 0.5
  double vignetting = 0.18;       ///< relative loss at the corners, 0 to 0.9
};

/// Colour picture of one frame as a camera gives it, through its lens if it has one: 3 * width *
/// height bytes of view.file(), red green blue; black where the lens shows nothing.
/// Same inputs, same picture for any number of threads.
std::vector<std::uint8_t> render_view(const SynthWorld& world, int frame, const ViewCamera& view,
                                      const CameraSensor& sensor, int num_threads);

/// The same from any pose, with the cars where they are at `frame`. Costs are proportional to the
/// camera's pixels: for a crop give a camera of the crop's size with its cx and cy moved
/// (vignetting is then about the crop's middle).
std::vector<std::uint8_t> render_view(const SynthWorld& world, int frame,
                                      const SE3& world_from_camera, const ViewCamera& view,
                                      const CameraSensor& sensor, int num_threads);

/// Truth of one frame at the pixel centres, by ray casting: independent of the picture.
struct ViewTruth {
  std::vector<WorldHit> hits;        ///< width * height; `distance` is the depth along z, m
  std::vector<std::uint8_t> labels;  ///< TruthLabel
  /// One a car: pixels of its whole outline inside the image, and those where it is seen.
  std::vector<int> outline_pixels, visible_pixels;
};
ViewTruth trace_view(const SynthWorld& world, int frame, const PinholeCamera& camera,
                     int num_threads);

/// TruthLabel of the pixels of view.file(), as its lens shows them; kSky where it shows nothing.
std::vector<std::uint8_t> trace_labels(const SynthWorld& world, int frame, const ViewCamera& view,
                                       int num_threads);

}  // namespace camber
