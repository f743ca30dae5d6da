#include "camber/pipeline/estimate_window.h"

#include <cmath>
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
  JudgedRoad judged = run("scale", 0.97, [&] {
    std::optional<RoadLayer> layer;  // what passes knows it better than the matches' shares
    if (!refined.ground.passing ||
        stages::shows_another(*refined.ground.passing, refined.ground.ego)) {
      layer = stages::road_layer(road.frames, road.matches, refined,
                                 scaled.road.metres_per_baseline(), o.num_threads);
    }
    return stages::judge(scaled, layer, vehicles, {o.scale.noise});
  });
  return {std::move(refined), std::move(scaled), std::move(plan), std::move(vehicles),
          std::move(judged)};
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

/// The same with what passes on the road: another ground where it shows one, else a measurement of
/// this one's.
/// @return none where nothing passes that was not looked at before.
std::optional<PhotometricGround> by_what_passes(const FoundRoad& road,
                                                const PhotometricGround& refined,
                                                const ReconstructOptions& o,
                                                const StageRunner& run) {
  if (refined.ground.by_what_passes) return std::nullopt;
  std::optional<RoadSweepResult> sweep = refined.ground.passing;
  const bool known = sweep.has_value();
  if (!known) {
    sweep = run("ground", 0.97,
                [&] { return stages::sweep_road(road.frames, refined.motion, o.num_threads); });
  }
  if (!sweep) return std::nullopt;
  if (stages::shows_another(*sweep, refined.ground.ego)) {
    return run("ground", 0.97, [&] {
      return PhotometricGround{
          stages::passing_ground(road.frames, road.matches, refined.motion, *sweep, o.ground),
          refined.motion,
          nullptr,
          {},
          {},
          {}};
    });
  }
  if (known) return std::nullopt;
  PhotometricGround out = refined;
  out.ground.passing = sweep;
  return out;
}

MeasuredGround measure_with_doubts(const FoundRoad& road, const PhotometricGround& refined,
                                   const ReconstructOptions& o, const StageRunner& run) {
  std::optional<MeasuredGround> first;
  try {
    first = measure(road, refined, o, run);
    if (!is_doubtful(road.frames, *first)) return std::move(*first);
  } catch (const UnknownScaleError&) {
    auto other = by_what_passes(road, refined, o, run);
    if (!other) throw;
    return measure(road, std::move(*other), o, run);
  }
  auto other = by_what_passes(road, refined, o, run);
  if (!other) return std::move(*first);
  try {
    return measure(road, std::move(*other), o, run);
  } catch (const NoAnswerError&) {
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
    if (road.ground.by_what_passes) return out;
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
