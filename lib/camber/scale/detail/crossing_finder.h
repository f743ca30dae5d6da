#pragma once

#include <vector>

#include "camber/scale/lane_marking_detection.h"

namespace camber::detail {

/// Finds pedestrian crossings: runs of equal bars in neighbouring rows that lie on the ground as
/// one pattern of parallel stripes. Parameters as detect_lane_markings(). @return nearest first
std::vector<PaintedCrossing> find_crossings(const GrayImage& image, const PinholeCamera& camera,
                                            const GroundRaster& ground,
                                            const LaneMarkingSizes& sizes, double scale_sigma,
                                            int num_threads);

}  // namespace camber::detail
