#pragma once

#include <optional>
#include <string>
#include <vector>

#include "camber/image/frame_pixels.h"
#include "camber/scene/scene.h"

namespace camber {

/// A constant time between the clock of given poses and that of the images.
struct PoseOffset {
  double seconds = 0.0;      ///< that the poses' times are ahead of the images'
  double frames = 0.0;       ///< the same in frames
  double correlation = 0.0;  ///< of the turn rates with it
  double without = 0.0;      ///< ... and as the times are
};

/// The shift, if there is one, by which two series of turns have the same course and the same size.
/// Turns are angles between neighbours, which hang on no choice of axes.
/// @param images, poses  rad, of the same places; at least 30, else nothing.
/// @param step           s between neighbours.
std::optional<PoseOffset> turn_offset(const std::vector<double>& images,
                                      const std::vector<double>& poses, double step);

/// Looks for a clock that is off, by the turns of up to 100 frames on each side of the reference.
/// Nothing where too few frames have poses, or the drive does not turn enough to show it.
std::optional<PoseOffset> find_pose_offset(const Scene& scene, int reference_frame,
                                           const FramePixelSource& pixels);

/// "the turns of poses and images agree (correlation 0.97, 0.12 as it is) if ...".
std::string describe(const PoseOffset& offset);

}  // namespace camber
