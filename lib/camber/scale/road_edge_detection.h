#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "camber/geometry/pinhole_camera.h"
#include "camber/motion/correspondences.h"
#include "camber/scale/lane_marking_detection.h"

namespace camber {

/// An edge of the road in one row of pixels.
struct RoadEdgePixel {
  int row = 0;
  double column = 0.0;     ///< px
  bool continues = false;  ///< the pixel before it in the list, nothing hidden between
};

/// Rows from the bottom of the image up; those in which the edge is hidden are left out.
struct RoadEdges {
  std::vector<RoadEdgePixel> left, right;
};

/// Finds the road's left and right edge row by row, 4 to 80 m ahead. The coarse place is where a
/// road mask changes over, followed along the road by dynamic programming; the place in a row is
/// where the intensities across it are most like those across the edge elsewhere, so that one
/// edge (of a kerb, a line, a verge) is followed throughout. Accurate to half a pixel where that
/// edge is seen; which edge it is may differ from one side of a hidden stretch to the other.
/// @param road, hidden  one byte a pixel, row-major, non-zero: road; hidden by vehicles.
/// @param ahead  rough direction of the road, camera frame.
/// @throws std::invalid_argument for sizes that disagree.
RoadEdges detect_road_edges(const GrayImage& image, const PinholeCamera& camera,
                            const GroundRaster& ground, const std::vector<std::uint8_t>& road,
                            const std::vector<std::uint8_t>& hidden, const Eigen::Vector3d& ahead,
                            int num_threads = 0);

}  // namespace camber
