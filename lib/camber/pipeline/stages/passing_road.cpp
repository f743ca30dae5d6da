#include "camber/pipeline/stages/passing_road.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "camber/image/still_share.h"
#include "camber/pipeline/near_parallax.h"
#include "camber/pipeline/stages/detail/ground_steps.h"
#include "camber/scale/passing_road_constraint.h"

namespace camber::stages {

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

bool shows_another(const RoadSweepResult& sweep, const EgoPlane& ego) {
  constexpr double kContradicts = 3.0;  // standard deviations
  if (!(ego.height > 0.0)) return true;
  // Matches that stand still agree with each other: what they state counts for no more than what
  // passes does.
  const double sigma = std::hypot(kSweptHeight, std::min(ego.relative_sigma, kSweptHeight));
  return std::abs(sweep.log_baseline + std::log(ego.height)) > kContradicts * sigma;
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

Ground passing_ground(const LoadedFrames& frames, const Correspondences& matches,
                      const MotionEstimate& motion, const RoadSweepResult& sweep,
                      const GroundOptions& options) {
  // Films whose asphalt stands still show less that passes: docs/notes/film.md.
  constexpr double kHeight = 0.08;
  Ground out =
      detail::ground_of(frames, matches, motion, {sweep.log_baseline, 0.0, 0.0}, kHeight, options);
  out.passing = sweep;
  out.by_what_passes = true;
  return out;
}

}  // namespace camber::stages
