#include "camber/pipeline/stages/paper_ground.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <stdexcept>

#include "camber/core/median.h"
#include "camber/pipeline/stages/detail/ground_steps.h"
#include "camber/plane/dominant_plane_pcl.h"

namespace camber {

std::string to_string(PaperScale scale) { return scale == PaperScale::kEgo ? "ego" : "patch"; }

PaperScale paper_scale_from_string(const std::string& name) {
  if (name == "ego") return PaperScale::kEgo;
  if (name == "patch") return PaperScale::kPatch;
  throw std::invalid_argument(fmt::format("scale: \"{}\", must be ego or patch", name));
}

namespace stages {
namespace {

const Eigen::Vector3d kUp(0.0, -1.0, 0.0);

/// Dominant plane of chosen points, in metres of a given scale.
RansacPlane dominant_plane(const TriangulatedPoints& points, const std::vector<int>& chosen,
                           double metres_per_baseline, double camera_height,
                           const PaperGroundOptions& options) {
  RansacPlane out;
  out.points = static_cast<int>(chosen.size());
  out.metres_per_baseline = metres_per_baseline;
  out.status = Status::kFailed;
  if (out.points < options.least_points) {
    out.reason = fmt::format("{} road points, {} are needed", out.points, options.least_points);
    return out;
  }
  std::vector<Eigen::Vector3d> metric;
  std::vector<double> noise;  // m, across the plane: the depth's error seen at a grazing angle
  for (const int i : chosen) {
    const auto at = static_cast<std::size_t>(i);
    metric.emplace_back(metres_per_baseline * points.point(at));
    noise.push_back(camera_height * points.sigma_own[at] / points.inverse_depth[at]);
  }
  constexpr double kNoise = 1.5, kWidest = 0.5;  // sigmas; m
  DominantPlaneOptions ransac;
  ransac.max_tilt = options.max_tilt;
  ransac.inlier_threshold =
      std::clamp(kNoise * upper_median(noise), options.inlier_threshold, kWidest);
  const DominantPlane found = dominant_plane_pcl(metric, ransac);
  if (found.status == Status::kFailed) {
    out.reason = found.reason;
    return out;
  }
  const Plane& plane = found.plane;
  Eigen::Vector3d centroid = Eigen::Vector3d::Zero();
  for (const int i : found.inliers) {
    out.inliers.push_back(chosen[static_cast<std::size_t>(i)]);
    centroid += metric[static_cast<std::size_t>(i)];
  }
  out.plane.plane = plane;
  out.plane.centroid = plane.foot(centroid / static_cast<double>(out.inliers.size()));
  UncertainPlane::make_axes(plane.normal, Eigen::Vector3d(0.0, 0.0, 1.0), &out.plane.axis1,
                            &out.plane.axis2);
  out.status = Status::kOk;
  return out;
}

void set_sigmas(double tilt, double height, UncertainPlane* plane) {
  plane->covariance = Eigen::Vector3d(tilt * tilt, tilt * tilt, height * height).asDiagonal();
}

/// Median of the inliers' y as printed, m.
double median_y(const TriangulatedPoints& points, const RansacPlane& plane) {
  std::vector<double> y;
  for (const int i : plane.inliers) {
    y.push_back(plane.metres_per_baseline * points.point(static_cast<std::size_t>(i)).y());
  }
  return upper_median(std::move(y));
}

void rescale(double factor, RansacPlane* plane) {
  plane->plane.plane.offset *= factor;
  plane->plane.centroid *= factor;
  plane->metres_per_baseline *= factor;
}

}  // namespace

namespace {

/// Indices of the ground points that a box of frame k's image holds.
std::vector<int> points_inside(const LoadedFrames& frames, const Correspondences& matches,
                               const MotionEstimate& motion, const TriangulatedPoints& points,
                               std::size_t k, const Box2& box) {
  std::vector<int> out;
  for (std::size_t i = 0; i < points.size(); ++i) {
    Eigen::Vector2d pixel = matches.pixels[static_cast<std::size_t>(points.grid[i])].cast<double>();
    if (k != frames.reference) {
      const auto there = frames.camera.project(motion.frame_from_reference[k] * points.point(i));
      if (!there) continue;
      pixel = *there;
    }
    if (box.contains(pixel)) out.push_back(static_cast<int>(i));
  }
  return out;
}

/// For each detection the nearest one that has a plane of its own: where their heights in the image
/// place them.
std::vector<int> with_neighbours(const PinholeCamera& camera,
                                 const std::vector<VehicleDetection>& detections,
                                 const std::vector<int>& own) {
  constexpr double kHeight = 1.5;  // m, of a car
  const auto place = [&](const VehicleDetection& d) -> Eigen::Vector3d {
    return camera.fy * kHeight / std::max(d.box.height(), 1.0) *
           camera.ray({d.box.center().x(), d.box.y2});
  };
  std::vector<int> out = own;
  for (std::size_t j = 0; j < detections.size(); ++j) {
    if (own[j] >= 0) continue;
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t i = 0; i < detections.size(); ++i) {
      if (own[i] < 0) continue;
      const double distance = (place(detections[i]) - place(detections[j])).norm();
      if (distance < least) {
        least = distance;
        out[j] = own[i];
      }
    }
  }
  return out;
}

}  // namespace

PaperGround paper_ground(const LoadedFrames& frames, const Correspondences& matches,
                         const MotionEstimate& motion, const Ground& ground,
                         const PaperGroundOptions& options) {
  if (frames.size() > 1) detail::require_seen(ground.ego);  // one image: it is given
  const double height = frames.known.camera_height.value_or(options.unknown_camera_height);
  const PaperPlaneSigmas& sigmas = options.sigmas;
  const TriangulatedPoints& points = ground.seen.points;
  PaperGround out;
  out.metric = frames.known.camera_height.has_value() || motion.metres_per_baseline.has_value();
  out.ego = ground.ego;
  out.metres_per_baseline = ground.metres_per_baseline;
  for (std::size_t k = 0; k < frames.size(); ++k) {
    std::vector<int> own;
    for (const VehicleDetection& detection : frames.frames[k].vehicles) {
      own.push_back(-1);
      if (detection.has_plane) continue;
      RansacPlane plane = dominant_plane(points,
                                         points_inside(frames, matches, motion, points, k,
                                                       detection.box.scaled(options.box_expansion)),
                                         out.metres_per_baseline, height, options);
      if (plane.status == Status::kFailed) continue;
      if (options.scale == PaperScale::kPatch && !motion.metres_per_baseline) {
        const double y = median_y(points, plane);
        // A patch at the camera's height or above it has no scale as printed.
        if (y > 0.1 * height) rescale(height / y, &plane);
      }
      set_sigmas(sigmas.own_tilt,
                 sigmas.own_height + sigmas.own_height_growth * plane.plane.centroid.squaredNorm(),
                 &plane.plane);
      own.back() = static_cast<int>(out.planes.size());
      out.planes.push_back(std::move(plane));
    }
    out.under_vehicles.push_back(with_neighbours(frames.camera, frames.frames[k].vehicles, own));
    out.own.push_back(std::move(own));
  }
  return out;
}

FrameGround ground_of_frame(const PaperGround& ground, const LoadedFrames& frames,
                            const MotionEstimate& motion, std::size_t frame,
                            const PaperGroundOptions& options, const SupportOptions& support) {
  const SE3 pose = metric_pose(motion, frame, ground.metres_per_baseline);
  FrameGround out;
  Plane ego = ground.ego.plane.plane;
  ego.offset *= ground.metres_per_baseline;
  out.ego = ego_support(ego, support);
  out.ego->plane = out.ego->plane.transformed(pose);
  for (std::size_t j = 0; j < frames.frames[frame].vehicles.size(); ++j) {
    const int index = ground.under_vehicles[frame][j];
    if (frames.frames[frame].vehicles[j].has_plane || index < 0) {
      out.local.emplace_back();
      continue;
    }
    const RansacPlane& plane = ground.planes[static_cast<std::size_t>(index)];
    SupportPlane local;
    local.plane = plane.plane;
    if (ground.own[frame][j] < 0) {
      set_sigmas(options.sigmas.neighbour_tilt, options.sigmas.neighbour_height, &local.plane);
    }
    local.plane = local.plane.transformed(pose);
    local.source = "patch " + std::to_string(index + 1);
    local.status = Status::kOk;
    out.local.push_back(std::move(local));
  }
  return out;
}

}  // namespace stages
}  // namespace camber
