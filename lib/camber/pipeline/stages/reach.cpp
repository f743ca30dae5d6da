#include "camber/pipeline/stages/reach.h"

#include <algorithm>
#include <utility>
#include <vector>

#include "camber/pipeline/stages/motion.h"

namespace camber::stages {
namespace {

/// @param value  one a frame; that of the reference does not count.
/// @param share  of the best value, below which an image falls short.
FrameRange outwards(const LoadedFrames& frames, const std::vector<double>& value, double share) {
  constexpr std::size_t kFewest = 3;  // frames
  const FrameRange all{0, frames.size() - 1};
  if (frames.has_poses()) return all;
  const double least = share * *std::max_element(value.begin(), value.end());
  FrameRange out{frames.reference, frames.reference};
  while (out.first > 0 && value[out.first - 1] >= least) --out.first;
  while (out.last < all.last && value[out.last + 1] >= least) ++out.last;
  return out.size() < kFewest ? all : out;
}

}  // namespace

FrameRange frames_that_share(const LoadedFrames& frames, const Correspondences& matches) {
  std::vector<double> shared(frames.size(), 0.0);
  for (const MatchedImage& match : matches.matches) {
    shared[static_cast<std::size_t>(match.frame)] = static_cast<double>(match.count());
  }
  return outwards(frames, shared, kLeastShared);
}

FrameRange frames_that_agree(const LoadedFrames& frames, const Correspondences& matches,
                             const MotionEstimate& motion, const MotionOptions& options) {
  constexpr double kShare = 0.7;
  const std::vector<std::uint8_t> usable = static_points(frames, matches);
  std::vector<double> agreement(frames.size(), 0.0);
  for (std::size_t m = 0; m < matches.matches.size(); ++m) {
    agreement[static_cast<std::size_t>(matches.matches[m].frame)] =
        epipolar_agreement(frames.camera, matches, usable, motion, options.inlier_px, m);
  }
  return outwards(frames, agreement, kShare);
}

Correspondences matches_within(const FrameRange& range, Correspondences matches) {
  std::vector<MatchedImage> kept;
  for (MatchedImage& match : matches.matches) {
    const auto frame = static_cast<std::size_t>(match.frame);
    if (frame < range.first || frame > range.last) continue;
    match.frame -= static_cast<int>(range.first);
    kept.push_back(std::move(match));
  }
  matches.matches = std::move(kept);
  matches.reference -= static_cast<int>(range.first);
  return matches;
}

}  // namespace camber::stages
