#include "camber/pipeline/stages/passing_road.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "camber/image/still_share.h"
#include "camber/pipeline/near_parallax.h"
#include "camber/pipeline/stages/detail/ground_steps.h"

namespace camber::stages {
namespace {

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

/// Whether what passes contradicts a ground, or knows it much better than its matches. Those that
/// stand still agree with each other: what they state counts for no more than what passes does.
bool is_another(const EgoPlane& ego, const RoadSweepResult& sweep) {
  constexpr double kContradicts = 3.0;  // standard deviations
  const double off = std::abs(sweep.log_baseline + std::log(ego.height));
  return off > kContradicts * std::hypot(kSweptHeight, std::min(ego.relative_sigma, kSweptHeight));
}

}  // namespace

RoadSweepResult sweep_road(const LoadedFrames& frames, const MotionEstimate& motion,
                           int num_threads) {
  std::vector<const GrayImage*> images;
  for (const GrayImage& image : frames.gray) images.push_back(&image);
  RoadSweepOptions options;
  options.num_threads = num_threads;
  return camber::sweep_road(frames.camera, images, motion, frames.reference, options);
}

std::optional<Ground> passing_ground(const LoadedFrames& frames, const Correspondences& matches,
                                     const MotionEstimate& motion, const Ground* found,
                                     const GroundOptions& options) {
  if (found && !repeats_road(frames, motion)) return std::nullopt;
  const RoadSweepResult sweep = sweep_road(frames, motion, options.num_threads);
  if (!sweep.informative) return std::nullopt;
  if (found && found->ego.height > 0.0 && !is_another(found->ego, sweep)) return std::nullopt;
  return detail::ground_of(frames, matches, motion, {sweep.log_baseline, 0.0, 0.0}, kSweptHeight,
                           options);
}

std::optional<ScaleEvidence> passing_evidence(const LoadedFrames& frames,
                                              const PhotometricGround& refined, int num_threads) {
  const EgoPlane& ego = refined.ground.ego;
  if (refined.ground.by_what_passes || !(ego.height > 0.0)) return std::nullopt;
  const RoadSweepResult sweep = sweep_road(frames, refined.motion, num_threads);
  if (!sweep.informative) return std::nullopt;
  ScaleEvidence out = evidence_of(kPassingRoad, "what passes on the road",
                                  sweep.log_baseline + std::log(ego.height), kSweptHeight);
  out.measured = {{"correlation", sweep.correlation}, {"lead", sweep.lead}};
  return out;
}

}  // namespace camber::stages
