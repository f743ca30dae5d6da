#include "camber/drive/position_scale.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "camber/drive/detail/window_scales.h"

namespace camber {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kFreedom = 4.0;  // Student's, of positions and of stretches

/// A frame's place in the trajectory and on the map, in plan.
struct PlanPair {
  Vector2d run, map;
  double sigma = 0.0;  // m
  double way = 0.0;    // along the trajectory
};

std::vector<PlanPair> plan_pairs(const Trajectory& trajectory, const MapPositions& positions) {
  std::vector<PlanPair> out;
  double way = 0.0;
  std::size_t next = 0;
  for (std::size_t k = 0; k < trajectory.poses.size(); ++k) {
    const SE3& pose = trajectory.poses[k].world_from_camera;
    if (k > 0) {
      way += (pose.translation() - trajectory.poses[k - 1].world_from_camera.translation()).norm();
    }
    if (next >= positions.at.size() || positions.at[next].place != k) continue;
    const MapPositions::At& at = positions.at[next++];
    const Vector3d run = positions.level_from_world * (pose * positions.antenna);
    out.push_back({run.head<2>(), at.position.head<2>(), at.sigma, way});
  }
  return out;
}

struct StretchScale {
  double log_scale = 0.0, sigma = 0.0;
};

/// Similarity of the pairs [first, last], with heavy tails.
std::optional<StretchScale> stretch_scale(const std::vector<PlanPair>& pairs, std::size_t first,
                                          std::size_t last) {
  constexpr int kIterations = 10;
  std::vector<double> weights(last - first + 1, 1.0);
  double scale = 1.0, length = 0.0, misfit = 1.0, mean_variance = 0.0;
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    Vector2d run = Vector2d::Zero(), map = Vector2d::Zero();
    double total = 0.0;
    for (std::size_t i = first; i <= last; ++i) {
      const double w = weights[i - first] / (pairs[i].sigma * pairs[i].sigma);
      run += w * pairs[i].run;
      map += w * (pairs[i].map - pairs[first].map);
      total += w;
    }
    run /= total;
    map = map / total + pairs[first].map;
    double along = 0.0, across = 0.0, spread = 0.0, of_map = 0.0;
    for (std::size_t i = first; i <= last; ++i) {
      const double w = weights[i - first] / (pairs[i].sigma * pairs[i].sigma);
      const Vector2d p = pairs[i].run - run, q = pairs[i].map - map;
      along += w * p.dot(q);
      across += w * (p.x() * q.y() - p.y() * q.x());
      spread += w * p.squaredNorm();
      of_map += w * q.squaredNorm();
    }
    if (!(spread > 0.0) || !(of_map > 0.0)) return std::nullopt;
    const double angle = std::atan2(across, along);
    scale = std::hypot(along, across) / spread;
    const double c = scale * std::cos(angle), s = scale * std::sin(angle);
    double squares = 0.0;
    mean_variance = length = 0.0;
    for (std::size_t i = first; i <= last; ++i) {
      const Vector2d p = pairs[i].run - run, q = pairs[i].map - map;
      const Vector2d off = q - Vector2d(c * p.x() - s * p.y(), s * p.x() + c * p.y());
      const double variance = pairs[i].sigma * pairs[i].sigma;
      weights[i - first] = detail::student_weight(off.squaredNorm() / variance, 2.0, kFreedom);
      squares += std::min(off.squaredNorm() / variance, 9.0);
      mean_variance += variance;
      length = std::max(length, 2.0 * p.norm());
    }
    const auto count = static_cast<double>(last - first + 1);
    mean_variance /= count;
    misfit = std::max(1.0, squares / std::max(1.0, 2.0 * count - 4.0));
  }
  if (!(scale > 0.0) || !(length > 0.0)) return std::nullopt;
  return StretchScale{std::log(scale), std::sqrt(2.0 * misfit * mean_variance) / (scale * length)};
}

/// From one pair on: the first at which the way on the map is long against the positions' errors.
std::size_t end_of_stretch(const std::vector<PlanPair>& pairs, std::size_t first) {
  constexpr double kLong = 40.0;                         // standard deviations
  constexpr double kShortest = 50.0, kFarthest = 400.0;  // m on the map
  std::size_t last = first;
  double way = 0.0;
  while (last + 1 < pairs.size()) {
    ++last;
    way = std::max(way, (pairs[last].map - pairs[first].map).norm());
    if (way >= std::clamp(kLong * pairs[first].sigma, kShortest, kFarthest)) break;
  }
  return last;
}

}  // namespace

MapPositions map_positions(const Scene& scene, const std::vector<int>& frame_ids,
                           const Vector3d& up) {
  MapPositions out;
  out.antenna = scene.antenna;
  const Vector3d side = std::abs(up.x()) < 0.9 ? Vector3d::UnitX() : Vector3d::UnitZ();
  Eigen::Matrix3d rows;
  rows.row(2) = up.transpose();
  rows.row(0) = (side - side.dot(up) * up).normalized().transpose();
  rows.row(1) = up.cross(Vector3d(rows.row(0).transpose())).transpose();
  out.level_from_world = rows;
  for (std::size_t k = 0; k < frame_ids.size(); ++k) {
    const SceneFrame* frame = scene.find_frame(frame_ids[k]);
    if (!frame || !frame->map_position || !(frame->map_position->sigma > 0.0)) continue;
    const MapPosition& p = *frame->map_position;
    if (!p.position.head<2>().allFinite()) continue;
    out.at.push_back({k, p.position, p.sigma,
                      std::isfinite(p.position.z()) && p.height_sigma > 0.0
                          ? p.height_sigma
                          : std::numeric_limits<double>::infinity()});
  }
  return out;
}

std::optional<PositionScale> scale_by_positions(const Trajectory& trajectory,
                                                const MapPositions& positions) {
  constexpr double kWorst = 0.3;
  constexpr int kIterations = 10;
  const std::vector<PlanPair> pairs = plan_pairs(trajectory, positions);
  std::vector<StretchScale> stretches;
  for (std::size_t first = 0; first + 2 < pairs.size();) {
    const std::size_t last = end_of_stretch(pairs, first);
    const auto found = stretch_scale(pairs, first, last);
    if (found && found->sigma <= kWorst) stretches.push_back(*found);
    first = last;
  }
  if (stretches.empty()) return std::nullopt;
  PositionScale out;
  out.stretches = static_cast<int>(stretches.size());
  double information = 0.0, squares = 0.0;
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    double sum = 0.0;
    const double before = out.log_scale;
    information = squares = 0.0;
    for (const StretchScale& s : stretches) {
      const double variance = s.sigma * s.sigma;
      const double off = (s.log_scale - before) * (s.log_scale - before) / variance;
      const double weight =
          (iteration == 0 ? 1.0 : detail::student_weight(off, 1.0, kFreedom)) / variance;
      sum += weight * s.log_scale;
      information += weight;
      squares += std::min(off, 9.0);
    }
    out.log_scale = sum / information;
  }
  const double misfit = squares / std::max(1.0, static_cast<double>(stretches.size()) - 1.0);
  constexpr double kFloor = 0.002;  // bends of the trajectory within a stretch
  out.sigma = std::hypot(std::sqrt(std::max(1.0, misfit) / information), kFloor);
  return out;
}

JoinedScale joined_scale(const Trajectory& trajectory, const PositionScale& positions) {
  JoinedScale out;
  const double own = trajectory.whole.own_sigma / std::max(trajectory.whole.length, 1e-9);
  const double measured = own * own + positions.sigma * positions.sigma;
  if (!trajectory.metric) {
    out.log_scale = positions.log_scale;
    out.common_sigma = std::sqrt(measured);
    out.disagreement_sigmas = std::numeric_limits<double>::quiet_NaN();
    return out;
  }
  const double prior = trajectory.common_sigma * trajectory.common_sigma;
  out.disagreement_sigmas = std::abs(positions.log_scale) / std::sqrt(prior + measured);
  if (out.disagreement_sigmas > kMostPositionSigmas) {
    out.common_sigma = std::hypot(trajectory.common_sigma, positions.log_scale);
    return out;
  }
  out.log_scale = prior / (prior + measured) * positions.log_scale;
  out.common_sigma = std::sqrt(prior * measured / (prior + measured));
  return out;
}

}  // namespace camber
