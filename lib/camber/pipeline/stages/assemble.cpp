#include "camber/pipeline/stages/assemble.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "camber/core/errors.h"
#include "camber/core/threads.h"
#include "camber/pipeline/stages/detail/ground_graph.h"
#include "camber/pipeline/stages/detail/patch_status.h"
#include "camber/road/plan_polygon.h"
#include "camber/scale/fusion.h"
#include "camber/scale/vehicle_sizes.h"

namespace camber::stages {
namespace {

/// The road given the vehicles, and the planes under them given all but those that contradict it.
struct FinalRoad {
  RoadPosterior road;
  std::vector<ConstraintReport> reports;  // of the vehicles, in their order, then of all
  std::vector<RunDocument::Warning> warnings;
  Eigen::VectorXd plane_changes;  // rows as in the graph's covariance; empty without vehicles
  Eigen::MatrixXd plane_covariance;
  // Of the scale, by what contradicts it: in the road, not in what was placed on it before.
  double contradiction_variance = 0.0;

  void widen_scale(double log_scale_variance) {
    road = road.with_wider_scale(log_scale_variance);
    contradiction_variance += log_scale_variance;
  }
};

/// The vehicles against the road and its scale, which know nothing of them: their sizes together,
/// and how many of them contradict it one by one.
/// @throws NoAnswerError where nearly all do, and their sizes do not fit either.
void check_by_vehicles(const ScaledRoad& scaled, const std::vector<Constraint>& vehicles,
                       const ScaleNoise& noise, FinalRoad* final_road) {
  if (!scaled.metric) return;
  const auto contradict = [&](std::string text, double log_scale_variance) {
    final_road->warnings.push_back({"scale_contradicted", std::move(text)});
    final_road->widen_scale(log_scale_variance);
  };
  const auto beyond = [&](double sigmas) {
    return static_cast<std::size_t>(std::count_if(
        final_road->reports.begin(), final_road->reports.end(),
        [&](const ConstraintReport& r) { return !r.accepted && r.residual_sigma > sigmas; }));
  };
  const std::size_t rejected = beyond(0.0), contradicting = beyond(noise.vehicle_contradicts);
  const auto sizes = compare_vehicle_sizes(scaled.road, vehicles, noise);
  // One may well be beyond what the fusion takes; that all are is the road.
  constexpr std::size_t kLeast = 3, kLeastOfAll = 4;
  const bool most = vehicles.size() >= kLeast && 3 * contradicting > 2 * vehicles.size();
  const bool all = vehicles.size() >= kLeastOfAll && rejected == vehicles.size();
  if (most || all) {
    std::string text = fmt::format("{} of {} vehicles contradict the road under them",
                                   all ? rejected : contradicting, vehicles.size());
    // That their sizes fit a scale that is hardly known proves nothing.
    const bool sizes_fit = sizes && sizes->sigmas_off <= noise.vehicle_sizes_gate &&
                           std::hypot(scaled.road.scale_sigma(), sizes->sigma) < noise.metric_limit;
    if (sizes_fit) {
      final_road->warnings.push_back({"road_contradicted", text + "; their sizes fit the scale"});
    } else {
      throw NoAnswerError("the scale is not known: " + text +
                          ": are the camera's height and focal length right, and is the road near "
                          "the camera in view?");
    }
  }
  if (!sizes) return;
  const double sigmas = sizes->sigmas_off, change = sizes->log_scale;
  ConstraintReport report{"vehicle_sizes",
                          fmt::format("{} vehicles", sizes->vehicles),
                          sigmas,
                          sigmas <= noise.vehicle_sizes_gate,
                          {}};
  const double share =
      contradiction_share(sigmas, noise.vehicle_sizes_start, noise.vehicle_sizes_gate);
  if (report.accepted && share > 0.0) {
    final_road->widen_scale(share * change * change);
  }
  if (!report.accepted) {
    report.reason = fmt::format(
        "by their sizes everything is {:.0f} % {}, {:.1f} standard deviations",
        100.0 * std::abs(std::expm1(change)), change > 0.0 ? "larger" : "smaller", sigmas);
    contradict(report.source + ": " + report.reason, change * change);
  }
  final_road->reports.push_back(std::move(report));
}

/// The focal length against the vehicles' proportions and against broken lines: a wrong one
/// stretches the road along the optical axis, and the scale with it.
void check_focal_length(const ScaledRoad& scaled, const FocalLengthEvidence& vehicles,
                        const ScaleNoise& noise, FinalRoad* final_road) {
  double off = 0.0;  // of the focal length's logarithm
  const auto contradict = [&](const ConstraintReport& report, double factor) {
    final_road->warnings.push_back(
        {"focal_length_contradicted", report.source + ": " + report.reason});
    off = std::max(off, std::abs(std::log(factor)));
  };
  const DashFocalLength& dashes = scaled.dash_focal_length;
  if (dashes.strokes > 0) {
    const bool one = dashes.strokes == 1;
    const double sigmas = std::abs(std::log(dashes.factor)) / noise.dash_focal_length;
    ConstraintReport report{"focal_length",
                            one ? "a stroke of a broken line"
                                : fmt::format("{} strokes of broken lines", dashes.strokes),
                            sigmas,
                            sigmas <= noise.dash_focal_length_gate,
                            {}};
    if (!report.accepted) {
      report.reason = fmt::format(
          "{} with {:.2f} times the focal length, {:.1f} standard deviations",
          one ? "it has the known length" : "they have the known sizes", dashes.factor, sigmas);
      if (vehicles.asked_log_ratio > -noise.vehicles_against_dashes) {
        contradict(report, dashes.factor);
      } else {
        report.reason += "; vehicles' proportions contradict that, the known sizes may be wrong";
      }
    }
    final_road->reports.push_back(std::move(report));
  }
  if (vehicles.vehicles > 0) {
    const double sigmas = std::sqrt(2.0 * vehicles.gain);
    const bool one = vehicles.vehicles == 1;
    ConstraintReport report{"focal_length",
                            one ? "proportions of a vehicle"
                                : fmt::format("proportions of {} vehicles", vehicles.vehicles),
                            sigmas,
                            sigmas <= noise.focal_length_gate,
                            {}};
    if (!report.accepted) {
      report.reason = fmt::format(
          "they fit {:.1f} standard deviations better with {:.2f} times the focal length", sigmas,
          vehicles.factor);
      contradict(report, vehicles.factor);
    }
    final_road->reports.push_back(std::move(report));
  }
  // Of several that are contradicted, as by a turn, the largest counts.
  const double more = off * off - final_road->contradiction_variance;
  if (more > 0.0 && scaled.metric) final_road->widen_scale(more);
}

FinalRoad condition_on_vehicles(const ScaledRoad& scaled, const PlacedVehicles& vehicles,
                                const GroundGraph& graph, const ScaleNoise& noise) {
  std::vector<Constraint> constraints;
  for (const VehicleConstraint& v : vehicles.constraints) constraints.push_back(v.constraint);
  FusedRoad fused = fuse(scaled.road, constraints, noise.vehicle_population);
  FinalRoad out{std::move(fused.road), std::move(fused.reports), {}, {}, graph.planes.covariance};
  if (scaled.contradiction_variance > 0.0) {
    out.widen_scale(scaled.contradiction_variance);
  }
  out.warnings = scaled.contradictions;
  check_by_vehicles(scaled, constraints, noise, &out);
  check_focal_length(scaled, vehicles.focal_length, noise, &out);
  const Eigen::Index rows = out.plane_covariance.rows();
  if (rows == 0) return out;
  // The planes themselves: functions of the road and of the unevenness under each vehicle.
  out.plane_changes = Eigen::VectorXd::Zero(rows);
  Eigen::Index count = 0;
  for (std::size_t i = 0; i < constraints.size(); ++i) {
    if (out.reports[i].accepted) count += constraints[i].size();
  }
  if (count == 0) return out;
  Eigen::MatrixXd by_ground = Eigen::MatrixXd::Zero(count, rows);
  Eigen::VectorXd residual(count), variance(count), by_scale(count);
  Eigen::Index at = 0;
  for (std::size_t i = 0; i < constraints.size(); ++i) {
    if (!out.reports[i].accepted) continue;
    const VehicleConstraint& v = vehicles.constraints[i];
    const Eigen::Index size = v.variance.size();
    by_ground.block(at, rows - v.by_ground.cols(), size, v.by_ground.cols()) = v.by_ground;
    residual.segment(at, size) = v.constraint.residual;
    variance.segment(at, size) = v.variance;
    by_scale.segment(at, size) =
        noise.vehicle_population * by_whole_scale(scaled.road, v.constraint);
    at += size;
  }
  const Eigen::MatrixXd side = out.plane_covariance * by_ground.transpose();
  Eigen::MatrixXd spread = by_ground * side;
  spread.diagonal() += variance;
  spread += by_scale * by_scale.transpose();
  const Eigen::LDLT<Eigen::MatrixXd> ldlt(spread);
  out.plane_changes = side * ldlt.solve(residual);
  out.plane_covariance -= side * ldlt.solve(side.transpose());
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
std::vector<std::vector<std::string>> contradictions(const FinalRoad& road,
                                                     const PlacedVehicles& placed) {
  std::vector<std::vector<std::string>> out;
  for (const TrackFrame& view : placed.views) out.emplace_back(view.detections.size());
  for (std::size_t i = 0; i < placed.constraints.size(); ++i) {
    if (road.reports[i].accepted) continue;
    for (const TrackView& at : placed.constraints[i].views) {
      out[at.frame][at.detection] =
          fmt::format("the vehicle on it contradicts it by {:.1f} standard deviations",
                      road.reports[i].residual_sigma);
    }
  }
  return out;
}

/// Patches under vehicles with their links, and the vehicles' stated planes.
void add_vehicle_patches(const LoadedFrames& frames, const PhotometricGround& ground,
                         const FinalRoad& final_road, const SurfacePlan& plan,
                         const PlacedVehicles& placed, RoadSurface* surface,
                         std::vector<std::vector<VehicleEstimate>>* out) {
  const std::vector<std::vector<std::string>> contradicted = contradictions(final_road, placed);
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
      UncertainPlane here =
          in_ground < 0 ? support.plane
                        : plane_under(support, vehicle, final_road.plane_changes.segment<3>(row),
                                      final_road.plane_covariance.block<3, 3>(row, row));
      PlanePatch patch =
          road_patch(ground, final_road.road, frames.camera, *footprint, surface->up);
      widen_scale(final_road.contradiction_variance, &here);
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

/// Standard deviation of the road along the viewing rays over the distance, scale included, from a
/// coarse grid of pixels.
class RelativeSigma {
 public:
  RelativeSigma(const RoadPosterior& road, const PinholeCamera& camera)
      : top_(road.top()),
        du_((camera.width - 1.0) / (kColumns - 1)),
        dv_((camera.height - 1.0 - top_) / (kRows - 1)) {
    std::vector<Eigen::Vector2d> pixels;
    for (int r = 0; r < kRows; ++r) {
      for (int c = 0; c < kColumns; ++c) pixels.emplace_back(c * du_, top_ + r * dv_);
    }
    const auto n = static_cast<Eigen::Index>(pixels.size());
    const Eigen::VectorXd variance =
        road.variances(road.of_inverse_depths(pixels, Eigen::MatrixXd::Identity(n, n)));
    for (std::size_t i = 0; i < pixels.size(); ++i) {
      const double rho = std::max(road.inverse_depth(pixels[i]), 1e-3);
      values_.push_back(std::min(1.0, std::sqrt(variance[static_cast<Eigen::Index>(i)]) / rho));
    }
  }

  double at(const Eigen::Vector2d& pixel) const {
    const double x = std::clamp(pixel.x() / du_, 0.0, kColumns - 1.001);
    const double y = std::clamp((pixel.y() - top_) / dv_, 0.0, kRows - 1.001);
    const int c = static_cast<int>(x), r = static_cast<int>(y);
    const double ax = x - c, ay = y - r;
    const auto value = [&](int row, int column) {
      return values_[static_cast<std::size_t>(row * kColumns + column)];
    };
    return (1 - ay) * ((1 - ax) * value(r, c) + ax * value(r, c + 1)) +
           ay * ((1 - ax) * value(r + 1, c) + ax * value(r + 1, c + 1));
  }

 private:
  static constexpr int kColumns = 12, kRows = 12;
  double top_, du_, dv_;
  std::vector<double> values_;
};

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
  const RelativeSigma of_road(road, frames.camera);
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

/// Why a run has no metres: markings of known sizes may be there and yet not give them.
std::string without_metres(const LoadedFrames& frames, const ScaledRoad& scaled) {
  const LaneMarkingSizes& sizes = frames.known.markings;
  const std::string& why = scaled.markings.reason;
  if ((!sizes.dashes() && !sizes.stripes()) || why.empty()) return "no source of metres";
  return "no source of metres but lane markings: " + why;
}

RunDocument run_document(const LoadedFrames& frames, const PhotometricGround& ground,
                         const ScaledRoad& scaled, const FinalRoad& final_road) {
  RunDocument out;
  const double m = final_road.road.metres_per_baseline();
  for (std::size_t k = 0; k < frames.size(); ++k) {
    out.cameras.push_back({frames.frames[k].id, metric_pose(ground.motion, k, m).inverse()});
  }
  out.input_hashes = frames.input_hashes;
  out.metric = scaled.metric;
  out.scale = m;
  out.scale_sigma = final_road.road.scale_sigma();
  const detail::Judgement judged = detail::scale_status(out.scale_sigma);
  out.scale_status = scaled.metric ? judged.status : Status::kNotObservable;
  out.scale_reason = scaled.metric ? judged.reason : without_metres(frames, scaled);
  out.constraints = scaled.reports;
  out.constraints.insert(out.constraints.end(), final_road.reports.begin(),
                         final_road.reports.end());
  out.warnings = final_road.warnings;
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
                       const SurfacePlan& plan, const PlacedVehicles& placed, VehicleMethod method,
                       const AssembleOptions& options) {
  // Without vehicles in the joint problem the graph is that of the road alone.
  const GroundGraph graph = placed.ground.planes.covariance.size() > 0
                                ? placed.ground
                                : detail::ground_graph(scaled.road, plan, {});
  const FinalRoad final_road = condition_on_vehicles(scaled, placed, graph, options.noise);
  const RoadPosterior& road = final_road.road;
  AssembledRoad out;
  RoadSurface& surface = out.surface;
  surface.metric = scaled.metric;
  surface.scale_sigma = road.scale_sigma();
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
    for (VehicleEstimate& v : of_frame) widen_scale(final_road.contradiction_variance, &v);
  }
  if (method == VehicleMethod::kJoint) {
    add_vehicle_patches(frames, ground, final_road, plan, placed, &surface, &vehicles);
  }
  surface.links = links_of(graph, final_road.plane_changes, surface);
  out.vehicles = vehicle_document(frames, placed, std::move(vehicles), method, scaled.metric);
  out.cloud = road_cloud(frames, matches, ground, road, scaled.metric, surface, road_patches,
                         options.num_threads);
  out.run = run_document(frames, ground, scaled, final_road);
  return out;
}

}  // namespace camber::stages
