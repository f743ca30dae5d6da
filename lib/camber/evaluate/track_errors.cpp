#include "camber/evaluate/track_errors.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <stdexcept>

#include "camber/evaluate/detail/text_table.h"
#include "camber/evaluate/metrics.h"

namespace camber {
namespace {

constexpr double kLeastOverlap = 0.5;

/// What is known of a true track while the frames go by.
struct TrackState {
  int last = -1;         ///< the estimated track that it was matched to last
  bool matched = false;  ///< in the last frame in which it counted
  bool ever = false;
  std::set<int> estimates;
};

struct Pair {
  std::size_t truth = 0, estimate = 0;
  double overlap = 0.0;
  bool before = false;  ///< it was matched so before
  bool counts = true;
};

std::vector<Pair> overlapping(const Scene& scene, const TruthFrame& truth,
                              const VehicleFrame& estimate,
                              const std::map<int, TrackState>& states) {
  std::vector<Pair> out;
  for (std::size_t t = 0; t < truth.vehicles.size(); ++t) {
    const TruthVehicle& vehicle = truth.vehicles[t];
    const Box2 box = vehicle.box.clipped(scene.camera.width, scene.camera.height);
    const auto state = states.find(vehicle.id);
    const int last = state == states.end() ? -1 : state->second.last;
    for (std::size_t e = 0; e < estimate.vehicles.size(); ++e) {
      const VehicleEstimate& one = estimate.vehicles[e];
      const double overlap = intersection_over_union(box, one.box);
      if (!(overlap >= kLeastOverlap)) continue;
      out.push_back(
          {t, e, overlap, one.track >= 0 && one.track == last, is_counted(vehicle, scene.camera)});
    }
  }
  std::stable_sort(out.begin(), out.end(), [](const Pair& a, const Pair& b) {
    if (a.before != b.before) return a.before;
    return a.overlap > b.overlap;
  });
  return out;
}

}  // namespace

TrackErrors track_errors(const Scene& scene, const VehicleDocument& vehicles) {
  if (!scene.truth) throw std::invalid_argument("the scene has no truth to compare with");
  TrackErrors out;
  std::map<int, const TruthFrame*> truths;
  for (const TruthFrame& frame : scene.truth->frames) truths[frame.id] = &frame;
  std::vector<const VehicleFrame*> frames;
  for (const VehicleFrame& frame : vehicles.frames) frames.push_back(&frame);
  std::stable_sort(frames.begin(), frames.end(),
                   [](const VehicleFrame* a, const VehicleFrame* b) { return a->id < b->id; });

  std::map<int, TrackState> states;
  std::map<int, std::set<int>> truths_of_track;
  std::set<int> tracks;
  double overlaps = 0.0;
  for (const VehicleFrame* estimate : frames) {
    const auto at = truths.find(estimate->id);
    if (at == truths.end()) continue;
    const TruthFrame& truth = *at->second;
    ++out.frames;
    std::vector<bool> found(truth.vehicles.size()), used(estimate->vehicles.size());
    for (const VehicleEstimate& one : estimate->vehicles) {
      if (one.track >= 0) tracks.insert(one.track);
    }
    for (const Pair& pair : overlapping(scene, truth, *estimate, states)) {
      if (found[pair.truth] || used[pair.estimate]) continue;
      found[pair.truth] = used[pair.estimate] = true;
      const int track = estimate->vehicles[pair.estimate].track;
      if (!pair.counts) continue;
      if (track < 0) {  // neither found nor false: it stands beside
        found[pair.truth] = false;
        continue;
      }
      TrackState& state = states[truth.vehicles[pair.truth].id];
      out.id_switches += state.ever && state.last != track ? 1 : 0;
      out.fragmentations += state.ever && !state.matched ? 1 : 0;
      state.last = track;
      state.ever = true;
      state.estimates.insert(track);
      truths_of_track[track].insert(truth.vehicles[pair.truth].id);
      ++out.matched;
      overlaps += pair.overlap;
    }
    for (std::size_t e = 0; e < used.size(); ++e) {
      if (estimate->vehicles[e].track < 0) {
        ++out.without_track;
      } else {
        out.false_positives += used[e] ? 0 : 1;
      }
    }
    for (std::size_t t = 0; t < truth.vehicles.size(); ++t) {
      if (!is_counted(truth.vehicles[t], scene.camera)) continue;
      ++out.true_vehicles;
      states[truth.vehicles[t].id].matched = found[t];
    }
  }
  out.true_tracks = static_cast<int>(states.size());
  out.tracks = static_cast<int>(tracks.size());
  out.missed = out.true_vehicles - out.matched;
  for (const auto& [track, state] : states) out.split += state.estimates.size() > 1 ? 1 : 0;
  for (const auto& [track, of] : truths_of_track) out.joined += of.size() > 1 ? 1 : 0;
  if (out.true_vehicles > 0) {
    out.mota = 1.0 - static_cast<double>(out.missed + out.false_positives + out.id_switches) /
                         out.true_vehicles;
  }
  if (out.matched > 0) out.motp = overlaps / out.matched;
  return out;
}

std::string tracks_text(const std::vector<EvaluatedTracks>& tracks, bool markdown) {
  std::vector<std::vector<std::string>> lines{{"tracks of", "MOTA %", "MOTP %", "id switches",
                                               "fragmentations", "split", "joined", "true tracks",
                                               "tracks", "vehicle frames", "missed", "false"}};
  const auto percent = [](double share) {
    return std::isfinite(share) ? fmt::format("{:.2f}", 100.0 * share) : std::string("-");
  };
  for (const EvaluatedTracks& one : tracks) {
    const TrackErrors& e = one.errors;
    lines.push_back({one.estimate, percent(e.mota), percent(e.motp), std::to_string(e.id_switches),
                     std::to_string(e.fragmentations), std::to_string(e.split),
                     std::to_string(e.joined), std::to_string(e.true_tracks),
                     std::to_string(e.tracks), std::to_string(e.true_vehicles),
                     std::to_string(e.missed), std::to_string(e.false_positives)});
  }
  return tracks.empty() ? std::string() : detail::table_text(lines, markdown);
}

nlohmann::json to_json(const EvaluatedTracks& tracks) {
  const auto number = [](double value) {
    return std::isfinite(value) ? nlohmann::json(value) : nlohmann::json(nullptr);
  };
  const TrackErrors& e = tracks.errors;
  return {{"truth", tracks.truth},
          {"estimate", tracks.estimate},
          {"method", tracks.method},
          {"frames", e.frames},
          {"true_tracks", e.true_tracks},
          {"tracks", e.tracks},
          {"true_vehicles", e.true_vehicles},
          {"matched", e.matched},
          {"missed", e.missed},
          {"false_positives", e.false_positives},
          {"without_track", e.without_track},
          {"id_switches", e.id_switches},
          {"fragmentations", e.fragmentations},
          {"split", e.split},
          {"joined", e.joined},
          {"mota", number(e.mota)},
          {"motp", number(e.motp)}};
}

}  // namespace camber
