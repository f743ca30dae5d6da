#include "camber/pipeline/stages/passing_road.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "camber/image/still_share.h"
#include "camber/pipeline/near_parallax.h"
#include "camber/pipeline/stages/detail/ground_steps.h"
#include "camber/pipeline/stages/detail/scale_sources.h"
#include "camber/scale/passing_road_constraint.h"

namespace camber::stages {
namespace {

constexpr double kContradicts = 3.0;  // standard deviations

}  // namespace

std::optional<RoadSweepResult> sweep_road(const LoadedFrames& frames, const MotionEstimate& motion,
                                          int num_threads) {
  std::vector<const GrayImage*> images;
  for (const GrayImage& image : frames.gray) images.push_back(&image);
  RoadSweepOptions options;
  options.num_threads = num_threads;
  RoadSweepResult out =
      camber::sweep_road(frames.camera, images, motion, frames.reference, options);
  if (!out.informative) return std::nullopt;
  return out;
}

std::optional<double> log_baseline_by_speed(const LoadedFrames& frames,
                                            const MotionEstimate& motion) {
  if (!frames.known.camera_height || motion.metres_per_baseline) return std::nullopt;
  const auto path = detail::travelled_path(frames, motion);
  if (!path) return std::nullopt;
  return std::log(path->distance.metres / (path->baselines * *frames.known.camera_height));
}

bool shows_another(double log_baseline, const EgoPlane& ego) {
  if (!(ego.height > 0.0)) return true;
  // Matches that stand still agree with each other: what they state counts for no more than what
  // passes does.
  const double sigma = std::hypot(kSweptHeight, std::min(ego.relative_sigma, kSweptHeight));
  return std::abs(log_baseline + std::log(ego.height)) > kContradicts * sigma;
}

bool repeats_road(const LoadedFrames& frames, const MotionEstimate& motion) {
  std::vector<GrayImage> small;
  for (const GrayImage& image : frames.gray) small.push_back(shrunk(image));
  std::vector<const GrayImage*> pointers;
  for (const GrayImage& image : small) pointers.push_back(&image);
  const Eigen::Vector3d travel = travel_direction(motion, frames.reference);
  const PinholeCamera& camera = frames.camera;
  const double horizon = camera.cy + camera.fy * travel.y() / std::max(0.1, travel.z());
  const int height = small.front().height;
  const int top = static_cast<int>(horizon * height / camera.height);
  return still_share(pointers, std::clamp(top, 0, height - 1)) > kRepeated;
}

Ground plane_ground(const LoadedFrames& frames, const Correspondences& matches,
                    const MotionEstimate& motion, double log_baseline, NearRoadSource by,
                    const GroundOptions& options) {
  // Films whose asphalt stands still show less that passes: docs/notes/film.md.
  constexpr double kHeight = 0.08;
  Ground out =
      detail::ground_of(frames, matches, motion, {log_baseline, 0.0, 0.0}, kHeight, options);
  out.near_road = by;
  return out;
}

std::optional<Ground> another_ground(const LoadedFrames& frames, const Correspondences& matches,
                                     const MotionEstimate& motion, const Ground* found,
                                     const std::optional<RoadSweepResult>& sweep, bool by_speed,
                                     const GroundOptions& options) {
  const auto speed = sweep || by_speed ? log_baseline_by_speed(frames, motion) : std::nullopt;
  if (!speed && !sweep) return std::nullopt;
  if (found && !shows_another(speed ? *speed : sweep->log_baseline, found->ego)) {
    return std::nullopt;
  }
  const bool passing =
      sweep && (!speed || std::abs(sweep->log_baseline - *speed) <= kContradicts * kSweptHeight);
  Ground out = plane_ground(frames, matches, motion, passing ? sweep->log_baseline : *speed,
                            passing ? NearRoadSource::kPassing : NearRoadSource::kSpeed, options);
  if (passing) out.passing = sweep;
  return out;
}

}  // namespace camber::stages
