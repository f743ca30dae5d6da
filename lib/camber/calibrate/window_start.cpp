#include "camber/calibrate/window_start.h"

#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <limits>

#include "camber/motion/motion.h"

namespace camber {
namespace {

/// The pixels of the window's tracks, by frame; of at least `least` frames.
std::vector<WindowPoint> observed_points(const std::vector<FeatureTrack>& tracks, std::size_t first,
                                         std::size_t count, std::size_t least) {
  std::vector<WindowPoint> out;
  for (const FeatureTrack& track : tracks) {
    const std::size_t end = std::min(track.first + track.pixels.size(), first + count);
    const std::size_t begin = std::max(track.first, first);
    if (begin + least > end) continue;
    WindowPoint point;
    for (std::size_t k = begin; k < end; ++k) {
      point.seen.push_back({static_cast<int>(k - first), track.pixels[k - track.first]});
    }
    out.push_back(std::move(point));
  }
  return out;
}

/// The tracks that the reference shows as matches of a pinhole camera; the lens is taken out.
Correspondences matches_of(const DriveLens& lens, const std::vector<WindowPoint>& points,
                           std::size_t count, std::size_t reference) {
  const PinholeCamera pinhole = lens.pinhole();
  Correspondences out;
  out.reference = static_cast<int>(reference);
  out.rows = 1;
  for (std::size_t k = 0; k < count; ++k) {
    if (k != reference) out.matches.push_back({static_cast<int>(k), {}, {}});
  }
  for (const WindowPoint& point : points) {
    std::vector<std::optional<Eigen::Vector2f>> at(count);
    for (const WindowObservation& seen : point.seen) {
      const auto ray = lens.ray(seen.pixel);
      if (!ray) continue;
      at[static_cast<std::size_t>(seen.frame)] =
          (Eigen::Vector2d(pinhole.cx, pinhole.cy) + lens.f * ray->head<2>()).cast<float>();
    }
    if (!at[reference]) continue;
    out.pixels.push_back(*at[reference]);
    out.texture.emplace_back(100.0F, 0.0F, 100.0F);
    for (MatchedImage& match : out.matches) {
      const auto& pixel = at[static_cast<std::size_t>(match.frame)];
      match.pixels.push_back(pixel.value_or(Eigen::Vector2f::Zero()));
      match.round_trip_px.push_back(pixel ? 0.1F : std::numeric_limits<float>::infinity());
    }
  }
  out.columns = static_cast<int>(out.pixels.size());
  return out;
}

/// Direction and inverse distance from all frames that see the point; false where they do not
/// agree.
bool triangulate_point(const DriveLens& lens, const std::vector<SE3>& poses, double most_px,
                       WindowPoint* point) {
  Eigen::Matrix4d sum = Eigen::Matrix4d::Zero();
  Eigen::Vector3d some = Eigen::Vector3d::Zero();
  for (const WindowObservation& seen : point->seen) {
    const auto ray = lens.ray(seen.pixel);
    if (!ray) return false;
    const SE3& pose = poses[static_cast<std::size_t>(seen.frame)];
    Eigen::Matrix<double, 3, 4> project;
    project.leftCols<3>() = pose.rotation_matrix();
    project.col(3) = pose.translation();
    const Eigen::Matrix<double, 3, 4> rows = skew(ray->normalized()) * project;
    sum += rows.transpose() * rows;
    some += pose.rotation().inverse() * ray->normalized();
  }
  const Eigen::JacobiSVD<Eigen::Matrix4d> svd(sum, Eigen::ComputeFullV);
  Eigen::Vector4d x = svd.matrixV().col(3);
  const double length = x.head<3>().norm();
  if (!(length > 1e-12)) return false;
  x /= length;
  if (x.head<3>().dot(some) < 0.0) x = -x;
  point->direction = x.head<3>();
  point->inverse_distance = std::max(x(3), 0.0);
  for (const WindowObservation& seen : point->seen) {
    const SE3& pose = poses[static_cast<std::size_t>(seen.frame)];
    const auto pixel = lens.pixel(pose.rotation() * point->direction +
                                  point->inverse_distance * pose.translation());
    if (!pixel || (*pixel - seen.pixel).norm() > most_px) return false;
  }
  return true;
}

}  // namespace

std::optional<CalibrationWindow> start_window(const DriveLens& lens,
                                              const std::vector<FeatureTrack>& tracks,
                                              std::size_t first, std::size_t count,
                                              const WindowStartOptions& options) {
  constexpr double kColumns = 1242.0;
  const double inlier_px = options.inlier_px * std::max(0.5, lens.width / kColumns);
  CalibrationWindow out;
  out.first = first;
  out.reference = count / 2;
  const std::vector<WindowPoint> points = observed_points(tracks, first, count, 3);
  const Correspondences matches = matches_of(lens, points, count, out.reference);
  if (matches.columns < options.least_points) return std::nullopt;
  MotionOptions motion_options;
  motion_options.seed = options.seed;
  motion_options.inlier_px = inlier_px;
  motion_options.num_threads = 1;
  const std::vector<std::uint8_t> usable(matches.pixels.size(), 1);
  const MotionEstimate motion = estimate_motion(lens.pinhole(), matches, usable, motion_options);
  if (motion.status != Status::kOk) return std::nullopt;
  out.frame_from_reference = motion.frame_from_reference;
  for (WindowPoint point : points) {
    if (triangulate_point(lens, out.frame_from_reference, 3.0 * inlier_px, &point)) {
      out.points.push_back(std::move(point));
    }
  }
  if (static_cast<int>(out.points.size()) < options.least_points) return std::nullopt;
  return out;
}

}  // namespace camber
