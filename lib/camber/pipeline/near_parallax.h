#pragma once

#include <optional>

#include "camber/geometry/pinhole_camera.h"
#include "camber/image/image.h"

namespace camber {

/// rad, parallax of the near road with which it can be triangulated.
inline constexpr double kEnoughNearParallax = 0.025;
/// Share of the near road that has to be matched between neighbours for its parallax to be taken as
/// it is: what moves fast is lost, and what is left (cars ahead, far road, chance) moves little.
inline constexpr double kLeastNearMatched = 0.62;

/// A third of the size, at least 16 px wide and high.
GrayImage shrunk(const GrayImage& image);

/// Median image motion in the lower third, px of the full image, after the rotation that the upper
/// half shows has been taken out; nothing where less than that share of it is matched.
/// @param a  shrunk(), and so is b; of the camera's images.
std::optional<double> near_parallax(const PinholeCamera& camera, const GrayImage& a,
                                    const GrayImage& b, double least_matched);

}  // namespace camber
