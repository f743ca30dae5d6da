#include "camber/pipeline/stages/find_road.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "camber/core/errors.h"
#include "camber/pipeline/stages/fuse_masks.h"
#include "camber/pipeline/stages/motion.h"
#include "camber/pipeline/stages/passing_road.h"
#include "camber/pipeline/stages/reach.h"
#include "camber/pipeline/stages/road_layer.h"

namespace camber::stages {
namespace {

/// A road seen from one start.
struct Candidate {
  Correspondences matches;
  MotionEstimate motion;
  Ground ground;
  FrameMasks masks;        // of the reference, that belong to it
  double agreement = 0.0;  // see road_agreement
};

/// Agreement below which a masked road is also looked for elsewhere: rendered roads that are right
/// have 0.39 and more, nineteen of twenty 0.65 (even numbers). Without a mask it is not known how
/// much of the road there is to be found.
constexpr double kPlainAgreement = 0.65;
/// Support of a road in place of the first: so much, and by so much more. From other starts the
/// same road has up to 1.16 times as much, the right one in place of a wrong one 1.3 to 7 times.
constexpr double kLeastAgreement = 0.3, kPlainlyMore = 1.2;
/// Share of its agreement from which on another road may be as right.
constexpr double kAsMuch = 0.95;

/// Whether the near road may be another one than that seen.
bool is_doubtful(const PlaneSearchResult& search, const LoadedFrames& frames, double agreement) {
  return search.ambiguous || (frames.has_masks() && agreement < kPlainAgreement);
}

/// What the plane search found, but for what the first ground began with.
std::vector<RoadHypothesis> other_starts(const PlaneSearchResult& search) {
  std::vector<RoadHypothesis> out = search.others;
  if (!search.informative && search.samples > 0) out.insert(out.begin(), search.best);
  return out;
}

/// The first road, or one on which plainly more agrees.
Candidate& best_of(std::vector<Candidate>& roads) {
  Candidate* best = &roads.front();
  for (Candidate& road : roads) {
    if (road.agreement > std::max(kLeastAgreement, kPlainlyMore * best->agreement)) best = &road;
  }
  return *best;
}

/// See Ground::alternative_spread.
double spread_about(const Candidate& best, const std::vector<Candidate>& roads) {
  const auto log_height = [](const Candidate& road) { return std::log(road.ground.ego.height); };
  double out = 0.0;
  if (!(best.agreement > 0.0)) return out;  // of none is known how right it is
  for (const Candidate& road : roads) {
    if (road.agreement < kAsMuch * best.agreement) continue;
    out = std::max(out, std::abs(log_height(road) - log_height(best)));
  }
  return out;
}

/// Rounds of match, motion and ground: each matches again with the ground of the one before.
void match_in_rounds(LoadedFrames& frames, Candidate& road, const FindRoadOptions& o,
                     const StageRunner& run) {
  constexpr double kSettledPx = 1.5;
  Correspondences& matches = road.matches;
  MotionEstimate& motion = road.motion;
  Ground& ground = road.ground;
  for (int round = 0; round < o.rounds; ++round) {
    const double share = 0.5 + 0.3 * (round + 1.0) / o.rounds;
    // Without masks the road is to be found first, for which a coarse flow is smoother.
    const bool fine = frames.has_masks() || round > 0 || o.rounds == 1;
    matches = run("correspondences", share,
                  [&] { return match_again(frames, matches, motion, ground, fine, o.match); });
    motion = run("motion", share, [&] { return motion_again(frames, matches, motion, o.motion); });
    GroundPoints points = run("triangulation", share, [&] {
      GroundPoints triangulated = triangulate(frames, matches, motion, &ground.seen, o.ground);
      fuse_masks(matches, motion, ground, &frames, &triangulated);
      return triangulated;
    });
    const std::shared_ptr<const GroundField> before = ground.field;
    ground = run("ground", share, [&] {
      return stages::ground(frames, matches, motion, std::move(points), ground, o.ground);
    });
    if (fine && prediction_change(frames, matches, motion, *before, ground) < kSettledPx) break;
  }
}

/// The road on which the most matches agree, from all starts that may be right.
Candidate road_of_matches(LoadedFrames& frames, const Correspondences& matches,
                          const MotionEstimate& motion, const FindRoadOptions& o,
                          const StageRunner& run) {
  const GroundPoints points = run("triangulation", 0.4, [&] {
    return triangulate(frames, matches, motion, nullptr, o.ground);
  });
  // Without another round nothing would take the place of the search's plane.
  const PlaneSearchResult search = run("ground", 0.5, [&] {
    return o.rounds > 0 ? search_plane(frames, motion, o.ground) : PlaneSearchResult();
  });
  const FrameMasks masks = frames.reference_masks();
  const auto see_from = [&](const std::optional<RoadHypothesis>& start) {
    frames.masks[frames.reference] = masks;
    Ground ground = run("ground", 0.5, [&] {
      Ground first = first_ground(frames, matches, motion, points, search, o.ground, start);
      fuse_masks(matches, motion, first, &frames, &first.seen);
      return first;
    });
    Candidate road{matches, motion, std::move(ground), {}, 0.0};
    match_in_rounds(frames, road, o, run);
    road.masks = frames.reference_masks();
    road.agreement = road_agreement(road.ground);
    return road;
  };
  std::vector<Candidate> roads;
  roads.push_back(see_from(std::nullopt));
  if (is_doubtful(search, frames, roads.front().agreement)) {
    for (const RoadHypothesis& start : other_starts(search)) {
      try {
        roads.push_back(see_from(start));
      } catch (const NoAnswerError&) {
        continue;  // no road there
      }
    }
  }
  Candidate& best = best_of(roads);
  best.ground.alternative_spread = spread_about(best, roads);
  frames.masks[frames.reference] = best.masks;
  return std::move(best);
}

}  // namespace

FoundRoad find_road(const Scene& scene, LoadedFrames frames, const FindRoadOptions& o,
                    const StageRunner& run) {
  Correspondences matches = run("correspondences", 0.1, [&] { return match(frames, o.match); });
  const auto keep_only = [&](const FrameRange& range) {
    if (range.size() == frames.size()) return false;
    matches = matches_within(range, std::move(matches));
    frames = frames_within(range, scene, std::move(frames));
    return true;
  };
  const auto find_motion = [&] {
    return run("motion", 0.3, [&] { return stages::motion(frames, matches, o.motion); });
  };
  run("motion", 0.2, [&] { check_poses(matches, o.motion, &frames); });
  keep_only(frames_that_share(frames, matches));
  MotionEstimate motion = find_motion();
  while (keep_only(frames_that_agree(frames, matches, motion, o.motion))) motion = find_motion();
  check_turns(scene, motion, &frames);
  const auto passing = [&](const Correspondences& matched, const MotionEstimate& moved,
                           const Ground* found) {
    return run("ground", 0.75, [&]() -> std::optional<Ground> {
      if (found && !repeats_road(frames, moved)) return std::nullopt;
      const auto sweep = sweep_road(frames, moved, o.ground.num_threads);
      const bool by_speed = found || repeats_road(frames, moved);
      return another_ground(frames, matched, moved, found, sweep, by_speed, o.ground);
    });
  };
  const FrameMasks masks = frames.reference_masks();
  try {
    Candidate road = road_of_matches(frames, matches, motion, o, run);
    if (auto other = passing(road.matches, road.motion, &road.ground)) {
      road.ground = std::move(*other);
    }
    return {std::move(frames), std::move(road.matches), std::move(road.motion),
            std::move(road.ground)};
  } catch (const NoAnswerError&) {
    frames.masks[frames.reference] = masks;
    auto other = passing(matches, motion, nullptr);
    if (!other) throw;
    return {std::move(frames), std::move(matches), std::move(motion), std::move(*other)};
  }
}

FoundRoad find_road(const Scene& scene, LoadedFrames frames, const FindRoadOptions& options) {
  Timings timings;
  const Progress progress;
  return find_road(scene, std::move(frames), options, StageRunner(timings, progress));
}

FoundRoad find_road_from(FoundRoad start, const FindRoadOptions& options, const StageRunner& run) {
  Candidate road{std::move(start.matches), std::move(start.motion), std::move(start.ground), {}, 0};
  match_in_rounds(start.frames, road, options, run);
  return {std::move(start.frames), std::move(road.matches), std::move(road.motion),
          std::move(road.ground)};
}

}  // namespace camber::stages
