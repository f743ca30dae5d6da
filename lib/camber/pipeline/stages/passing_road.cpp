#include "camber/pipeline/stages/passing_road.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "camber/image/still_part.h"
#include "camber/pipeline/near_parallax.h"

namespace camber::stages {
namespace {

double still_share(const LoadedFrames& frames, const MotionEstimate& motion) {
  std::vector<GrayImage> small;
  for (const GrayImage& image : frames.gray) small.push_back(shrunk(image));
  std::vector<const GrayImage*> pointers;
  for (const GrayImage& image : small) pointers.push_back(&image);
  const Eigen::Vector3d travel = travel_direction(motion, frames.reference);
  const PinholeCamera& camera = frames.camera;
  const double horizon = camera.cy + camera.fy * travel.y() / std::max(0.1, travel.z());
  const int height = small.front().height;
  return still_part(pointers,
                    std::clamp(static_cast<int>(horizon * height / camera.height), 0, height - 1))
      .share;
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

std::optional<ScaleEvidence> passing_evidence(const LoadedFrames& frames,
                                              const PhotometricGround& refined, bool always,
                                              int num_threads) {
  const EgoPlane& ego = refined.ground.ego;
  if (!(ego.height > 0.0)) return std::nullopt;
  const double still = still_share(frames, refined.motion);
  const bool repeated = still > kRepeated;
  if (!always && !repeated) return std::nullopt;
  const RoadSweepResult sweep = sweep_road(frames, refined.motion, num_threads);
  if (!sweep.informative) return std::nullopt;
  const double log_ratio = sweep.log_baseline + std::log(ego.height);
  ScaleEvidence out = evidence_of(kPassingRoad, "what passes on the road", log_ratio, kSweptHeight);
  out.measured = {{"correlation", sweep.correlation}, {"lead", sweep.lead}, {"still", still}};
  if (!repeated) return out;
  const double sigma = std::hypot(kSweptHeight, ego.relative_sigma);
  out.against_others =
      Disagreement{log_ratio, std::abs(log_ratio) / sigma,
                   "the pictures repeat the road, as films do: what passes on it fits if " +
                       larger_or_smaller(log_ratio)};
  return out;
}

}  // namespace camber::stages
