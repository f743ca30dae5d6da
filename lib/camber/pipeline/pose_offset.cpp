#include "camber/pipeline/pose_offset.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "camber/core/errors.h"
#include "camber/core/interruption.h"
#include "camber/core/median.h"
#include "camber/pipeline/near_parallax.h"
#include "camber/pipeline/small_images.h"

namespace camber {
namespace {

constexpr std::size_t kLeastTurns = 30;
constexpr std::size_t kReach = 100;  // frames on each side of the reference
// What a shift must show to be named: how well the turns go together with it, by how much less of
// their variance it leaves unexplained than the times as they are and than other shifts do, and
// sizes that agree, for turns are no matter of units.
constexpr double kLeastCorrelation = 0.8, kGain = 4.0, kLead = 2.0, kMostRatio = 1.25;

/// Share of the turns' variance that a correlation leaves, at least what the estimate of turns
/// does.
double unexplained(double correlation) {
  constexpr double kLeast = 0.01;
  return correlation > 0.0 ? std::max(kLeast, 1.0 - correlation * correlation) : 1.0;
}

struct Agreement {
  double correlation = -1.0, ratio = 0.0;  // ratio: of the poses' turns to the images'
};

/// Of images[i] with poses[i + shift].
Agreement agreement(const std::vector<double>& images, const std::vector<double>& poses,
                    int shift) {
  const int count = static_cast<int>(images.size());
  const int first = std::max(0, -shift), last = std::min(count, count - shift);
  const int n = last - first;
  if (n < std::max(static_cast<int>(kLeastTurns) * 2 / 3, count / 3)) return {};
  double a = 0.0, b = 0.0;
  for (int i = first; i < last; ++i) {
    a += images[static_cast<std::size_t>(i)] / n;
    b += poses[static_cast<std::size_t>(i + shift)] / n;
  }
  double aa = 0.0, bb = 0.0, ab = 0.0;
  for (int i = first; i < last; ++i) {
    const double x = images[static_cast<std::size_t>(i)] - a;
    const double y = poses[static_cast<std::size_t>(i + shift)] - b;
    aa += x * x;
    bb += y * y;
    ab += x * y;
  }
  if (!(aa > 0.0) || !(bb > 0.0)) return {};
  return {ab / std::sqrt(aa * bb), std::sqrt(bb / aa)};
}

}  // namespace

std::optional<PoseOffset> turn_offset(const std::vector<double>& images,
                                      const std::vector<double>& poses, double step) {
  if (images.size() < kLeastTurns || images.size() != poses.size()) return std::nullopt;
  const int most = static_cast<int>(images.size()) / 2;
  int best = 0;
  std::vector<double> by_shift;
  Agreement found;
  for (int shift = -most; shift <= most; ++shift) {
    const Agreement at = agreement(images, poses, shift);
    by_shift.push_back(at.correlation);
    if (at.correlation > found.correlation) {
      found = at;
      best = shift;
    }
  }
  const auto value = [&](int shift) { return by_shift[static_cast<std::size_t>(shift + most)]; };
  if (best == 0 || std::abs(best) == most || found.correlation < kLeastCorrelation) {
    return std::nullopt;
  }
  const double left_over = unexplained(found.correlation);
  if (unexplained(value(0)) < kGain * left_over) return std::nullopt;
  if (!(found.ratio < kMostRatio && found.ratio > 1.0 / kMostRatio)) return std::nullopt;
  // Beyond the flanks of its peak no other shift may do nearly as well.
  int left = best, right = best;
  while (left > -most && value(left - 1) < value(left)) --left;
  while (right < most && value(right + 1) < value(right)) ++right;
  for (int shift = -most; shift <= most; ++shift) {
    if (shift >= left && shift <= right) continue;
    if (unexplained(value(shift)) < kLead * left_over) return std::nullopt;
  }
  PoseOffset out;
  const double before = value(best - 1), at = value(best), after = value(best + 1);
  const double bend = before - 2.0 * at + after;
  const double part = bend < 0.0 ? 0.5 * (before - after) / bend : 0.0;
  out.frames = best + std::clamp(part, -0.5, 0.5);
  out.seconds = out.frames * step;
  out.correlation = found.correlation;
  out.without = value(0);
  return out;
}

std::optional<PoseOffset> find_pose_offset(const Scene& scene, int reference_frame,
                                           const FramePixelSource& pixels) {
  const auto has_pose = [&](std::size_t at) {
    return scene.frames[at].world_from_camera.has_value();
  };
  std::size_t reference = 0;
  while (reference < scene.frames.size() && scene.frames[reference].id != reference_frame) {
    ++reference;
  }
  if (reference == scene.frames.size()) return std::nullopt;
  std::size_t first = reference, last = reference;
  while (first > 0 && reference - first < kReach && has_pose(first - 1)) --first;
  while (last + 1 < scene.frames.size() && last - reference < kReach && has_pose(last + 1)) ++last;
  if (!has_pose(reference) || last - first < kLeastTurns) return std::nullopt;
  const double rate = scene.frame_rate.value_or(10.0);
  std::vector<double> images, poses, steps;
  SmallImages small(scene, pixels);
  try {
    GrayImage before = small.read(first);
    for (std::size_t at = first + 1; at <= last; ++at) {
      throw_if_interrupted();
      GrayImage image = small.read(at);
      const SceneFrame& a = scene.frames[at - 1];
      const SceneFrame& b = scene.frames[at];
      images.push_back(image_parallax(scene.camera, before, image, 0.0).turn.norm());
      poses.push_back(
          Eigen::AngleAxisd((a.world_from_camera->inverse() * *b.world_from_camera).rotation())
              .angle());
      steps.push_back(time_of(b, rate) - time_of(a, rate));
      before = std::move(image);
    }
  } catch (const InputError&) {
    return std::nullopt;  // a remark on poses is not worth a run
  } catch (const NoAnswerError&) {
    return std::nullopt;
  }
  const double step = upper_median(steps);
  // Turns over one step; one that is longer or shorter has no place in the series.
  for (const double length : steps) {
    if (!(std::abs(length - step) < 0.5 * step)) return std::nullopt;
  }
  return turn_offset(images, poses, step);
}

std::string describe(const PoseOffset& offset) {
  return fmt::format(
      "the turns of poses and images agree (correlation {:.2f}, {:.2f} as the times are) if {:.2f} "
      "s ({:.1f} frames) are {} the times of the poses",
      offset.correlation, offset.without, std::abs(offset.seconds), std::abs(offset.frames),
      offset.seconds > 0.0 ? "taken off" : "added to");
}

}  // namespace camber
