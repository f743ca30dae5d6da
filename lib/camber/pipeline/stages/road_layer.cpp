#include "camber/pipeline/stages/road_layer.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <vector>

#include "camber/core/median.h"
#include "camber/motion/triangulation.h"
#include "camber/pipeline/stages/motion.h"
#include "camber/pipeline/stages/passing_road.h"

namespace camber {

double RoadLayer::log_odds() const {
  constexpr double kNothingShowsOne = -4.0;
  double out = kNothingShowsOne + 8.0 * (1.0 - agreeing) + 8.0 * off_road + 80.0 * obstacles;
  if (!masked) return out;
  out += 6.15 * (1.0 - found);
  if (search == Search::kAmbiguous) out += 1.85;
  if (search == Search::kInformative) out -= 0.92;
  return out;
}

ScaleEvidence evidence_of(const RoadLayer& layer) {
  ScaleEvidence out =
      evidence_of("road_layer",
                  fmt::format("{:.0f} % of the {} is found, {:.0f} % of that agrees near the path",
                              100.0 * layer.found, layer.masked ? "masked road" : "road that grew",
                              100.0 * layer.agreeing),
                  0.0, std::numeric_limits<double>::quiet_NaN());
  out.wrong_share = 1.0 / (1.0 + std::exp(-layer.log_odds()));
  out.measured = {{"found", layer.found},
                  {"agreeing", layer.agreeing},
                  {"off_road", layer.off_road},
                  {"obstacles", layer.obstacles},
                  {"alternative_spread", layer.alternative_spread},
                  {"masked", layer.masked ? 1.0 : 0.0},
                  {"posed", layer.posed ? 1.0 : 0.0},
                  {"search", static_cast<double>(layer.search)},
                  {"repeated", layer.repeated ? 1.0 : 0.0}};
  return out;
}

namespace stages {
namespace {

/// A point over the driven path, camera heights.
struct PathPlace {
  double ahead, up;  ///< up: over the ego plane
};

/// @param half_width  of the path, unit of the points.
std::vector<PathPlace> over_path(const EgoPlane& ego, const TriangulatedPoints& points,
                                 double half_width) {
  std::vector<PathPlace> out;
  const std::vector<Eigen::Vector3d>& line = ego.line;
  if (line.size() < 2) return out;
  const Eigen::Vector3d up = ego.plane.plane.normal;
  const Eigen::Vector3d forward = ego.plane.axis1, right = forward.cross(up);
  const double step = forward.dot(line[1] - line[0]);
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Eigen::Vector3d p = points.point(i);
    const double at = forward.dot(p) / step;
    if (!(at > 0.0) || !(at < static_cast<double>(line.size() - 1))) continue;
    const Eigen::Vector3d off = p - line[static_cast<std::size_t>(std::lround(at))];
    if (std::abs(right.dot(off)) < half_width) {
      out.push_back({forward.dot(p) / ego.height, 1.0 + up.dot(p) / ego.height});
    }
  }
  return out;
}

/// See RoadLayer::off_road.
double off_road_share(const Ground& ground, double metres_per_baseline) {
  constexpr double kHalfWidth = 1.2;                  // m
  constexpr double kOff = 0.15, kBelowCamera = 0.95;  // camera heights
  constexpr double kPastMiddle = 1.5;  // of the distance to the middle one of the road's points
  constexpr std::size_t kFewest = 50;  // matches
  const EgoPlane& ego = ground.ego;
  const double half_width = kHalfWidth / metres_per_baseline;
  const std::vector<PathPlace> road = over_path(ego, ground.seen.points, half_width);
  std::vector<double> ahead;  // of the road; where the path shows hardly any, also beside it
  if (road.size() >= kFewest) {
    for (const PathPlace& p : road) ahead.push_back(p.ahead);
  } else {
    const Eigen::Vector3d forward = ego.plane.axis1;
    for (std::size_t i = 0; i < ground.seen.points.size(); ++i) {
      ahead.push_back(forward.dot(ground.seen.points.point(i)) / ego.height);
    }
  }
  const double reach = ahead.empty() ? 0.0 : kPastMiddle * upper_median(&ahead);
  const std::vector<PathPlace> others = over_path(ego, ground.seen.others, half_width);
  const auto contesting =
      static_cast<std::size_t>(std::count_if(others.begin(), others.end(), [&](const PathPlace& p) {
        return p.ahead < reach && std::abs(p.up) > kOff && p.up < kBelowCamera;
      }));
  const std::size_t all = contesting + road.size();
  return all < kFewest ? 0.0 : static_cast<double>(contesting) / static_cast<double>(all);
}

/// See RoadLayer::obstacles.
double obstacle_share(const LoadedFrames& frames, const Correspondences& matches,
                      const PhotometricGround& ground, double metres_per_baseline,
                      int num_threads) {
  constexpr std::size_t kStride = 4, kFewest = 200;    // matches
  constexpr double kHalfWidth = 0.8, kFarthest = 6.0;  // m
  constexpr double kLowest = 0.2, kHighest = 1.2;      // camera heights over the road
  const std::vector<std::uint8_t> still = static_points(frames, matches);
  const std::vector<std::uint8_t>& road = frames.reference_masks().ground_near;
  std::vector<std::uint8_t> wanted(still.size(), 0);
  for (std::size_t i = 0; i < wanted.size(); i += kStride) {
    wanted[i] = still[i] && !road[matches.image_index(i, frames.camera.width)];
  }
  TriangulationOptions options;
  options.with_pose_jacobian = false;
  options.num_threads = num_threads;
  const TriangulatedPoints points =
      triangulate(frames.camera, matches, ground.motion, wanted, options);
  if (points.size() < kFewest) return 0.0;
  const EgoPlane& ego = ground.ground.ego;
  const std::vector<PathPlace> places = over_path(ego, points, kHalfWidth / metres_per_baseline);
  const double reach = kFarthest / (metres_per_baseline * ego.height);
  const auto obstacles = std::count_if(places.begin(), places.end(), [&](const PathPlace& p) {
    return p.ahead < reach && p.up > kLowest && p.up < kHighest;
  });
  return static_cast<double>(obstacles) / static_cast<double>(points.size());
}

double agreeing_share(const EgoPlane& ego) {
  return ego.compared > 0 ? static_cast<double>(ego.points) / ego.compared : 1.0;
}

}  // namespace

RoadLayer road_layer(const LoadedFrames& frames, const Correspondences& matches,
                     const PhotometricGround& ground, double metres_per_baseline, int num_threads) {
  const Ground& road = ground.ground;
  RoadLayer out;
  out.masked = frames.has_masks();
  out.posed = ground.motion.metres_per_baseline.has_value();
  out.search = road.search.ambiguous     ? RoadLayer::Search::kAmbiguous
               : road.search.informative ? RoadLayer::Search::kInformative
                                         : RoadLayer::Search::kNone;
  out.found = found_share(road.seen);
  out.agreeing = std::min(agreeing_share(road.ego), ground.agreeing_before);
  out.alternative_spread = road.alternative_spread;
  out.repeated = repeats_road(frames, ground.motion);
  if (out.posed) return out;
  out.off_road = off_road_share(road, metres_per_baseline);
  if (out.masked) {
    out.obstacles = obstacle_share(frames, matches, ground, metres_per_baseline, num_threads);
  }
  return out;
}

double found_share(const GroundPoints& seen) {
  const auto found = static_cast<double>(seen.points.size());
  const auto dropped = static_cast<double>(
      std::accumulate(seen.points.dropped.begin(), seen.points.dropped.end(), 0L));
  return found + dropped > 0.0 ? found / (found + dropped) : 0.0;
}

double road_agreement(const Ground& ground) {
  return ground.ego.compared > 0 ? found_share(ground.seen) * agreeing_share(ground.ego) : 0.0;
}

}  // namespace stages
}  // namespace camber
