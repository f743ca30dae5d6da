#include "camber/pipeline/stages/motion.h"

#include <fmt/format.h>

#include <Eigen/SVD>
#include <algorithm>
#include <cmath>

#include "camber/core/errors.h"
#include "camber/core/median.h"
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

/// From a frame to the next, in the axes of the first.
struct Step {
  Eigen::Vector3d turn;                                 // rad
  Eigen::Vector3d direction = Eigen::Vector3d::Zero();  // unit; zero: it stands
};

std::vector<Step> steps_of(const std::vector<SE3>& world_from_frame) {
  constexpr double kStands = 0.05;  // of the longest step
  std::vector<Step> out;
  std::vector<Eigen::Vector3d> moves;
  double longest = 0.0;
  for (std::size_t k = 1; k < world_from_frame.size(); ++k) {
    const SE3 step = world_from_frame[k - 1].inverse() * world_from_frame[k];
    out.push_back({rotation_to_vector(step.rotation())});
    moves.push_back(step.translation());
    longest = std::max(longest, step.translation().norm());
  }
  for (std::size_t k = 0; k < out.size(); ++k) {
    if (moves[k].norm() > kStands * longest) out[k].direction = moves[k].normalized();
  }
  return out;
}

/// By how much the turns differ once the poses' axes are turned to the camera's as well as can be:
/// root of the mean square, in units of what those of the same moments differ by at most.
double turns_off(const std::vector<Step>& images, const std::vector<Step>& poses) {
  // rad a step and axis: KITTI's own poses differ by up to 0.050 degrees, those of 10 to 100 frames
  // away by 0.084 and more (windows of five frames, even numbers of bench shifted_poses, by
  // features of pairs of images). Relative: of the focal length. rad: of where the camera is
  // mounted.
  constexpr double kTurn = 0.0014, kTurnShare = 0.05, kDirection = 0.035;
  Eigen::Matrix3d both = Eigen::Matrix3d::Zero();
  std::vector<double> sigmas;
  for (std::size_t k = 0; k < images.size(); ++k) {
    const double sigma = std::hypot(kTurn, kTurnShare * images[k].turn.norm());
    sigmas.push_back(sigma);
    both += images[k].turn * poses[k].turn.transpose() / (sigma * sigma) +
            images[k].direction * poses[k].direction.transpose() / (kDirection * kDirection);
  }
  // Wahba's problem: Markley, "Attitude determination using vector observations and the singular
  // value decomposition", J. Astronautical Sciences 1988.
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(both, Eigen::ComputeFullU | Eigen::ComputeFullV);
  const double handed = (svd.matrixU() * svd.matrixV().transpose()).determinant();
  const Eigen::Matrix3d camera_from_pose =
      svd.matrixU() * Eigen::Vector3d(1.0, 1.0, handed).asDiagonal() * svd.matrixV().transpose();
  double squares = 0.0;
  for (std::size_t k = 0; k < images.size(); ++k) {
    squares +=
        (images[k].turn - camera_from_pose * poses[k].turn).squaredNorm() / (sigmas[k] * sigmas[k]);
  }
  // The directions leave of the axes a turn about themselves open.
  return std::sqrt(squares / (3.0 * static_cast<double>(images.size()) - 1.0));
}

/// Whether the turns differ, and not by one wrong pose alone.
bool turn_otherwise(const std::vector<SE3>& images, const std::vector<SE3>& poses) {
  // Of KITTI's own poses the most is 0.62; windows of five whose poses are of other moments are
  // above that without any one of them.
  constexpr double kMost = 1.0, kWithoutOne = 0.6;
  if (turns_off(steps_of(images), steps_of(poses)) <= kMost) return false;
  for (std::size_t k = 0; k < images.size(); ++k) {
    const auto without = [&](std::vector<SE3> all) {
      all.erase(all.begin() + static_cast<std::ptrdiff_t>(k));
      return steps_of(all);
    };
    if (turns_off(without(images), without(poses)) < kWithoutOne) return false;
  }
  return true;
}

/// Whether the scene's poses about the frames turn as if smoothed, over steps as those of the
/// frames: by less from one to the next than a vehicle on its springs.
bool turn_smoothly(const Scene& scene, const LoadedFrames& frames) {
  constexpr double kSprings = 0.0009;  // rad, median; drives of KITTI: 0.0027 and 0.0038
  constexpr std::size_t kReach = 50;   // steps on each side
  const auto place_of = [&](int id) {
    std::size_t i = 0;
    while (i < scene.frames.size() && scene.frames[i].id != id) ++i;
    return i;
  };
  const std::size_t first = place_of(frames.frames.front().id);
  const std::size_t last = place_of(frames.frames.back().id);
  if (last >= scene.frames.size() || last <= first) return false;
  const std::size_t step = std::max<std::size_t>(1, (last - first) / (frames.size() - 1));
  std::size_t from = first;
  for (std::size_t k = 0; k < kReach && from >= step; ++k) from -= step;
  std::vector<double> changes;
  std::vector<SE3> poses;
  for (std::size_t at = from; at < scene.frames.size() && at <= last + kReach * step; at += step) {
    if (!scene.frames[at].world_from_camera) {
      poses.clear();
      continue;
    }
    poses.push_back(*scene.frames[at].world_from_camera);
    if (poses.size() < 3) continue;
    const std::vector<Step> two = steps_of({poses.end() - 3, poses.end()});
    changes.push_back((two[1].turn - two[0].turn).norm());
  }
  return !changes.empty() && upper_median(changes) < kSprings;
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

void check_turns(const Scene& scene, const MotionEstimate& motion, LoadedFrames* frames) {
  if (frames->contradicted_poses.empty() || frames->poses_of_other_moments) return;
  if (motion.metres_per_baseline || frames->size() < 3) return;  // two are compared above
  std::vector<SE3> images, poses;
  for (std::size_t k = 0; k < frames->size(); ++k) {
    if (!frames->frames[k].world_from_camera) return;
    images.push_back(motion.frame_from_reference[k].inverse());
    poses.push_back(*frames->frames[k].world_from_camera);
  }
  if (!turn_otherwise(images, poses)) return;
  frames->poses_of_other_moments = !turn_smoothly(scene, *frames);
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
