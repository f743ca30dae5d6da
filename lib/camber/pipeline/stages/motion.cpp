#include "camber/pipeline/stages/motion.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "camber/core/errors.h"
#include "camber/motion/feature_matches.h"
#include "camber/pipeline/stages/reach.h"

namespace camber::stages {
namespace {

MotionEstimate motion_from_poses(const LoadedFrames& frames) {
  std::vector<SE3> frame_from_reference;
  for (const SceneFrame& frame : frames.frames) {
    frame_from_reference.push_back(frame.world_from_camera->inverse() *
                                   *frames.frames[frames.reference].world_from_camera);
  }
  return motion_from_known_poses(frame_from_reference, frames.reference, {});
}

/// The motion by sparse features, which follow displacements that a dense flow loses. kFailed also
/// where they agree no better with it than with the motion by the flow.
MotionEstimate motion_from_features(const LoadedFrames& frames, const MotionEstimate& dense,
                                    const MotionOptions& options) {
  FeatureMatchOptions matching;
  matching.num_threads = options.num_threads;
  const Correspondences features =
      match_features(frames.gray, static_cast<int>(frames.reference), matching);
  const std::vector<std::uint8_t> usable = static_points(frames, features);
  MotionEstimate out = estimate_motion(frames.camera, features, usable, options);
  if (out.status == Status::kFailed || dense.status == Status::kFailed) return out;
  const auto agreement = [&](const MotionEstimate& motion) {
    return epipolar_agreement(frames.camera, features, usable, motion, options.inlier_px);
  };
  if (!(agreement(out) > agreement(dense) + options.noise.feature_gain)) {
    out.status = Status::kFailed;
    out.reason = "the features agree as well with the motion by the flow";
  }
  return out;
}

/// The angle of a rotation, rad.
double turn_of(const SE3& motion) { return Eigen::AngleAxisd(motion.rotation()).angle(); }

/// The matches with one image alone, which is image 1, the reference image 0.
Correspondences pair_of(const Correspondences& matches, std::size_t other) {
  Correspondences out = matches;
  out.reference = 0;
  out.matches = {matches.matches[other]};
  out.matches.front().frame = 1;
  return out;
}

/// Whether the motion by the flow explains it: for the images next to the reference, where the
/// farther ones, of which the flow loses more, do not.
bool is_explained(const LoadedFrames& frames, const Correspondences& matches,
                  const std::vector<std::uint8_t>& usable, const MotionEstimate& dense,
                  const MotionOptions& options) {
  if (dense.status == Status::kFailed) return false;
  const double least = options.noise.trusted_inliers;
  if (dense.inlier_ratio >= least) return true;
  if (matches.matches.size() <= 2) return false;
  for (std::size_t m = 0; m < matches.matches.size(); ++m) {
    const auto frame = static_cast<std::size_t>(matches.matches[m].frame);
    if (frame + 1 != frames.reference && frame != frames.reference + 1) continue;
    const double share =
        epipolar_agreement(frames.camera, matches, usable, dense, options.inlier_px, m);
    if (share < least) return false;
  }
  return true;
}

}  // namespace

std::vector<std::uint8_t> static_points(const LoadedFrames& frames,
                                        const Correspondences& matches) {
  const std::vector<std::uint8_t>& vehicle_near = frames.reference_masks().vehicle_near;
  std::vector<std::uint8_t> out(matches.pixels.size());
  for (std::size_t i = 0; i < out.size(); ++i) {
    out[i] = !vehicle_near[matches.image_index(i, frames.camera.width)];
  }
  return out;
}

void check_poses(const Correspondences& matches, const MotionOptions& options,
                 LoadedFrames* frames) {
  // Shares of the matches: that must agree with their own motion for it to count, and by which
  // fewer agree with poses that are contradicted.
  constexpr double kTrusted = 0.6, kFewer = 0.2;
  // Of a turn by the matches and by a pose of the same moment: some 0.05 degrees each, and the
  // focal length's error in it.
  constexpr double kSameTurn = 0.0025, kSameTurnShare = 0.05;  // rad; relative
  constexpr std::size_t kNamed = 3;
  if (!frames->has_poses()) return;
  const MotionEstimate given = motion_from_poses(*frames);
  if (given.status == Status::kFailed) return;
  const std::vector<std::uint8_t> usable = static_points(*frames, matches);
  std::size_t most = 0;
  for (const MatchedImage& match : matches.matches) most = std::max(most, match.count());
  std::vector<std::string> contradicted;
  int judged = 0, turned = 0;
  for (std::size_t m = 0; m < matches.matches.size(); ++m) {
    // What a far image shares may be another layer.
    const auto shared = static_cast<double>(matches.matches[m].count());
    if (shared < kLeastShared * static_cast<double>(most)) continue;
    const Correspondences pair = pair_of(matches, m);
    const MotionEstimate own = estimate_motion(frames->camera, pair, usable, options);
    if (own.status == Status::kFailed) continue;
    const double by_own = epipolar_agreement(frames->camera, pair, usable, own, options.inlier_px);
    const double by_given =
        epipolar_agreement(frames->camera, matches, usable, given, options.inlier_px, m);
    if (by_own < kTrusted) continue;
    ++judged;
    if (by_given > by_own - kFewer) continue;
    const auto frame = static_cast<std::size_t>(matches.matches[m].frame);
    const double turn = turn_of(own.frame_from_reference[1]);
    if (std::abs(turn - turn_of(given.frame_from_reference[frame])) >
        kSameTurn + kSameTurnShare * turn) {
      ++turned;
    }
    contradicted.push_back(fmt::format(
        "frame {}: {:.0f} % of its matches agree with the given poses, {:.0f} % with another "
        "motion",
        frames->frames[frame].id, 100.0 * by_given, 100.0 * by_own));
  }
  if (contradicted.size() > kNamed) {
    const std::size_t more = contradicted.size() - kNamed;
    contradicted.resize(kNamed);
    contradicted.push_back(fmt::format("and {} more", more));
  }
  frames->contradicted_poses = fmt::format("{}", fmt::join(contradicted, "; "));
  frames->poses_of_other_moments = 2 * turned > judged;  // one wrong pose leaves the others
}

MotionEstimate motion(const LoadedFrames& frames, const Correspondences& matches,
                      const MotionOptions& options) {
  if (frames.has_poses()) {
    MotionEstimate known = motion_from_poses(frames);
    if (known.status == Status::kFailed) throw NoAnswerError(known.reason);
    return known;
  }
  const std::vector<std::uint8_t> usable = static_points(frames, matches);
  const MotionEstimate dense = estimate_motion(frames.camera, matches, usable, options);
  if (is_explained(frames, matches, usable, dense, options)) return dense;
  MotionEstimate sparse = motion_from_features(frames, dense, options);
  if (sparse.status != Status::kFailed) return sparse;
  if (dense.status == Status::kFailed) throw NoAnswerError(dense.reason);
  return dense;
}

MotionEstimate motion_again(const LoadedFrames& frames, const Correspondences& matches,
                            const MotionEstimate& start, const MotionOptions& options) {
  if (start.metres_per_baseline) return start;
  MotionEstimate refined =
      refine_motion(frames.camera, matches, static_points(frames, matches), start, options);
  return refined.status == Status::kOk ? refined : start;
}

}  // namespace camber::stages
