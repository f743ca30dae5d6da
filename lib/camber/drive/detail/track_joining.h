#pragma once

#include <map>
#include <utility>
#include <vector>

#include "camber/drive/detail/track_rejection.h"
#include "camber/drive/window_measurement.h"

namespace camber::internal {

/// A detection: frame id, id within the frame.
using Detection = std::pair<int, int>;

/// A detection that its window placed.
struct PlacedDetection {
  std::string vehicle_class;
  TrackPlace place;
};

/// Groups of detections that are one vehicle, no two of one frame. Neighbours in a window that all
/// windows with both join are one. Other links of windows, from those that most of them make, and
/// what a vehicle that was hidden for some seconds leaves in two parts, are joined where the one
/// part's motion on the road goes to the other's place.
/// @param placed  metric; empty: all links of windows are taken and nothing is bridged.
/// @return each group by frame; groups by their first detections.
std::vector<std::vector<Detection>> join_detections(
    const std::vector<WindowMeasurement>& windows,
    const std::map<Detection, PlacedDetection>& placed);

/// Joins groups of detections, no two of one frame, of vehicles that were hidden in between.
std::vector<std::vector<Detection>> bridge_detections(
    const std::vector<std::vector<Detection>>& groups,
    const std::map<Detection, PlacedDetection>& placed);

}  // namespace camber::internal
