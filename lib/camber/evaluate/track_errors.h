#pragma once

#include <limits>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "camber/scene/results.h"
#include "camber/scene/scene.h"

namespace camber {

/// Tracks of one estimate against the true ones: the CLEAR MOT measures (Bernardin and
/// Stiefelhagen, "Evaluating multiple object tracking performance", 2008) by boxes that overlap by
/// at least half. The ids of the true vehicles are their tracks. True vehicles that do not count
/// (metrics.h) are neither missed, nor is what covers them false.
struct TrackErrors {
  int frames = 0;                   ///< of the estimate, with a truth
  int true_tracks = 0, tracks = 0;  ///< with a vehicle that counts; estimated
  int true_vehicles = 0;            ///< vehicle frames of the truth that count
  int matched = 0, missed = 0;      ///< of those
  int false_positives = 0;          ///< estimated vehicles on no true one
  int without_track = 0;            ///< estimated vehicles without a track; they match nothing
  int id_switches = 0;              ///< a true track is matched to another track than before
  int fragmentations = 0;           ///< a true track is matched again after a gap
  int split = 0;                    ///< true tracks with more than one estimated track
  int joined = 0;                   ///< estimated tracks on more than one true track
  /// 1 - (missed + false_positives + id_switches) / true_vehicles; NaN without true vehicles.
  double mota = std::numeric_limits<double>::quiet_NaN();
  double motp = std::numeric_limits<double>::quiet_NaN();  ///< mean overlap of the matched
};

/// A true track stays with the estimated one that it was matched to while their boxes overlap by at
/// least half; the rest is matched greedily, best first.
/// @throws std::invalid_argument if the scene has no truth.
TrackErrors track_errors(const Scene& scene, const VehicleDocument& vehicles);

/// The errors of one estimate under its name.
struct EvaluatedTracks {
  std::string truth, estimate, method;
  TrackErrors errors;
};

std::string tracks_text(const std::vector<EvaluatedTracks>& tracks, bool markdown);
nlohmann::json to_json(const EvaluatedTracks& tracks);

}  // namespace camber
