#include "camber/vehicle/detail/association.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <stdexcept>

#include "camber/vehicle/detail/pixel_bounds.h"

namespace camber {

namespace {

using namespace internal;

/// Overlap of an earlier vehicle's box with a later detection: as if it were parked, or as it was.
double track_overlap(const PinholeCamera& camera, const TrackFrame& from, std::size_t i,
                     const TrackFrame& to, std::size_t j) {
  const Box2& later = to.detections[j].box;
  const double best = intersection_over_union(from.detections[i].box, later);
  const VehicleEstimate& e = from.estimates[i];
  if (e.status == Status::kFailed || e.status == Status::kNotRun) return best;
  const SE3 to_from_from = to.world_from_camera.inverse() * from.world_from_camera;
  const auto corners = e.pose.corners();
  PixelBounds here, there;
  for (int k = 0; k < 8; ++k) {
    const Eigen::Vector3d x = corners.col(k);
    const auto before = camera.project(x), after = camera.project(to_from_from * x);
    if (!before || !after) return best;
    here.include(*before);
    there.include(*after);
  }
  // The box's own edges moved as the vehicle's corners do: their errors cancel.
  const Box2& box = from.detections[i].box;
  const Box2 moved{box.x1 + there.box.x1 - here.box.x1, box.y1 + there.box.y1 - here.box.y1,
                   box.x2 + there.box.x2 - here.box.x2, box.y2 + there.box.y2 - here.box.y2};
  return std::max(best, intersection_over_union(moved.clipped(camera.width, camera.height), later));
}

/// Gives detections of frame t without a number those of frame s that they overlap best, greedily.
void join_frames(const PinholeCamera& camera, const std::vector<TrackFrame>& frames, std::size_t s,
                 std::size_t t, double min_overlap, std::vector<std::vector<int>>* numbers) {
  struct Pair {
    double overlap;
    std::size_t i, j;
  };
  const std::vector<VehicleDetection>&earlier = frames[s].detections, &now = frames[t].detections;
  std::vector<int>& own = (*numbers)[t];
  std::vector<Pair> pairs;
  for (std::size_t i = 0; i < earlier.size(); ++i) {
    const int number = (*numbers)[s][i];
    if (earlier[i].track >= 0) continue;
    if (t > s + 1) {  // it goes on in the frame between
      const std::vector<int>& between = (*numbers)[t - 1];
      if (std::find(between.begin(), between.end(), number) != between.end()) continue;
    }
    for (std::size_t j = 0; j < now.size(); ++j) {
      if (own[j] >= 0 || now[j].track >= 0) continue;
      if (now[j].vehicle_class != earlier[i].vehicle_class) continue;
      const double overlap = track_overlap(camera, frames[s], i, frames[t], j);
      if (overlap >= min_overlap) pairs.push_back({overlap, i, j});
    }
  }
  std::stable_sort(pairs.begin(), pairs.end(),
                   [](const Pair& a, const Pair& b) { return a.overlap > b.overlap; });
  std::vector<bool> used(earlier.size());
  for (const Pair& p : pairs) {
    if (used[p.i] || own[p.j] >= 0) continue;
    used[p.i] = true;
    own[p.j] = (*numbers)[s][p.i];
  }
}

}  // namespace

std::vector<std::vector<int>> find_tracks(const PinholeCamera& camera,
                                          const std::vector<TrackFrame>& frames,
                                          const AssociationGates& gates) {
  std::vector<std::vector<int>> out;
  for (const TrackFrame& f : frames) {
    if (f.estimates.size() != f.detections.size() || f.supports.size() != f.detections.size()) {
      throw std::invalid_argument(
          fmt::format("frames: {} detections with {} supports and {} estimates",
                      f.detections.size(), f.supports.size(), f.estimates.size()));
    }
    out.emplace_back(f.detections.size(), -1);
  }
  int next = 0;
  std::map<int, int> known;  // given track to number
  for (std::size_t t = 0; t < frames.size(); ++t) {
    const std::vector<VehicleDetection>& now = frames[t].detections;
    for (std::size_t j = 0; j < now.size(); ++j) {
      if (now[j].track < 0) continue;
      const auto [it, fresh] = known.emplace(now[j].track, next);
      next += fresh ? 1 : 0;
      out[t][j] = it->second;
    }
    for (std::size_t back = 1; back <= 2 && back <= t; ++back) {
      join_frames(camera, frames, t - back, t, gates.overlap, &out);
    }
    for (std::size_t j = 0; j < now.size(); ++j) {
      if (out[t][j] < 0) out[t][j] = next++;
    }
  }
  return out;
}

namespace internal {

std::vector<Track> tracks_of(const std::vector<std::vector<int>>& numbers) {
  std::map<int, Track> tracks;
  for (std::size_t t = 0; t < numbers.size(); ++t) {
    for (std::size_t j = 0; j < numbers[t].size(); ++j) {
      Track& track = tracks[numbers[t][j]];
      if (track.empty() || track.back().frame != t) track.push_back({t, j});
    }
  }
  std::vector<Track> out;
  for (auto& [number, track] : tracks) out.push_back(std::move(track));
  return out;
}

std::vector<std::vector<int>> reported_numbers(const std::vector<TrackFrame>& frames,
                                               const std::vector<Track>& tracks) {
  int next = 0;
  std::vector<std::vector<int>> out;
  for (const TrackFrame& f : frames) {
    out.emplace_back(f.detections.size(), -1);
    for (const VehicleDetection& d : f.detections) next = std::max(next, d.track + 1);
  }
  for (const Track& track : tracks) {
    const TrackView& first = track.front();
    const int given = frames[first.frame].detections[first.detection].track;
    if (given < 0 && track.size() < 2) continue;
    const int number = given < 0 ? next++ : given;
    for (const TrackView& v : track) out[v.frame][v.detection] = number;
  }
  return out;
}

}  // namespace internal

}  // namespace camber
