#include "camber/pipeline/stages/scale.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "camber/pipeline/stages/detail/ground_steps.h"
#include "camber/pipeline/stages/detail/scale_checks.h"
#include "camber/pipeline/stages/detail/scale_sources.h"
#include "camber/scale/camera_height_constraint.h"
#include "camber/scale/fusion.h"
#include "camber/scale/passing_road_constraint.h"

namespace camber::stages {
namespace {

Constraint all_of(const std::vector<Constraint>& constraints) {
  std::vector<const Constraint*> parts;
  for (const Constraint& c : constraints) parts.push_back(&c);
  return stacked(parts);
}

/// The sources that nothing was measured by keep their reason.
void set_reason(const std::string& name, const std::string& reason,
                std::vector<ConstraintReport>* reports) {
  for (ConstraintReport& report : *reports) {
    if (report.name == name && !report.accepted && report.reason.empty()) report.reason = reason;
  }
}

/// Fuses all sources, of which the first gives the metres. Where markings, or a height beside
/// poses, contradict it nobody knows which is wrong: the given metres stand, and the contradiction
/// is left to widen the scale.
FusedRoad fuse_with_given_metres(const RoadPosterior& prior, std::vector<Constraint> constraints) {
  constexpr std::size_t kGiven = 0;
  std::vector<ConstraintReport> contradicting(constraints.size());
  FusedRoad fused = fuse(prior, constraints);
  while (!fused.reports[kGiven].accepted) {
    std::size_t farthest = kGiven;
    for (std::size_t i = kGiven + 1; i < constraints.size(); ++i) {
      const Constraint& c = constraints[i];
      if (c.size() == 0 || (c.name != "lane_markings" && c.name != "camera_height")) continue;
      if (farthest == kGiven ||
          fused.reports[i].residual_sigma > fused.reports[farthest].residual_sigma) {
        farthest = i;
      }
    }
    if (farthest == kGiven) break;
    ConstraintReport& report = contradicting[farthest];
    report = fused.reports[farthest];
    report.residual_sigma = fused.reports[kGiven].residual_sigma;
    report.accepted = false;
    report.reason =
        fmt::format("{:.1f} standard deviations off the given metres", report.residual_sigma);
    Constraint none;
    none.name = constraints[farthest].name;
    none.source = constraints[farthest].source;
    constraints[farthest] = std::move(none);
    fused = fuse(prior, constraints);
  }
  for (std::size_t i = 0; i < constraints.size(); ++i) {
    if (!contradicting[i].reason.empty()) fused.reports[i] = std::move(contradicting[i]);
  }
  return fused;
}

/// Markings of known sizes may be there and yet not give the metres.
std::string why_up_to_scale(const LoadedFrames& frames, const LaneMarkingConstraint& markings) {
  const LaneMarkingSizes& sizes = frames.known.markings;
  if ((!sizes.dashes() && !sizes.stripes()) || markings.reason.empty()) {
    return "no source of metres";
  }
  return "no source of metres but lane markings: " + markings.reason;
}

/// How the scale follows the focal length: as the source that gives the metres, and as the dashes
/// of broken lines, lengths along the road, by the share that they have in what is known. A
/// crossing is measured across, and its share in the markings is not told from the dashes'.
double scale_by_focal(const RoadPosterior& prior, const std::vector<Constraint>& constraints,
                      const FusedRoad& fused, const LaneMarkingConstraint& markings) {
  const bool across = constraints.front().name == "camera_height";
  if (!across) return 0.0;
  if (markings.dashes == 0 || markings.crossings > 0) return 1.0;
  std::vector<const Constraint*> others;
  for (std::size_t i = 0; i < constraints.size(); ++i) {
    if (!fused.reports[i].accepted) continue;
    if (constraints[i].name != "lane_markings") others.push_back(&constraints[i]);
  }
  const double without = prior.conditioned(stacked(others)).scale_sigma();
  const double with = fused.road.scale_sigma();
  return std::min(1.0, (with * with) / (without * without));
}

bool accepted(const std::vector<ConstraintReport>& reports, const std::string& name) {
  return std::any_of(reports.begin(), reports.end(),
                     [&](const ConstraintReport& r) { return r.name == name && r.accepted; });
}

}  // namespace

ScaledRoad scale(const LoadedFrames& frames, const Correspondences& matches,
                 const PhotometricGround& ground, const ScaleOptions& options) {
  if (ground.ground.near_road == NearRoadSource::kMatches) detail::require_seen(ground.ground.ego);
  const Eigen::Vector3d travel = travel_direction(ground.motion, frames.reference);
  const bool given = ground.motion.metres_per_baseline || frames.known.camera_height;
  const double start = ground.ground.metres_per_baseline;
  // A guessed scale hides markings: with that of the first ones found, or of the speed, more are.
  constexpr int kMostRounds = 3;
  double m = start;
  for (int round = 0;; ++round) {
    const RoadPosterior prior = detail::prior_road(ground, m, options);
    std::vector<Constraint> constraints =
        detail::anchors(prior, frames, ground.motion, options.noise);
    const bool by_path = !given && constraints.front().name != "camera_height";
    const bool guessed = !given && !by_path;
    const RoadPosterior anchored = prior.conditioned(all_of(constraints));
    const GroundRaster raster =
        detail::ground_raster(frames, matches, ground.ground, anchored, options.num_threads);
    auto [markings, linearised_at] =
        detail::find_markings(frames, raster, travel, ground, anchored, given, options);
    RoadWidthConstraint width = detail::measure_width(frames, raster, travel, anchored, options);
    constraints.push_back(prior.relinearised(markings.constraint, linearised_at));
    constraints.push_back(prior.relinearised(width.constraint, anchored));
    if (ground.ground.passing && ground.ground.near_road != NearRoadSource::kPassing) {
      constraints.push_back(passing_road_constraint(prior, ground.ground.passing->log_baseline));
    }
    if (ground.motion.metres_per_baseline && frames.known.camera_height) {
      constraints.push_back(camera_height_constraint(prior, *frames.known.camera_height,
                                                     frames.known.camera_height_sigma));
    }
    if (given) {
      for (auto* measure : {&detail::measure_positions, &detail::measure_speed}) {
        // A speed counts once.
        const bool used = ground.ground.near_road == NearRoadSource::kSpeed;
        if (used && measure == &detail::measure_speed) continue;
        auto path = (*measure)(prior, frames, ground.motion, options.noise);
        if (path) constraints.push_back(std::move(*path));
      }
    }
    FusedRoad fused =
        guessed ? fuse(prior, constraints) : fuse_with_given_metres(prior, constraints);
    const double change = std::log(fused.road.metres_per_baseline() / m);
    const bool moved = by_path || (guessed && accepted(fused.reports, "lane_markings"));
    if (moved && std::abs(change) >= 0.02 && round + 1 < kMostRounds) {
      m *= std::exp(change);
      continue;
    }
    const double sigma = fused.road.scale_sigma();
    const bool metric = !guessed || (accepted(fused.reports, "lane_markings") &&
                                     sigma <= options.noise.metric_limit);
    const double by_focal = scale_by_focal(prior, constraints, fused, markings);
    if (!metric) {
      // Lengths in nominal heights of the camera; only what does not depend on metres is used.
      if (accepted(fused.reports, "lane_markings")) {
        markings.reason =
            fmt::format("they measure the scale to {:.1f} % only, so the result stays up to scale",
                        100.0 * sigma);
      }
      const RoadPosterior nominal = detail::prior_road(ground, start, options);
      Constraint height = camera_height_constraint(nominal, options.noise.unknown_camera_height,
                                                   KnownMetres().camera_height_sigma);
      height.common.clear();  // it is a unit
      std::vector<ConstraintReport> reports = fused.reports;
      fused = fuse(nominal, {height, nominal.relinearised(width.constraint, anchored)});
      for (ConstraintReport& report : reports) {
        if (report.name != "road_width") report.accepted = false;
      }
      set_reason("camera_height", "not given", &reports);
      fused.reports = std::move(reports);
    }
    set_reason("lane_markings", markings.reason, &fused.reports);
    set_reason("road_width", width.reason, &fused.reports);
    const double scale_change = std::log(fused.road.metres_per_baseline() / start);
    ScaledRoad out{
        std::move(fused.road), metric,      std::move(fused.reports), {}, std::move(markings),
        std::move(width),      scale_change};
    out.near_road = ground.ground.near_road;
    out.scale_by_focal = metric ? by_focal : 1.0;
    if (!metric) out.without_metres = why_up_to_scale(frames, out.markings);
    detail::add_sources(prior, constraints, options.noise, &out);
    if (metric) detail::add_checks(frames, matches, ground, raster, travel, options, &out);
    return out;
  }
}

}  // namespace camber::stages
