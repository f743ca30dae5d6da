#include "camber/pipeline/stages/paper_assemble.h"

#include <cmath>

#include "camber/pipeline/stages/detail/patch_status.h"
#include "camber/pipeline/stages/judge.h"
#include "camber/road/consistency_graph.h"
#include "camber/road/plan_polygon.h"
#include "camber/vehicle/paper/joint_fit.h"

namespace camber::stages {
namespace {

/// Corners on a plane above and below places in the plan.
std::vector<Eigen::Vector3d> on_plane(const Plane& plane, const PlanPolygon& polygon,
                                      const GroundAxes& axes, const Eigen::Vector3d& up) {
  std::vector<Eigen::Vector3d> out;
  for (const Eigen::Vector2d& corner : polygon) {
    const Eigen::Vector3d x = corner.x() * axes.e1 + corner.y() * axes.e2;
    out.emplace_back(x - plane.signed_distance(x) / plane.normal.dot(up) * up);
  }
  return out;
}

/// The plan of a place's surroundings: a rectangle along the camera's view.
PlanPolygon rectangle(const Eigen::Vector3d& middle, double behind, double ahead, double half_width,
                      const GroundAxes& axes) {
  PlanPolygon out;
  for (const auto& [x, z] : {std::pair{-half_width, -behind}, std::pair{half_width, -behind},
                             std::pair{half_width, ahead}, std::pair{-half_width, ahead}}) {
    out.push_back(axes(middle + Eigen::Vector3d(x, 0.0, z)));
  }
  return out;
}

UncertainPlane metric_plane(UncertainPlane plane, double metres_per_baseline) {
  plane.plane.offset *= metres_per_baseline;
  plane.centroid *= metres_per_baseline;
  plane.covariance.row(2) *= metres_per_baseline;
  plane.covariance.col(2) *= metres_per_baseline;
  return plane;
}

/// Relative standard deviation of the scale: of the ego plane's height, and of the camera's.
double scale_sigma_of(const LoadedFrames& frames, const MotionEstimate& motion,
                      const PaperGround& ground) {
  if (motion.metres_per_baseline) return motion.baseline_sigma;
  const double height = std::abs(ground.ego.plane.plane.offset);
  const double camera = frames.known.camera_height.value_or(1.0);
  return std::hypot(
      std::sqrt(std::max(ground.ego.plane.covariance(2, 2), 0.0)) / std::max(height, 1e-9),
      frames.known.camera_height_sigma / camera);
}

PlanePatch ego_patch(const PaperGround& ground, const RoadSurface& surface,
                     const GroundAxes& axes) {
  PlanePatch out;
  out.plane = metric_plane(ground.ego.plane, ground.metres_per_baseline);
  out.inliers = ground.ego.points;
  out.status = ground.ego.status;
  out.reason = ground.ego.reason;
  out.boundary = on_plane(out.plane.plane, rectangle(out.plane.centroid, 2.0, 5.0, 2.0, axes), axes,
                          surface.up);
  return out;
}

/// One patch a plane, with what the joint problem made of the plane of the vehicle on it.
void add_vehicle_patches(const TriangulatedPoints& points, const PaperGround& ground,
                         const PlacedVehicles& placed, RoadSurface* surface) {
  const GroundAxes axes(surface->up);
  for (std::size_t k = 0; k < placed.views.size(); ++k) {
    for (std::size_t j = 0; j < placed.views[k].detections.size(); ++j) {
      const int index = ground.own.empty() ? -1 : ground.own[k][j];
      if (index < 0) continue;
      const RansacPlane& found = ground.planes[static_cast<std::size_t>(index)];
      const VehicleEstimate& vehicle = placed.estimates[k][j];
      PlanePatch patch;
      patch.id = index + 1;
      patch.inliers = static_cast<int>(found.inliers.size());
      patch.plane = found.plane;
      const detail::Judgement judged = detail::patch_status(found.plane, "");
      patch.status = judged.status;
      patch.reason = judged.reason;
      if (std::isfinite(vehicle.reprojection_rmse_px)) {
        patch.without_vehicle = found.plane;
        const SE3& reference_from_frame = placed.views[k].world_from_camera;
        patch.plane.plane = vehicle.plane.transformed(reference_from_frame);
        patch.plane.centroid = patch.plane.plane.foot(found.plane.centroid);
        UncertainPlane::make_axes(patch.plane.plane.normal, found.plane.axis1, &patch.plane.axis1,
                                  &patch.plane.axis2);
      }
      std::vector<Eigen::Vector2d> plan;
      for (const int i : found.inliers) {
        plan.push_back(axes(found.metres_per_baseline * points.point(static_cast<std::size_t>(i))));
      }
      patch.boundary = on_plane(patch.plane.plane, convex_hull(std::move(plan)), axes, surface->up);
      surface->patches.push_back(std::move(patch));
    }
  }
}

RoadCloud road_cloud(const LoadedFrames& frames, const Correspondences& matches,
                     const TriangulatedPoints& points, const PaperGround& ground) {
  RoadCloud out;
  const Image& image = frames.color[frames.reference];
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Eigen::Vector3d p = ground.metres_per_baseline * points.point(i);
    out.points.push_back(p.cast<float>());
    out.sigmas.push_back(
        static_cast<float>(p.norm() * points.sigma_own[i] / points.inverse_depth[i]));
    const std::size_t pixel =
        matches.image_index(static_cast<std::size_t>(points.grid[i]), frames.camera.width);
    out.colors.push_back(
        {image.data[3 * pixel], image.data[3 * pixel + 1], image.data[3 * pixel + 2]});
  }
  std::vector<int>& labels = out.labels["patch"];
  labels.assign(points.size(), -1);
  for (std::size_t k = ground.planes.size(); k-- > 0;) {  // the first of several holds a point
    for (const int i : ground.planes[k].inliers) {
      labels[static_cast<std::size_t>(i)] = static_cast<int>(k) + 1;
    }
  }
  return out;
}

RunDocument run_document(const LoadedFrames& frames, const MotionEstimate& motion,
                         const GroundPoints& seen, const PaperGround& ground) {
  RunDocument out;
  for (std::size_t k = 0; k < frames.size(); ++k) {
    out.cameras.push_back(
        {frames.frames[k].id, metric_pose(motion, k, ground.metres_per_baseline).inverse()});
  }
  out.input_hashes = frames.input_hashes;
  out.metric = ground.metric;
  out.scale = ground.metres_per_baseline;
  out.points_kept.emplace_back("road", static_cast<long>(seen.points.size()));
  out.points_kept.emplace_back("motion", motion.points);
  for (std::size_t r = 0; r < kNumDropReasons; ++r) {
    out.points_dropped.emplace_back(to_string(static_cast<DropReason>(r)), seen.points.dropped[r]);
  }
  return out;
}

}  // namespace

AssembledRoad assemble_paper(const LoadedFrames& frames, const Correspondences& matches,
                             const MotionEstimate& motion, const GroundPoints& seen,
                             const PaperGround& ground, const PlacedVehicles& placed,
                             VehicleMethod method) {
  AssembledRoad out;
  RoadSurface& surface = out.surface;
  surface.metric = ground.metric;
  surface.ego_patch = 0;
  surface.patches.push_back(ego_patch(ground, surface, GroundAxes(surface.up)));
  for (const Eigen::Vector3d& p : ground.ego.line) {
    surface.driven_line.push_back(ground.metres_per_baseline * p);
  }
  if (method == VehicleMethod::kJoint) {
    add_vehicle_patches(seen.points, ground, placed, &surface);
  }
  ConsistencyOptions links;
  links.consistency = Consistency::kPaper;
  links.link_distance = paper::JointFitOptions().link_reach;
  surface.links = find_links(surface, links);
  align_patches_with_road(&surface);
  out.cloud = road_cloud(frames, matches, seen.points, ground);
  out.run = run_document(frames, motion, seen, ground);
  state(judge_alone(scale_sigma_of(frames, motion, ground), ground.metric,
                    "no source of metres: those of the paper's preset are the camera's height and "
                    "known poses"),
        &out.run, &surface);
  out.vehicles.method = to_string(method);
  out.vehicles.detections_source = frames.detections_source;
  out.vehicles.metric = ground.metric;
  for (std::size_t k = 0; k < frames.size(); ++k) {
    VehicleFrame frame{frames.frames[k].id, {}};
    if (k < placed.estimates.size()) frame.vehicles = placed.estimates[k];
    out.vehicles.frames.push_back(std::move(frame));
  }
  return out;
}

}  // namespace camber::stages
