#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "camber/geometry/pinhole_camera.h"
#include "camber/motion/correspondences.h"

namespace camber {

/// Known sizes of painted markings, m along the surface; 0: not known, not looked for.
struct LaneMarkingSizes {
  double dash_length = 0.0;   ///< of the strokes of a broken line
  double dash_gap = 0.0;      ///< between strokes
  double line_width = 0.0;    ///< of lines
  double stripe_width = 0.0;  ///< of a pedestrian crossing's stripes
  double stripe_gap = 0.0;    ///< between stripes
  /// Of a crossing's stripes; used in single images alone, as the next.
  double stripe_length = 0.0;
  double lane_width = 0.0;  ///< between the middles of the lines on both sides of a lane

  bool dashes() const { return dash_length > 0 && dash_gap > 0 && line_width > 0; }
  bool stripes() const { return stripe_width > 0 && stripe_gap > 0; }
};

/// The ground as it is known so far, one value a pixel, row-major.
struct GroundRaster {
  int top = 0;  ///< first row; those above it are not stored
  /// 1/m, at the pixel's ray; <= 0: the sky.
  std::vector<float> inverse_depth;
  /// Non-zero where ground is seen and nothing stands or moves.
  std::vector<std::uint8_t> visible;
};

/// One stroke of a broken line, both ends of which are seen. Pixels are those of the stroke's
/// middle line.
struct PaintedDash {
  Eigen::Vector2d near_end, far_end;  ///< half of the contrast; only rough below 5 rows
  Eigen::Vector2d centroid;           ///< of the painted pixels
  double sigma = 0.0;                 ///< px, standard deviation of the centroid's row
  int rows = 0;                       ///< it is seen in
};

/// Stripes of a pedestrian crossing, seen in one row of pixels.
struct PaintedCrossing {
  Eigen::Vector2d first, last;  ///< middles of the outermost stripes that are seen
  Eigen::Vector2d along;        ///< another pixel on the first stripe's middle line
  double angle_sigma = 0.0;     ///< rad, standard deviation of that line's direction on the ground
  int stripes = 0;              ///< from the first to the last, those hidden between included, >= 3
  double sigma = 0.0;           ///< px, standard deviation of either middle's column
};

struct LaneMarkings {
  std::vector<PaintedDash> dashes;         ///< nearest first
  std::vector<PaintedCrossing> crossings;  ///< nearest first
};

/// Finds broken lines and pedestrian crossings of known sizes on the ground: bars brighter than the
/// ground on both sides, of the width that a marking has at each pixel's depth, followed from row
/// to row; crossings are runs of equal bars. What does not end in view (a continuous line, a
/// stroke cut by a vehicle or by the image) is left out.
/// @param ahead  rough direction of the road, camera frame; bars are followed along it.
/// @param scale_sigma  relative standard deviation of the raster's scale: lengths may be off by
///                     three of them and a sixth.
/// @throws std::invalid_argument for sizes that disagree.
LaneMarkings detect_lane_markings(const GrayImage& image, const PinholeCamera& camera,
                                  const GroundRaster& ground, const Eigen::Vector3d& ahead,
                                  const LaneMarkingSizes& sizes, double scale_sigma,
                                  int num_threads = 0);

}  // namespace camber
