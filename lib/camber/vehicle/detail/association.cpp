#include "camber/vehicle/detail/association.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <stdexcept>

#include "camber/vehicle/detail/pixel_bounds.h"

namespace camber {

namespace {

using namespace internal;

/// A box that an earlier vehicle may have in a later image, and how likely its motion is, at
/// most 1.
struct Prediction {
  Box2 box;
  double weight = 1.0;
};

/// As it was, as if it were parked, and driving along its heading.
std::vector<Prediction> predictions(const PinholeCamera& camera, const TrackFrame& from,
                                    std::size_t i, const TrackFrame& to,
                                    const AssociationGates& gates) {
  constexpr double kStep = 2.0;  // m/s: 0.2 m between images of 10 a second
  const Box2& box = from.detections[i].box;
  std::vector<Prediction> out = {{box}};
  const VehicleEstimate& e = from.estimates[i];
  if (e.status == Status::kFailed || e.status == Status::kNotRun) return out;
  const SE3 to_from_from = to.world_from_camera.inverse() * from.world_from_camera;
  const auto corners = e.pose.corners();
  PixelBounds here;
  for (int k = 0; k < 8; ++k) {
    const auto pixel = camera.project(corners.col(k));
    if (!pixel) return out;
    here.include(*pixel);
  }
  const Eigen::Vector3d ahead = e.pose.camera_from_vehicle.rotation_matrix().col(0);
  for (double speed = 0.0; speed < 2.0 * gates.speed; speed += kStep) {
    const Eigen::Vector3d shift = speed * (to.time_s - from.time_s) * ahead;
    PixelBounds there;
    bool visible = true;
    for (int k = 0; k < 8 && visible; ++k) {
      const auto pixel = camera.project(to_from_from * (corners.col(k) + shift));
      visible = pixel.has_value();
      if (visible) there.include(*pixel);
    }
    if (!visible) continue;
    // The box's own edges moved as the vehicle's corners do: their errors cancel.
    const Box2 moved{box.x1 + there.box.x1 - here.box.x1, box.y1 + there.box.y1 - here.box.y1,
                     box.x2 + there.box.x2 - here.box.x2, box.y2 + there.box.y2 - here.box.y2};
    out.push_back({moved.clipped(camera.width, camera.height),
                   std::exp(-0.5 * std::pow(speed / gates.speed, 2))});
  }
  return out;
}

/// An earlier detection's number and a detection of frame t that its vehicle may be.
struct Candidate {
  double overlap;
  int number;
  std::size_t detection;
};

/// Detections of frame t without a number and those of frame s that they may be.
void add_candidates(const PinholeCamera& camera, const std::vector<TrackFrame>& frames,
                    std::size_t s, std::size_t t, const AssociationGates& gates,
                    const std::vector<std::vector<int>>& numbers, std::vector<Candidate>* out) {
  const std::vector<VehicleDetection>&earlier = frames[s].detections, &now = frames[t].detections;
  for (std::size_t i = 0; i < earlier.size(); ++i) {
    const int number = numbers[s][i];
    if (earlier[i].track >= 0) continue;
    if (t > s + 1) {  // it goes on in the frame between
      const std::vector<int>& between = numbers[t - 1];
      if (std::find(between.begin(), between.end(), number) != between.end()) continue;
    }
    const std::vector<Prediction> predicted = predictions(camera, frames[s], i, frames[t], gates);
    for (std::size_t j = 0; j < now.size(); ++j) {
      if (now[j].track >= 0 || now[j].vehicle_class != earlier[i].vehicle_class) continue;
      double overlap = 0.0;
      for (const Prediction& p : predicted) {
        overlap = std::max(overlap, p.weight * intersection_over_union(p.box, now[j].box));
      }
      if (overlap >= gates.overlap) out->push_back({overlap, number, j});
    }
  }
}

/// Gives detections of frame t the numbers of those of the last frames that they overlap best,
/// greedily: one that was not found in the frame before is a rival of one that was.
void join_frame(const PinholeCamera& camera, const std::vector<TrackFrame>& frames, std::size_t t,
                const AssociationGates& gates, std::vector<std::vector<int>>* numbers) {
  constexpr std::size_t kBack = 2;  // frames
  std::vector<Candidate> candidates;
  for (std::size_t back = 1; back <= kBack && back <= t; ++back) {
    add_candidates(camera, frames, t - back, t, gates, *numbers, &candidates);
  }
  std::stable_sort(candidates.begin(), candidates.end(),
                   [](const Candidate& a, const Candidate& b) { return a.overlap > b.overlap; });
  std::vector<int>& own = (*numbers)[t];
  for (const Candidate& c : candidates) {
    if (own[c.detection] >= 0) continue;
    if (std::find(own.begin(), own.end(), c.number) != own.end()) continue;
    own[c.detection] = c.number;
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
    join_frame(camera, frames, t, gates, &out);
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
