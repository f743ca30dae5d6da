#include "camber/pipeline/estimate_window.h"

#include <cmath>
#include <exception>
#include <optional>
#include <utility>

#include "camber/core/errors.h"
#include "camber/pipeline/stages/passing_road.h"
#include "camber/scale/passing_road_constraint.h"

namespace camber {

ReconstructOptions handed_down(const ReconstructOptions& options) {
  ReconstructOptions out = options;
  out.motion.seed = options.seed;
  out.vehicles.enabled = options.vehicles.enabled;
  out.surface.under_vehicles =
      options.vehicles.enabled && options.vehicles.method == VehicleMethod::kJoint;
  out.vehicles.noise = options.scale.noise;
  for (int* threads : {&out.load.num_threads, &out.match.flow.num_threads, &out.motion.num_threads,
                       &out.ground.num_threads, &out.scale.num_threads, &out.surface.num_threads,
                       &out.vehicles.num_threads}) {
    *threads = options.num_threads;
  }
  return out;
}

namespace {

/// What is measured on a ground.
struct MeasuredGround {
  PhotometricGround refined;
  ScaledRoad scaled;
  SurfacePlan plan;
  PlacedVehicles vehicles;
  std::optional<RoadLayer> layer;
  JudgedRoad judged;
};

MeasuredGround measure(const FoundRoad& road, PhotometricGround refined,
                       const ReconstructOptions& o, const StageRunner& run) {
  ScaledRoad scaled = run(
      "scale", 0.83, [&] { return stages::scale(road.frames, road.matches, refined, o.scale); });
  SurfacePlan plan = run("surface", 0.85, [&] {
    return stages::surface(road.frames, road.matches, refined.motion, refined.ground, scaled.road,
                           o.surface);
  });
  PlacedVehicles vehicles = run("vehicles", 0.9, [&] {
    return stages::vehicles(road.frames, refined.motion, scaled, plan, o.vehicles);
  });
  std::optional<RoadLayer> layer;  // what passes knows it better than the matches' shares
  JudgedRoad judged = run("scale", 0.97, [&] {
    const Ground& ground = refined.ground;
    if (ground.near_road == NearRoadSource::kMatches &&
        (!ground.passing || stages::shows_another(ground.passing->log_baseline, ground.ego))) {
      layer = stages::road_layer(road.frames, road.matches, refined,
                                 scaled.road.metres_per_baseline(), o.num_threads);
    }
    return stages::judge(scaled, layer, vehicles, {o.scale.noise});
  });
  return {std::move(refined),  std::move(scaled), std::move(plan),
          std::move(vehicles), std::move(layer),  std::move(judged)};
}

/// Whether the road may be another layer: its scale is known worse than what passes measures it.
bool is_doubtful(const LoadedFrames& frames, const MeasuredGround& measured) {
  constexpr double kWorse = 2.0 * kSweptHeight;
  if (!measured.judged.metric || !frames.known.camera_height ||
      measured.refined.motion.metres_per_baseline) {
    return false;
  }
  const double given = frames.known.camera_height_sigma / *frames.known.camera_height;
  return std::pow(measured.judged.scale.sigma, 2) - given * given > kWorse * kWorse;
}

/// Whether the layer that was found may well be none that one drives on, and a given speed can show
/// another.
bool may_be_another(const FoundRoad& road, const MeasuredGround& measured) {
  constexpr double kOdds = 0.05 / 0.95;
  return measured.layer &&
         (measured.layer->repeated || measured.layer->log_odds() > std::log(kOdds)) &&
         stages::log_baseline_by_speed(road.frames, measured.refined.motion);
}

/// The same by what passes on the road and by the given speed: another ground where they show one,
/// else what passes as a measurement of this one's.
/// @param layer  whether it is the layer that is in doubt: then a speed alone shows another.
/// @return none without a new measurement.
std::optional<PhotometricGround> by_other_sources(const FoundRoad& road,
                                                  const PhotometricGround& refined, bool layer,
                                                  const ReconstructOptions& o,
                                                  const StageRunner& run) {
  if (refined.ground.near_road != NearRoadSource::kMatches) return std::nullopt;
  return run("ground", 0.97, [&]() -> std::optional<PhotometricGround> {
    std::optional<RoadSweepResult> sweep = refined.ground.passing;
    const bool known = sweep.has_value();
    if (!known) sweep = stages::sweep_road(road.frames, refined.motion, o.num_threads);
    if (auto other = stages::another_ground(road.frames, road.matches, refined.motion,
                                            &refined.ground, sweep, layer, o.ground)) {
      return PhotometricGround{std::move(*other), refined.motion, nullptr, {}, {}, {}};
    }
    if (known || !sweep) return std::nullopt;
    PhotometricGround out = refined;
    out.ground.passing = sweep;
    return out;
  });
}

MeasuredGround measure_with_doubts(const FoundRoad& road, const PhotometricGround& refined,
                                   const ReconstructOptions& o, const StageRunner& run) {
  std::optional<MeasuredGround> first;
  std::exception_ptr unknown;
  bool layer = true;
  try {
    first = measure(road, refined, o, run);
    layer = may_be_another(road, *first);
    if (!layer && !is_doubtful(road.frames, *first)) return std::move(*first);
  } catch (const UnknownScaleError&) {
    unknown = std::current_exception();
  }
  auto other = by_other_sources(road, refined, layer, o, run);
  if (!other) {
    if (!first) std::rethrow_exception(unknown);
    return std::move(*first);
  }
  try {
    return measure(road, std::move(*other), o, run);
  } catch (const NoAnswerError&) {
    if (!first) throw;
    return std::move(*first);
  }
}

}  // namespace

WindowEstimate estimate_window(const Scene& scene, LoadedFrames frames,
                               const ReconstructOptions& options, const StageRunner& run) {
  ReconstructOptions o = options;
  if (frames.box_sigma_px) o.vehicles.fit.noise.box.pixel_sigma = *frames.box_sigma_px;
  FoundRoad road =
      stages::find_road(scene, std::move(frames), {o.rounds, o.match, o.motion, o.ground}, run);
  PhotometricGround refined = run("ground", 0.8, [&] {
    PhotometricGround out{road.ground, road.motion, nullptr, {}, {}, {}};
    if (road.ground.near_road != NearRoadSource::kMatches) return out;
    if (o.photometric) {
      out = stages::refine_photometrically(road.frames, road.matches, road.motion, road.ground,
                                           o.ground);
    }
    if (o.sweep_road) {
      out.ground.passing = stages::sweep_road(road.frames, out.motion, o.num_threads);
    }
    return out;
  });
  MeasuredGround measured = measure_with_doubts(road, refined, o, run);
  AssembledRoad assembled = run("surface", 0.98, [&] {
    return stages::assemble(road.frames, road.matches, measured.refined, measured.scaled,
                            measured.plan, measured.vehicles, measured.judged, o.vehicles.method,
                            {o.num_threads, o.scale.noise});
  });
  return {std::move(road),          std::move(measured.refined),  std::move(measured.scaled),
          std::move(measured.plan), std::move(measured.vehicles), std::move(measured.judged),
          std::move(assembled)};
}

}  // namespace camber
