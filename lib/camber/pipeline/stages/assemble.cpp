#include "camber/pipeline/stages/assemble.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "camber/core/threads.h"
#include "camber/pipeline/stages/detail/ground_graph.h"
#include "camber/pipeline/stages/detail/patch_status.h"
#include "camber/pipeline/stages/detail/relative_sigma.h"
#include "camber/road/plan_polygon.h"
#include "camber/scale/fusion.h"
#include "camber/scene/evidence_json.h"

namespace camber::stages {
namespace {

/// The planes of the graph given the vehicles that do not contradict them: functions of the road
/// and of the unevenness under each vehicle.
struct ChangedPlanes {
  Eigen::VectorXd changes;  // rows as in the graph's covariance; empty without vehicles
  Eigen::MatrixXd covariance;
};

ChangedPlanes planes_given_vehicles(const ScaledRoad& scaled, const JudgedRoad& judged,
                                    const PlacedVehicles& vehicles, const GroundGraph& graph,
                                    const ScaleNoise& noise) {
  ChangedPlanes out;
  out.covariance = graph.planes.covariance;
  const Eigen::Index rows = out.covariance.rows();
  if (rows == 0) return out;
  out.changes = Eigen::VectorXd::Zero(rows);
  Eigen::Index count = 0;
  for (std::size_t i = 0; i < vehicles.constraints.size(); ++i) {
    if (judged.of_vehicles[i].accepted) count += vehicles.constraints[i].constraint.size();
  }
  if (count == 0) return out;
  Eigen::MatrixXd by_ground = Eigen::MatrixXd::Zero(count, rows);
  Eigen::VectorXd residual(count), variance(count), by_scale(count);
  Eigen::Index at = 0;
  for (std::size_t i = 0; i < vehicles.constraints.size(); ++i) {
    if (!judged.of_vehicles[i].accepted) continue;
    const VehicleConstraint& v = vehicles.constraints[i];
    const Eigen::Index size = v.variance.size();
    by_ground.block(at, rows - v.by_ground.cols(), size, v.by_ground.cols()) = v.by_ground;
    residual.segment(at, size) = v.constraint.residual;
    variance.segment(at, size) = v.variance;
    by_scale.segment(at, size) =
        noise.vehicle_population * by_whole_scale(scaled.road, v.constraint);
    at += size;
  }
  const Eigen::MatrixXd side = out.covariance * by_ground.transpose();
  Eigen::MatrixXd spread = by_ground * side;
  spread.diagonal() += variance;
  spread += by_scale * by_scale.transpose();
  const Eigen::LDLT<Eigen::MatrixXd> ldlt(spread);
  out.changes = side * ldlt.solve(residual);
  out.covariance -= side * ldlt.solve(side.transpose());
  return out;
}

/// Rise of a plane along a direction, over its level run.
double slope_along(const Eigen::Vector3d& along, const Eigen::Vector3d& up) {
  const double rise = along.dot(up);
  return std::atan2(rise, (along - rise * up).norm());
}

void set_extent(PlanePatch& patch, double ahead, double behind, double half_width,
                const Eigen::Vector3d& up) {
  patch.boundary.clear();
  for (const auto& [a, b] : {std::pair{ahead, half_width}, std::pair{ahead, -half_width},
                             std::pair{-behind, -half_width}, std::pair{-behind, half_width}}) {
    patch.boundary.emplace_back(patch.plane.centroid + a * patch.plane.axis1 +
                                b * patch.plane.axis2);
  }
  patch.grade = slope_along(patch.plane.axis1, up);
  patch.bank = slope_along(patch.plane.axis2, up);
}

PlanPolygon boundary_in_plan(const PlanePatch& patch, const GroundAxes& axes) {
  PlanPolygon out;
  for (const Eigen::Vector3d& corner : patch.boundary) out.push_back(axes(corner));
  return out;
}

/// Links of the graph that was solved, with the patches as they are in the end.
std::vector<PatchLink> links_of(const GroundGraph& graph, const Eigen::VectorXd& changes,
                                const RoadSurface& surface) {
  const GroundAxes axes(surface.up);
  std::vector<PatchLink> out;
  for (const PlaneGraphLink& of_graph : graph.planes.links) {
    const PlanePatch* a = surface.find(graph.ids[of_graph.parent]);
    const PlanePatch* b = surface.find(graph.ids[of_graph.child]);
    if (!a || !b) continue;
    PatchLink link;
    link.a = a->id;
    link.b = b->id;
    link.valid = of_graph.valid;
    link.reason = of_graph.reason;
    link.distance = polygon_gap(boundary_in_plan(*a, axes), boundary_in_plan(*b, axes)).distance;
    const Eigen::Vector3d between = 0.5 * (a->plane.centroid + b->plane.centroid);
    link.height_step =
        a->plane.plane.signed_distance(between) - b->plane.plane.signed_distance(between);
    link.angle = angle_between(a->plane.plane.normal, b->plane.plane.normal);
    link.weight = 1.0 / (of_graph.step_sigma * of_graph.step_sigma + 1e-6);
    if (link.valid) {
      link.residual_sigma =
          changes.size() > 0 ? graph.planes.residual_sigma(of_graph, changes) : 0.0;
    }
    out.push_back(std::move(link));
  }
  return out;
}

/// What became of the photometric refinement where a patch lies.
std::string refinement_of(const PhotometricGround& ground, const Box2& around) {
  if (!ground.field) return ground.rejection.empty() ? "" : "refused: " + ground.rejection;
  return ground.rejected_blocks.share(around) > 0.5
             ? "refused: pixels left out agree less than before"
             : "accepted";
}

PlanePatch ego_patch(const EgoPlane& ego, const RoadPosterior& road, const Eigen::Vector3d& up) {
  PlanePatch out;
  out.plane = road.ego();
  out.inliers = ego.points;
  out.status = ego.status;
  out.reason = ego.reason;
  set_extent(out, 5.0, 2.0, 2.0, up);
  return out;
}

PlanePatch road_patch(const PhotometricGround& ground, const RoadPosterior& road,
                      const PinholeCamera& camera, const PatchFootprint& footprint,
                      const Eigen::Vector3d& up) {
  PlanePatch out;
  out.id = footprint.id;
  out.kind = footprint.kind;
  const LocalPlane fit = fit_local_plane(road, camera, footprint.contact, footprint.local);
  out.inliers = footprint.inliers;
  out.refinement = refinement_of(ground, footprint.around);
  if (fit.status == Status::kFailed) {
    out.status = Status::kFailed;
    out.reason = fit.reason;
    return out;
  }
  out.plane = fit.plane;
  const detail::Judgement judged = detail::patch_status(out.plane, footprint.unobserved);
  out.status = judged.status;
  out.reason = judged.reason;
  set_extent(out, footprint.ahead, 0.5 * footprint.local.length, footprint.local.half_width, up);
  return out;
}

/// The plane of a detection's support after the vehicles' messages, frame of the support.
UncertainPlane changed(const UncertainPlane& before, const Eigen::Vector3d& change,
                       const Eigen::Matrix3d& covariance) {
  UncertainPlane out = before;
  out.plane = before.perturbed(change);
  out.centroid = out.plane.foot(before.centroid);
  UncertainPlane::make_axes(out.plane.normal, before.axis1, &out.axis1, &out.axis2);
  out.covariance = covariance;
  return out;
}

/// The plane under one detection: by the road and the other vehicles and, where the vehicle was
/// placed with it, by its own fit, which down-weights a plane that it contradicts.
UncertainPlane plane_under(const SupportPlane& support, const VehicleEstimate& vehicle,
                           const Eigen::Vector3d& change, const Eigen::Matrix3d& covariance) {
  UncertainPlane out = changed(support.plane, change, covariance);
  const bool placed = vehicle.status != Status::kFailed && vehicle.status != Status::kNotRun &&
                      std::isfinite(vehicle.reprojection_rmse_px) &&
                      std::isfinite(vehicle.plane_sigma_height);
  if (!placed) return out;
  out.plane = vehicle.plane;
  out.centroid = vehicle.plane.foot(vehicle.pose.bottom_center());
  UncertainPlane::make_axes(out.plane.normal, support.plane.axis1, &out.axis1, &out.axis2);
  out.covariance.row(2).setZero();
  out.covariance.col(2).setZero();
  out.covariance(2, 2) = vehicle.plane_sigma_height * vehicle.plane_sigma_height;
  return out;
}

/// A vehicle, or the plane under it, that was placed with metres which are less known since: as a
/// whole it is nearer and smaller, or farther and larger.
void widen_scale(double log_scale_variance, VehicleEstimate* vehicle) {
  if (log_scale_variance <= 0.0) return;
  const Eigen::Vector3d center = vehicle->pose.center();
  vehicle->covariance.topLeftCorner<3, 3>() += log_scale_variance * center * center.transpose();
}

void widen_scale(double log_scale_variance, UncertainPlane* plane) {
  const double offset = plane->plane.offset;
  plane->covariance(2, 2) += log_scale_variance * offset * offset;
}

/// Where a vehicle contradicts its ground one of the two is wrong: the plane's spread holds both.
void widen(const SupportPlane& support, const std::string& reason, UncertainPlane* plane,
           PlanePatch* patch) {
  const double step = support.plane.plane.signed_distance(plane->centroid);
  const double tilt = angle_between(support.plane.plane.normal, plane->plane.normal);
  plane->covariance.diagonal() += Eigen::Vector3d(tilt * tilt, tilt * tilt, step * step);
  patch->status = Status::kWeak;
  patch->reason = reason;
}

/// For each detection why its vehicle contradicts its ground; empty: it does not.
std::vector<std::vector<std::string>> contradictions(const JudgedRoad& judged,
                                                     const PlacedVehicles& placed) {
  std::vector<std::vector<std::string>> out;
  for (const TrackFrame& view : placed.views) out.emplace_back(view.detections.size());
  for (std::size_t i = 0; i < placed.constraints.size(); ++i) {
    if (judged.of_vehicles[i].accepted) continue;
    for (const TrackView& at : placed.constraints[i].views) {
      out[at.frame][at.detection] =
          fmt::format("the vehicle on it contradicts it by {:.1f} standard deviations",
                      judged.of_vehicles[i].residual_sigma);
    }
  }
  return out;
}

/// Patches under vehicles with their links, and the vehicles' stated planes.
void add_vehicle_patches(const LoadedFrames& frames, const PhotometricGround& ground,
                         const JudgedRoad& judged, const ChangedPlanes& planes,
                         const SurfacePlan& plan, const PlacedVehicles& placed,
                         RoadSurface* surface, std::vector<std::vector<VehicleEstimate>>* out) {
  const std::vector<std::vector<std::string>> contradicted = contradictions(judged, placed);
  const Eigen::Index before_vehicles =
      placed.ground.planes.covariance.rows() - placed.ground.under_detections.covariance.rows();
  for (std::size_t k = 0; k < placed.views.size(); ++k) {
    const SE3& reference_from_frame = placed.views[k].world_from_camera;
    for (std::size_t j = 0; j < placed.views[k].detections.size(); ++j) {
      const std::optional<PatchFootprint>& footprint = plan.under_vehicles[k][j];
      if (!footprint) continue;
      const SupportPlane& support = placed.views[k].supports[j];
      VehicleEstimate& vehicle = (*out)[k][j];
      const Eigen::Index in_ground = placed.ground.under_detections.rows[k][j];
      const Eigen::Index row = in_ground + before_vehicles;
      UncertainPlane here = in_ground < 0
                                ? support.plane
                                : plane_under(support, vehicle, planes.changes.segment<3>(row),
                                              planes.covariance.block<3, 3>(row, row));
      PlanePatch patch = road_patch(ground, judged.road, frames.camera, *footprint, surface->up);
      widen_scale(judged.contradiction_variance, &here);
      if (!contradicted[k][j].empty()) widen(support, contradicted[k][j], &here, &patch);
      patch.without_vehicle = support.plane.transformed(reference_from_frame);
      patch.plane = here.transformed(reference_from_frame);
      set_extent(patch, footprint->ahead, 0.5 * footprint->local.length,
                 footprint->local.half_width, surface->up);
      vehicle.plane = here.plane;
      vehicle.plane_sigma_height = std::sqrt(here.height_variance(vehicle.pose.bottom_center()));
      surface->patches.push_back(std::move(patch));
    }
  }
}

RoadCloud road_cloud(const LoadedFrames& frames, const Correspondences& matches,
                     const PhotometricGround& ground, const RoadPosterior& road, bool metric,
                     const RoadSurface& surface, std::size_t road_patches, int num_threads) {
  constexpr double kPatchReach = 4.0;  // m along the road
  constexpr std::size_t kPiece = 2048;
  RoadCloud cloud;
  cloud.frame = CloudFrame::kCamera;
  cloud.metric = metric;
  const TriangulatedPoints& points = ground.ground.seen.points;
  const Image& image = frames.color[frames.reference];
  const std::vector<double>& weights = ground.ground.field->weights();
  const double m = road.metres_per_baseline();
  const detail::RelativeSigma of_road(road, frames.camera);
  const std::size_t count = points.size();
  cloud.points.resize(count);
  cloud.sigmas.resize(count);
  cloud.colors.resize(count);
  std::vector<int>& labels = cloud.labels["patch"];
  labels.assign(count, -1);
  parallel_for((count + kPiece - 1) / kPiece, num_threads, [&](std::size_t piece) {
    for (std::size_t i = kPiece * piece; i < std::min(count, kPiece * (piece + 1)); ++i) {
      const auto grid = static_cast<std::size_t>(points.grid[i]);
      const Eigen::Vector2d at = matches.pixels[grid].cast<double>();
      // A point moves with the ground around it, as far as the sources have moved that.
      const double before = points.inverse_depth[i] / m;
      const double moved = before + road.inverse_depth(at) - road.field().inverse_depth(at) / m;
      const Eigen::Vector3d p = points.rays[i] / (moved > 0.25 * before ? moved : before);
      cloud.points[i] = p.cast<float>();
      const double relative =
          std::hypot(points.sigma_own[i] / points.inverse_depth[i], of_road.at(at));
      cloud.sigmas[i] = static_cast<float>(p.norm() * relative);
      const std::size_t pixel = matches.image_index(grid, frames.camera.width);
      cloud.colors[i] = {image.data[3 * pixel], image.data[3 * pixel + 1],
                         image.data[3 * pixel + 2]};
      if (i >= weights.size() || !(weights[i] > 0.1)) continue;
      double best = kPatchReach;
      for (std::size_t j = 0; j < road_patches; ++j) {
        const PlanePatch& patch = surface.patches[j];
        const double along = std::abs((p - patch.plane.centroid).dot(patch.plane.axis1));
        if (along < best) {
          best = along;
          labels[i] = patch.id;
        }
      }
    }
  });
  return cloud;
}

/// Vehicles frame by frame; a frame without any keeps its entry.
VehicleDocument vehicle_document(const LoadedFrames& frames, const PlacedVehicles& placed,
                                 std::vector<std::vector<VehicleEstimate>> vehicles,
                                 VehicleMethod method, bool metric) {
  VehicleDocument out;
  out.method = to_string(method);
  out.detections_source = frames.detections_source;
  out.metric = metric;
  for (std::size_t k = 0; k < vehicles.size(); ++k) {
    for (std::size_t j = 0; j < vehicles[k].size(); ++j) vehicles[k][j].track = placed.tracks[k][j];
    out.frames.push_back({frames.frames[k].id, std::move(vehicles[k])});
  }
  return out;
}

RunDocument run_document(const LoadedFrames& frames, const PhotometricGround& ground,
                         const JudgedRoad& judged) {
  RunDocument out;
  const double m = judged.road.metres_per_baseline();
  for (std::size_t k = 0; k < frames.size(); ++k) {
    out.cameras.push_back({frames.frames[k].id, metric_pose(ground.motion, k, m).inverse()});
  }
  out.input_hashes = frames.input_hashes;
  out.metric = judged.metric;
  out.scale = m;
  out.constraints = judged.reports;
  (*out.extra)["evidence"] = to_json(judged.evidence);
  out.warnings = judged.warnings;
  out.points_kept.emplace_back("road", static_cast<long>(ground.ground.seen.points.size()));
  out.points_kept.emplace_back("motion", ground.motion.points);
  for (std::size_t r = 0; r < kNumDropReasons; ++r) {
    out.points_dropped.emplace_back(to_string(static_cast<DropReason>(r)),
                                    ground.ground.seen.points.dropped[r]);
  }
  return out;
}

}  // namespace

AssembledRoad assemble(const LoadedFrames& frames, const Correspondences& matches,
                       const PhotometricGround& ground, const ScaledRoad& scaled,
                       const SurfacePlan& plan, const PlacedVehicles& placed,
                       const JudgedRoad& judged, VehicleMethod method,
                       const AssembleOptions& options) {
  // Without vehicles in the joint problem the graph is that of the road alone.
  const GroundGraph graph = placed.ground.planes.covariance.size() > 0
                                ? placed.ground
                                : detail::ground_graph(scaled.road, plan, {});
  const ChangedPlanes planes = planes_given_vehicles(scaled, judged, placed, graph, options.noise);
  const RoadPosterior& road = judged.road;
  AssembledRoad out;
  RoadSurface& surface = out.surface;
  surface.metric = judged.metric;
  surface.ego_patch = 0;
  surface.patches.push_back(ego_patch(ground.ground.ego, road, surface.up));
  surface.patches.resize(1 + plan.road.size());
  parallel_for(plan.road.size(), options.num_threads, [&](std::size_t i) {
    surface.patches[1 + i] = road_patch(ground, road, frames.camera, plan.road[i], surface.up);
  });
  const std::size_t road_patches = surface.patches.size();
  for (const Eigen::Vector3d& p : ground.ground.ego.line) {
    surface.driven_line.push_back(road.metres_per_baseline() * p);
  }
  std::vector<std::vector<VehicleEstimate>> vehicles = placed.estimates;
  for (std::vector<VehicleEstimate>& of_frame : vehicles) {
    for (VehicleEstimate& v : of_frame) widen_scale(judged.contradiction_variance, &v);
  }
  if (method == VehicleMethod::kJoint) {
    add_vehicle_patches(frames, ground, judged, planes, plan, placed, &surface, &vehicles);
  }
  if (method != VehicleMethod::kReprojection) {
    for (std::vector<VehicleEstimate>& of_frame : vehicles) {
      for (VehicleEstimate& v : of_frame) detail::state_ground(&v);
    }
  }
  surface.links = links_of(graph, planes.changes, surface);
  out.vehicles = vehicle_document(frames, placed, std::move(vehicles), method, judged.metric);
  out.cloud = road_cloud(frames, matches, ground, road, judged.metric, surface, road_patches,
                         options.num_threads);
  out.run = run_document(frames, ground, judged);
  state(judged.scale, &out.run, &surface);
  out.scale_by_focal = scaled.scale_by_focal;
  return out;
}

}  // namespace camber::stages
