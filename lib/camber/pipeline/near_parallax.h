#pragma once

#include <Eigen/Core>
#include <optional>

#include "camber/geometry/pinhole_camera.h"
#include "camber/image/image.h"

namespace camber {

/// rad, parallax of the near road with which it can be triangulated.
inline constexpr double kEnoughNearParallax = 0.025;
/// Share of the near road that has to be matched between neighbours for its parallax to be taken as
/// it is: what moves fast is lost, and what is left (cars ahead, far road, chance) moves little.
inline constexpr double kLeastNearMatched = 0.62;

/// px, of ImageParallax::most between neighbours: less is noise of a camera that stands.
inline constexpr double kLeastStep = 1.5;
/// Share of the parallax that is enough near the camera, which ImageParallax::most has to reach,
/// added up from frame to frame, where what is near stands still in the picture.
inline constexpr double kEnoughMoved = 0.5;
/// still_share() from which on a film's coder repeats the road: docs/notes/film.md.
inline constexpr double kRepeated = 0.05;

/// A third of the size, at least 16 px wide and high.
GrayImage shrunk(const GrayImage& image);

/// Image motion after the rotation that the upper half shows has been taken out, px of the full
/// image.
struct ImageParallax {
  /// Median in the lower third; nothing where less than the least share of it is matched.
  std::optional<double> near;
  /// Of all below the principal point a tenth moves more. Where `near` is much smaller, what is
  /// near stands still in the picture: a bonnet, or asphalt that a film's coder repeats.
  double most = 0.0;
  Eigen::Vector3d turn = Eigen::Vector3d::Zero();  ///< rad, that rotation, small, in the camera
};

/// @param a              shrunk(), and so is b; of the camera's images.
/// @param least_matched  share of the lower third.
/// @param num_threads    <= 0: see resolve_num_threads.
ImageParallax image_parallax(const PinholeCamera& camera, const GrayImage& a, const GrayImage& b,
                             double least_matched, int num_threads = 0);

/// image_parallax().near
std::optional<double> near_parallax(const PinholeCamera& camera, const GrayImage& a,
                                    const GrayImage& b, double least_matched);

}  // namespace camber
