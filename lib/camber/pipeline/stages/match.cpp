#include "camber/pipeline/stages/match.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "camber/core/threads.h"

namespace camber::stages {
namespace {

constexpr double kFarthest = 200.0;  // m, of a predicted ground point

/// Where a prediction is wanted: the ground and what stands on it, with a margin for context.
std::vector<std::uint8_t> predicted_region(const LoadedFrames& frames,
                                           const Correspondences& matches, const Ground& ground) {
  if (frames.has_masks()) return frames.reference_masks().ground_near;
  const PinholeCamera& camera = frames.camera;
  std::vector<std::uint8_t> out(
      static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height), 0);
  const int reach = 12 * matches.step;  // the road may go on where it was lost
  for (std::size_t i = 0; i < ground.seen.is_ground.size(); ++i) {
    if (!ground.seen.is_ground[i]) continue;
    const int x = static_cast<int>(matches.pixels[i].x());
    const int y = static_cast<int>(matches.pixels[i].y());
    const int left = std::max(0, x - reach), right = std::min(camera.width - 1, x + reach);
    for (int v = std::max(0, y - reach); v <= std::min(camera.height - 1, y + reach); ++v) {
      std::fill(out.begin() + static_cast<std::ptrdiff_t>(v * camera.width + left),
                out.begin() + static_cast<std::ptrdiff_t>(v * camera.width + right + 1),
                std::uint8_t{1});
    }
  }
  return out;
}

/// The corridor ahead that no ground point covers: what a moving shadow cuts off is found again
/// from there by windows of its own, since the shadow biases the flow beside it.
std::vector<std::uint8_t> searched_corridor(const LoadedFrames& frames, const Ground& ground,
                                            int top) {
  constexpr double kReach = 15.0, kHalfWidth = 5.0;  // m
  const PinholeCamera& camera = frames.camera;
  const auto width = static_cast<std::size_t>(camera.width);
  const auto height = static_cast<std::size_t>(camera.height);
  std::vector<std::uint8_t> out(width * height, 0);
  for (std::size_t v = static_cast<std::size_t>(top); v < height; ++v) {
    for (std::size_t u = 0; u < width; ++u) {
      const Eigen::Vector2d pixel(static_cast<double>(u), static_cast<double>(v));
      const double depth = ground.metres_per_baseline / ground.field->inverse_depth(pixel);
      out[v * width + u] = depth > 0 && depth < kReach &&
                           std::abs(camera.ray(pixel).x() * depth) < kHalfWidth &&
                           !frames.reference_masks().vehicle[v * width + u];
    }
  }
  return out;
}

/// Carries every ground pixel of the reference into the other images by the field.
std::vector<PredictedImage> predict(const LoadedFrames& frames, const Correspondences& matches,
                                    const MotionEstimate& motion, const Ground& ground, int top,
                                    int num_threads) {
  const PinholeCamera& camera = frames.camera;
  const auto width = static_cast<std::size_t>(camera.width);
  const auto height = static_cast<std::size_t>(camera.height);
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const double least = ground.metres_per_baseline / kFarthest;
  const FrameMasks& here = frames.reference_masks();

  std::vector<std::uint8_t> region = predicted_region(frames, matches, ground);
  std::vector<std::uint8_t> searched;
  if (!frames.has_masks()) {
    searched = searched_corridor(frames, ground, top);
    for (std::size_t p = 0; p < region.size(); ++p) region[p] |= searched[p];
    const std::vector<std::uint8_t> found = ground_pixels(frames, matches, ground);
    for (std::size_t p = 0; p < found.size(); ++p) searched[p] = searched[p] && !found[p];
  }
  std::vector<PredictedImage> out(matches.matches.size());
  for (std::size_t k = 0; k < out.size(); ++k) {
    out[k].searched = searched;
    out[k].frame = matches.matches[k].frame;
    out[k].pixels.assign(width * height, Eigen::Vector2f(nan, nan));
    out[k].ignored.assign(width * height, 0);
  }
  parallel_for(height - static_cast<std::size_t>(top), num_threads, [&](std::size_t r) {
    const std::size_t v = r + static_cast<std::size_t>(top);
    std::vector<float> depths(width);
    ground.field->interpolated_row(static_cast<double>(v), ground.field->nodes(), camera.width,
                                   depths.data());
    for (PredictedImage& image : out) {
      const auto f = static_cast<std::size_t>(image.frame);
      const SE3& pose = motion.frame_from_reference[f];
      const Eigen::Matrix3d rotation = pose.rotation_matrix();
      const Eigen::Vector3d start = rotation * camera.ray({0.0, static_cast<double>(v)});
      const Eigen::Vector3d step = rotation.col(0) / camera.fx;
      const std::vector<std::uint8_t>& there = frames.masks[f].vehicle;
      for (std::size_t u = 0; u < width; ++u) {
        const std::size_t p = v * width + u;
        if (!region[p]) continue;
        const double rho = std::max(least, static_cast<double>(depths[u]));
        const auto q =
            camera.project(start + static_cast<double>(u) * step + rho * pose.translation());
        if (!q) continue;
        image.pixels[p] = q->cast<float>();
        bool ignored = here.vehicle[p] != 0;
        if (camera.contains(*q, 1.0)) {
          ignored |= there[static_cast<std::size_t>(q->y() + 0.5) * width +
                           static_cast<std::size_t>(q->x() + 0.5)] != 0;
        }
        image.ignored[p] = ignored;
      }
    }
  });
  return out;
}

CorrespondenceOptions flow_options(const LoadedFrames& frames, const MatchOptions& options) {
  CorrespondenceOptions out = options.flow;
  out.keep_lost = !frames.has_masks();
  return out;
}

}  // namespace

Correspondences match(const LoadedFrames& frames, const MatchOptions& options) {
  CorrespondenceOptions flow = flow_options(frames, options);
  // What stays where matching again fails.
  flow.smooth = flow.keep_lost && options.smooth_start;
  KeptFlows kept{options.kept, {}};
  for (const SceneFrame& frame : frames.frames) kept.ids.push_back(frame.id);
  return match_images(frames.gray, static_cast<int>(frames.reference), flow, kept);
}

Correspondences match_again(const LoadedFrames& frames, const Correspondences& before,
                            const MotionEstimate& motion, const Ground& ground, bool fine,
                            const MatchOptions& options) {
  const int top = std::max(0, static_cast<int>(ground.field->top()) - 12);
  CorrespondenceOptions flow = flow_options(frames, options);
  flow.finest_scale = fine ? 0 : flow.keep_lost ? 1 : 2;
  flow.smooth = !fine;
  return refine_matches(frames.gray, before,
                        predict(frames, before, motion, ground, top, flow.num_threads), top, flow);
}

double prediction_change(const LoadedFrames& frames, const Correspondences& matches,
                         const MotionEstimate& motion, const GroundField& before,
                         const Ground& after) {
  constexpr std::size_t kStride = 7;  // of the points
  constexpr double kShare = 0.95;
  const PinholeCamera& camera = frames.camera;
  const double least = after.metres_per_baseline / kFarthest;
  std::vector<double> moved;
  const TriangulatedPoints& points = after.seen.points;
  for (std::size_t k = 0; k < points.size(); k += kStride) {
    const Eigen::Vector2d pixel =
        matches.pixels[static_cast<std::size_t>(points.grid[k])].cast<double>();
    const double was = std::max(least, before.inverse_depth(pixel));
    const double is = std::max(least, after.field->inverse_depth(pixel));
    double most = 0.0;
    for (const MatchedImage& match : matches.matches) {
      const SE3& pose = motion.frame_from_reference[static_cast<std::size_t>(match.frame)];
      const Eigen::Vector3d ray = pose.rotation() * camera.ray(pixel);
      const auto from = camera.project(ray + was * pose.translation());
      const auto to = camera.project(ray + is * pose.translation());
      if (from && to) most = std::max(most, (*to - *from).norm());
    }
    moved.push_back(most);
  }
  if (moved.empty()) return 0.0;
  const auto at = moved.begin() + static_cast<std::ptrdiff_t>(kShare * (moved.size() - 1));
  std::nth_element(moved.begin(), at, moved.end());
  return *at;
}

}  // namespace camber::stages
