#include "camber/pipeline/stages/detail/scale_sources.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "camber/core/threads.h"
#include "camber/scale/camera_height_constraint.h"
#include "camber/scale/fusion.h"
#include "camber/scale/known_poses_constraint.h"
#include "camber/scale/speed_constraint.h"

namespace camber::stages::detail {

RoadPosterior prior_road(const PhotometricGround& ground, double metres_per_baseline,
                         const ScaleOptions& options) {
  const EgoPlane& ego = ground.ground.ego;
  return {ground.field ? ground.field : ground.ground.field,
          ground.motion.covariance,
          options.ground_inflation,
          {ego.plane, ego.shared_jacobian},
          metres_per_baseline,
          kOpenLogScale};
}

std::optional<TravelledPath> travelled_path(const LoadedFrames& frames,
                                            const MotionEstimate& motion) {
  TravelledPath out;
  const auto center = [&](std::size_t k) {
    return motion.frame_from_reference[k].inverse().translation();
  };
  for (std::size_t k = 0; k < frames.known.travelled.size(); ++k) {
    if (!frames.known.travelled[k]) continue;
    out.distance.metres += *frames.known.travelled[k];
    out.baselines += (center(k + 1) - center(k)).norm();
    ++out.stretches;
  }
  const DistanceSigma& sigma = frames.known.travelled_sigma;
  out.distance.sigma = sigma.together();
  out.distance.common = sigma.common;
  if (!(out.distance.sigma > 0.0) || !shows_motion(out.distance) || !(out.baselines > 0.0)) {
    return std::nullopt;
  }
  return out;
}

std::optional<Constraint> measure_speed(const RoadPosterior& road, const LoadedFrames& frames,
                                        const MotionEstimate& motion, const ScaleNoise& noise) {
  const auto path = travelled_path(frames, motion);
  if (!path) return std::nullopt;
  return speed_constraint(road, path->distance, path->baselines, path->stretches, noise.speed_path);
}

std::optional<Constraint> measure_positions(const RoadPosterior& road, const LoadedFrames& frames,
                                            const MotionEstimate& motion, const ScaleNoise& noise) {
  if (frames.contradicted_poses.empty() || frames.poses_of_other_moments) return std::nullopt;
  double metres = 0.0, baselines = 0.0;
  for (std::size_t k = 1; k < frames.size(); ++k) {
    const auto step = [](const SE3& before, const SE3& after) {
      return (after.translation() - before.translation()).norm();
    };
    metres += step(*frames.frames[k - 1].world_from_camera, *frames.frames[k].world_from_camera);
    baselines += step(motion.frame_from_reference[k - 1].inverse(),
                      motion.frame_from_reference[k].inverse());
  }
  std::optional<Constraint> out = speed_constraint(
      road,
      {metres, std::hypot(KnownPoseOptions().translation_sigma, noise.contradicted_path * metres)},
      baselines, static_cast<int>(frames.size()) - 1, noise.speed_path);
  if (!out) return out;
  out->name = "known_poses";
  out->source = "positions alone, " + out->source;
  return out;
}

std::vector<Constraint> anchors(const RoadPosterior& road, const LoadedFrames& frames,
                                const MotionEstimate& motion, const ScaleNoise& noise) {
  std::vector<Constraint> out;
  if (motion.metres_per_baseline) {
    out.push_back(known_poses_constraint(road, *motion.metres_per_baseline, motion.baseline_sigma));
  } else if (frames.known.camera_height) {
    out.push_back(camera_height_constraint(road, *frames.known.camera_height,
                                           frames.known.camera_height_sigma));
  } else if (auto positions = measure_positions(road, frames, motion, noise)) {
    out.push_back(std::move(*positions));
  } else if (auto speed = measure_speed(road, frames, motion, noise)) {
    out.push_back(std::move(*speed));
  } else {
    out.push_back(camera_height_constraint(road, noise.unknown_camera_height,
                                           noise.unknown_camera_height_sigma));
    out.back().source = "not given: " + out.back().source;
  }
  return out;
}

GroundRaster ground_raster(const LoadedFrames& frames, const Correspondences& matches,
                           const Ground& ground, const RoadPosterior& road, int num_threads) {
  GroundRaster out;
  out.top = std::max(0, static_cast<int>(road.top()) + 1);
  const int width = frames.camera.width, height = frames.camera.height;
  const auto stored = static_cast<std::size_t>(width) * static_cast<std::size_t>(height - out.top);
  out.inverse_depth.resize(stored);
  parallel_for(static_cast<std::size_t>(height - out.top), num_threads, [&](std::size_t row) {
    road.inverse_depths(out.top + static_cast<double>(row), width,
                        &out.inverse_depth[row * static_cast<std::size_t>(width)]);
  });
  // Near ground, since masks have holes where there is paint.
  constexpr int kReach = 10;  // px
  std::vector<std::uint8_t> seen = ground_pixels(frames, matches, ground);
  cv::Mat grown;
  cv::dilate(cv::Mat(height, width, CV_8UC1, seen.data()), grown,
             cv::getStructuringElement(cv::MORPH_RECT, {2 * kReach + 1, 2 * kReach + 1}));
  const std::vector<std::uint8_t>& vehicle = frames.reference_masks().vehicle;
  out.visible.resize(stored);
  for (std::size_t i = 0, skipped = vehicle.size() - stored; i < stored; ++i) {
    out.visible[i] = grown.data[skipped + i] != 0 && vehicle[skipped + i] == 0;
  }
  return out;
}

namespace {

LaneMarkingConstraint measure_markings(const LoadedFrames& frames, const GroundRaster& raster,
                                       const Eigen::Vector3d& travel, const RoadPosterior& road,
                                       const ScaleOptions& options) {
  LaneMarkingConstraint out;
  out.constraint.name = "lane_markings";
  const LaneMarkingSizes& sizes = frames.known.markings;
  if (!options.use_markings) return out;
  if (!sizes.dashes() && !sizes.stripes()) {
    out.reason = "the scene gives no sizes of markings";
    return out;
  }
  const LaneMarkings found =
      detect_lane_markings(frames.gray[frames.reference], frames.camera, raster, travel, sizes,
                           road.scale_sigma(), options.num_threads);
  return lane_marking_constraint(road, frames.camera, found, sizes, options.noise);
}

/// The markings at other scales of the road than the given one: those of the scale at which the
/// most lengths fit.
FoundMarkings rescaled_markings(const LoadedFrames& frames, const GroundRaster& raster,
                                const Eigen::Vector3d& travel, const PhotometricGround& ground,
                                const RoadPosterior& given, const ScaleOptions& options) {
  constexpr std::array<double, 4> kFactors = {0.71, 0.84, 1.19, 1.41};
  constexpr double kBetween = 0.05;  // relative, standard deviation of the scale about a factor
  const double height = given.ego().plane.offset;
  ScaleOptions one_thread = options;
  one_thread.num_threads = 1;
  std::vector<FoundMarkings> found(kFactors.size(), {{}, given});
  parallel_for(kFactors.size(), options.num_threads, [&](std::size_t k) {
    const double factor = kFactors[k];
    const RoadPosterior prior = prior_road(ground, factor * given.metres_per_baseline(), options);
    found[k].linearised_at = prior.conditioned(
        camera_height_constraint(prior, factor * height, kBetween * factor * height));
    GroundRaster rescaled = raster;
    for (float& rho : rescaled.inverse_depth) rho *= static_cast<float>(1.0 / factor);
    found[k].markings =
        measure_markings(frames, rescaled, travel, found[k].linearised_at, one_thread);
  });
  return *std::max_element(found.begin(), found.end(),
                           [](const FoundMarkings& a, const FoundMarkings& b) {
                             return a.markings.constraint.size() < b.markings.constraint.size();
                           });
}

constexpr int kLine = 3;  // strokes of a broken line that are no chance

/// @return whether markings explain plainly more of the image than others: a stroke near the camera
/// has a length of its own besides its distance from the next.
bool explain_more(const LaneMarkingConstraint& markings, const LaneMarkingConstraint& than) {
  constexpr int kMoreLengths = 2;
  return markings.dashes >= kLine && markings.rows > than.rows &&
         markings.constraint.size() >= than.constraint.size() + kMoreLengths;
}

}  // namespace

FoundMarkings find_markings(const LoadedFrames& frames, const GroundRaster& raster,
                            const Eigen::Vector3d& travel, const PhotometricGround& ground,
                            const RoadPosterior& anchored, bool given,
                            const ScaleOptions& options) {
  FoundMarkings out{measure_markings(frames, raster, travel, anchored, options), anchored};
  if (out.markings.constraint.size() == 0) {
    // What they measure if the scale is not taken for known.
    LaneMarkingConstraint alone = measure_markings(
        frames, raster, travel, anchored.with_wider_scale(std::pow(options.noise.hardly_known, 2)),
        options);
    if (alone.constraint.size() > 0) out.markings = std::move(alone);
  }
  const bool fit = out.markings.dashes >= kLine && out.markings.misfit_before < 1.0;
  if (given && !fit && options.use_markings && frames.known.markings.dashes()) {
    FoundMarkings other = rescaled_markings(frames, raster, travel, ground, anchored, options);
    if (explain_more(other.markings, out.markings)) out = std::move(other);
  }
  return out;
}

RoadWidthConstraint measure_width(const LoadedFrames& frames, const GroundRaster& raster,
                                  const Eigen::Vector3d& travel, const RoadPosterior& road,
                                  const ScaleOptions& options) {
  RoadWidthConstraint out;
  out.constraint.name = "road_width";
  if (!options.use_road_width) return out;
  if (!frames.has_masks()) {
    out.reason = "no mask shows where the road ends";
    return out;
  }
  const FrameMasks& masks = frames.reference_masks();
  const RoadEdges edges =
      detect_road_edges(frames.gray[frames.reference], frames.camera, raster, masks.roadway,
                        masks.vehicle, travel, options.num_threads);
  return road_width_constraint(road, frames.camera, edges, options.noise);
}

}  // namespace camber::stages::detail
