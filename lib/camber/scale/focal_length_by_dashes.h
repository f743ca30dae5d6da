#pragma once

#include <Eigen/Core>
#include <vector>

#include "camber/scale/lane_marking_detection.h"

namespace camber {

/// What the strokes of broken lines know of the focal length.
struct DashFocalLength {
  double factor = 1.0;  ///< on the camera's focal length, > 0, to about a tenth
  int strokes = 0;      ///< that fit it, more than fit the camera's own; 0: none
};

/// Looks for broken lines of known sizes with other focal lengths, from half to twice the camera's.
/// A wrong one stretches the ground along the view and leaves what lies across it, as the camera's
/// height and the width of a line, unchanged: strokes of the right width then have wrong lengths
/// and periods. Strokes that lie a period apart, along each other, prove it; where there are none,
/// and none has about the known length, one long stroke near the camera that has it with half or
/// twice the focal length.
/// @param ground, ahead  by the camera as it is given; see detect_lane_markings().
/// @throws std::invalid_argument for sizes that disagree.
DashFocalLength focal_length_by_dashes(const GrayImage& image, const PinholeCamera& camera,
                                       const GroundRaster& ground, const Eigen::Vector3d& ahead,
                                       const LaneMarkingSizes& sizes, double scale_sigma,
                                       int num_threads = 0);

/// Broken lines of known sizes on a ground whose lengths along the view may be a fifth off.
struct BrokenLineRatios {
  int strokes = 0;               ///< that lie a period, or two, from another, along each other
  std::vector<double> periods;   ///< of each such pair over the known one
  std::vector<double> sidewise;  ///< lane widths between lines side by side over the known one
};

/// @param ground, ahead  see detect_lane_markings(). @param scale_sigma  relative.
/// @return nothing found where the sizes of dashes are not known; `sidewise` needs lane_width.
BrokenLineRatios broken_line_ratios(const GrayImage& image, const PinholeCamera& camera,
                                    const GroundRaster& ground, const Eigen::Vector3d& ahead,
                                    const LaneMarkingSizes& sizes, double scale_sigma,
                                    int num_threads = 0);

}  // namespace camber
