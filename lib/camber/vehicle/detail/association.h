#pragma once

#include "camber/vehicle/vehicle_tracks.h"

namespace camber::internal {

/// Detections of one vehicle, the frames ascending, one a frame.
using Track = std::vector<TrackView>;

/// Tracks by their numbers in ascending order. A given track may name two detections of one frame:
/// the first is taken.
std::vector<Track> tracks_of(const std::vector<std::vector<int>>& numbers);

/// Numbers of tracks for the result: given ones stay, found ones of more than one detection come
/// after them, -1 for the others.
std::vector<std::vector<int>> reported_numbers(const std::vector<TrackFrame>& frames,
                                               const std::vector<Track>& tracks);

}  // namespace camber::internal
