#include "camber/pipeline/stages/vehicles.h"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "camber/pipeline/stages/detail/ground_graph.h"
#include "camber/pipeline/stages/detail/patch_status.h"

namespace camber {

std::string to_string(VehicleMethod method) {
  switch (method) {
    case VehicleMethod::kJoint:
      return "joint";
    case VehicleMethod::kCoplanar:
      return "coplanar";
    case VehicleMethod::kReprojection:
      return "reprojection";
    case VehicleMethod::kFlat:
      break;
  }
  return "flat";
}

VehicleMethod vehicle_method_from_string(const std::string& word) {
  for (const VehicleMethod method : {VehicleMethod::kJoint, VehicleMethod::kCoplanar,
                                     VehicleMethod::kFlat, VehicleMethod::kReprojection}) {
    if (word == to_string(method)) return method;
  }
  throw std::invalid_argument(
      fmt::format("method: \"{}\", must be joint, coplanar, flat or reprojection", word));
}

namespace stages {
namespace {

const Eigen::Vector3d kUp(0.0, -1.0, 0.0);

SupportPlane support_of(const PinholeCamera& camera, const VehicleDetection& detection,
                        const std::optional<SupportPlane>& local,
                        const std::optional<SupportPlane>& ego, std::optional<double> camera_height,
                        const VehicleOptions& options) {
  const double height = camera_height.value_or(options.noise.unknown_camera_height);
  if (options.method == VehicleMethod::kFlat) return certain_support({kUp, height}, "level");
  if (options.method == VehicleMethod::kReprojection) {
    // So uncertain that it holds nothing: 20 m, 0.5 rad.
    SupportPlane out = certain_support({kUp, height}, "none");
    out.plane.covariance = Eigen::Vector3d(0.25, 0.25, 400.0).asDiagonal();
    return out;
  }
  if (options.method == VehicleMethod::kCoplanar) {
    if (!ego) return certain_support({kUp, height}, "level");
    SupportPlane out = certain_support(ego->plane.plane, "ego");
    out.status = ego->status;
    return out;
  }
  if (local) return *local;
  if (detection.has_plane) return given_support(camera, detection, options.support);
  if (ego) return *ego;
  SupportOptions level = options.support;
  if (!camera_height) level.level_sigma_height = options.noise.unknown_camera_height_sigma;
  return level_support(height, level);
}

/// A patch's plane in the camera of its frame.
SupportPlane support_from(const LocalPlane& plane, const PatchFootprint& footprint,
                          const SE3& frame_from_reference, const SupportOptions& options) {
  SupportPlane out;
  out.unmodelled_height = options.road_unmodelled_height;
  out.plane = plane.plane.transformed(frame_from_reference);
  out.source = "patch " + std::to_string(footprint.id);
  out.status = detail::patch_status(plane.plane, footprint.unobserved).status;
  return out;
}

/// Beyond what is seen: the last patch of the road, known to a metre and a few degrees.
SupportPlane last_patch(const RoadPosterior& road, const SurfacePlan& plan,
                        const SE3& frame_from_reference) {
  constexpr double kTilt = 0.05, kHeight = 1.0;  // rad, m
  SupportPlane out;
  out.status = Status::kNotObservable;
  UncertainPlane plane = road.ego();
  out.source = "patch 0";
  if (!plan.road.empty()) {
    const PatchFootprint& last = plan.road.back();
    plane = last.plane.plane;
    out.source = "patch " + std::to_string(last.id);
  }
  out.plane = plane.transformed(frame_from_reference);
  out.plane.covariance.diagonal() +=
      Eigen::Vector3d(kTilt * kTilt, kTilt * kTilt, kHeight * kHeight);
  return out;
}

/// Planes of the road under all detections, and which of them are the road's own.
struct GroundUnderVehicles {
  std::vector<FrameGround> frames;
  std::vector<LocalPlane> planes;  // those that are functions of the road
  std::vector<TrackView> at;       // of which detection each is
  LocalPlaneOptions local;
};

GroundUnderVehicles ground_under_vehicles(const LoadedFrames& frames, const MotionEstimate& motion,
                                          const ScaledRoad& scaled, const SurfacePlan& plan,
                                          const SupportOptions& options) {
  const RoadPosterior& road = scaled.road;
  GroundUnderVehicles out;
  SupportPlane ego;
  ego.plane = road.ego();
  ego.source = "ego";
  ego.status = detail::scale_status(road.scale_sigma()).status;
  for (std::size_t k = 0; k < frames.size(); ++k) {
    const SE3 pose = metric_pose(motion, k, road.metres_per_baseline());
    FrameGround ground;
    ground.ego = ego;
    ground.ego->plane = ego.plane.transformed(pose);
    for (std::size_t j = 0; j < frames.frames[k].vehicles.size(); ++j) {
      const std::optional<PatchFootprint>& footprint = plan.under_vehicles[k][j];
      if (frames.frames[k].vehicles[j].has_plane) {
        ground.local.emplace_back();
        continue;
      }
      if (!footprint) {
        ground.local.emplace_back(last_patch(road, plan, pose));
        continue;
      }
      ground.local.emplace_back(support_from(footprint->plane, *footprint, pose, options));
      out.local = footprint->local;
      out.planes.push_back(footprint->plane);
      out.at.push_back({k, j});
    }
    out.frames.push_back(std::move(ground));
  }
  return out;
}

/// Standard deviations beyond which a vehicle contradicts its ground: the limit at which the
/// message passing halves a message's weight.
constexpr double kVehicleGate = 2.0;

/// A track's message as measurements along the principal directions of its information.
/// @param lead  the view of the track that the message is about, and the number of its frame
std::optional<VehicleConstraint> constraint_of(const TrackMessage& message, const LocalPlane& plane,
                                               const LocalPlaneOptions& local,
                                               const VehicleDetection& lead, int frame,
                                               const SharedGround& ground) {
  const Eigen::Matrix4d& information = message.message.information;
  const Eigen::Vector4d& vector = message.message.information_vector;
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix4d> eigen(information);
  const double least = 1e-9 * eigen.eigenvalues().maxCoeff();
  std::vector<Eigen::Index> known;
  for (Eigen::Index i = 0; i < 4; ++i) {
    if (eigen.eigenvalues()[i] > least) known.push_back(i);
  }
  if (known.empty()) return std::nullopt;
  const auto count = static_cast<Eigen::Index>(known.size());
  Eigen::MatrixXd directions(count, 4);
  VehicleConstraint out;
  out.variance.resize(count);
  out.constraint.residual.resize(count);
  for (Eigen::Index i = 0; i < count; ++i) {
    const Eigen::Index k = known[static_cast<std::size_t>(i)];
    directions.row(i) = eigen.eigenvectors().col(k).transpose();
    out.variance[i] = 1.0 / eigen.eigenvalues()[k];
    out.constraint.residual[i] = directions.row(i).dot(vector) * out.variance[i];
  }
  out.views = message.views;
  out.constraint.name = "vehicle";
  out.constraint.gate = kVehicleGate;
  out.constraint.source =
      fmt::format("{} {} of frame {} in {} image{}", lead.vehicle_class, lead.id, frame,
                  message.views.size(), message.views.size() == 1 ? "" : "s");
  out.constraint.pixels = plane.pixels;
  out.constraint.by_inverse_depth = directions.leftCols<3>() * plane.by_inverse_depth;
  out.constraint.by_log_scale = directions.col(3);
  // The ground under the vehicle departs from the field by its unevenness.
  out.constraint.covariance = directions.leftCols<3>() * local.uneven_variances().asDiagonal() *
                              directions.leftCols<3>().transpose();
  out.constraint.covariance.diagonal() += out.variance;
  out.by_ground = Eigen::MatrixXd::Zero(count, ground.covariance.cols());
  out.by_ground.middleCols(ground.rows[message.lead.frame][message.lead.detection], 3) =
      directions.leftCols<3>();
  out.by_ground.rightCols<1>() = directions.col(3);
  return out;
}

/// The frames of a run with their vehicles' planes.
std::vector<TrackFrame> views_of(const LoadedFrames& frames, const MotionEstimate& motion,
                                 double metres_per_baseline, const std::vector<FrameGround>& ground,
                                 const VehicleOptions& options) {
  std::vector<TrackFrame> out;
  const Eigen::VectorXd variances = motion.covariance.diagonal();
  for (std::size_t k = 0; k < frames.size(); ++k) {
    const SceneFrame& frame = frames.frames[k];
    TrackFrame view;
    view.world_from_camera = metric_pose(motion, k, metres_per_baseline).inverse();
    view.time_s = time_of(frame, frames.frame_rate);
    view.image = &frames.gray[k];
    if (!frames.masks[k].vehicle_class.empty()) view.vehicle_mask = &frames.masks[k].vehicle_class;
    const Eigen::Index at = 6 * static_cast<Eigen::Index>(k - (k > frames.reference ? 1 : 0));
    const bool moved = k != frames.reference && at + 6 <= variances.size();
    view.pose_sigma_turn = moved ? std::sqrt(variances.segment(at, 3).mean()) : 0.0;
    view.pose_sigma_shift =
        moved ? metres_per_baseline * std::sqrt(variances.segment(at + 3, 3).mean()) : 0.0;
    view.detections = frame.vehicles;
    view.supports = choose_supports(frames.camera, frame.vehicles, ground[k],
                                    frames.known.camera_height, options);
    out.push_back(std::move(view));
  }
  return out;
}

}  // namespace

std::vector<SupportPlane> choose_supports(const PinholeCamera& camera,
                                          const std::vector<VehicleDetection>& detections,
                                          const FrameGround& ground,
                                          std::optional<double> camera_height,
                                          const VehicleOptions& options) {
  std::vector<SupportPlane> out;
  for (std::size_t j = 0; j < detections.size(); ++j) {
    out.push_back(support_of(camera, detections[j],
                             j < ground.local.size() ? ground.local[j] : std::nullopt, ground.ego,
                             camera_height, options));
  }
  return out;
}

PlacedVehicles place_vehicles(const PinholeCamera& camera, std::vector<TrackFrame> views,
                              const SharedGround* ground, double scale_sigma,
                              const VehicleOptions& options) {
  VehicleFitOptions fit = options.fit;
  fit.plane_is_exact =
      options.method == VehicleMethod::kCoplanar || options.method == VehicleMethod::kFlat;
  PlacedVehicles out;
  out.views = std::move(views);
  for (TrackFrame& view : out.views) {
    view.estimates = fit_vehicles(camera, view.detections, view.supports, fit, options.num_threads);
  }
  if (options.method == VehicleMethod::kJoint && options.tracks) {
    TrackFit tracked = fit_tracks(camera, out.views, fit, options.num_threads, scale_sigma, ground);
    out.estimates = std::move(tracked.estimates);
    out.tracks = std::move(tracked.tracks);
    out.messages = std::move(tracked.messages);
    return out;
  }
  for (const TrackFrame& view : out.views) {
    out.estimates.push_back(view.estimates);
    out.tracks.emplace_back();
    for (const VehicleDetection& d : view.detections) out.tracks.back().push_back(d.track);
  }
  return out;
}

PlacedVehicles vehicles(const LoadedFrames& frames, const MotionEstimate& motion,
                        const ScaledRoad& scaled, const SurfacePlan& plan,
                        const VehicleOptions& options) {
  if (!options.enabled) return {};
  const RoadPosterior& road = scaled.road;
  const GroundUnderVehicles ground =
      ground_under_vehicles(frames, motion, scaled, plan, options.support);
  std::vector<TrackFrame> views =
      views_of(frames, motion, road.metres_per_baseline(), ground.frames, options);
  if (options.method != VehicleMethod::kJoint) {
    return place_vehicles(frames.camera, std::move(views), nullptr, road.scale_sigma(), options);
  }
  const detail::DetectedGround detected{&views, &ground.planes, &ground.at, ground.local};
  GroundGraph joint = detail::ground_graph(road, plan, detected, options.graph);
  PlacedVehicles out = place_vehicles(frames.camera, std::move(views), &joint.under_detections,
                                      road.scale_sigma(), options);
  out.ground = std::move(joint);
  for (const TrackMessage& message : out.messages) {
    const auto plane = std::find_if(ground.at.begin(), ground.at.end(), [&](const TrackView& at) {
      return at.frame == message.lead.frame && at.detection == message.lead.detection;
    });
    if (plane == ground.at.end()) continue;
    auto constraint = constraint_of(
        message, ground.planes[static_cast<std::size_t>(plane - ground.at.begin())], ground.local,
        out.views[message.lead.frame].detections[message.lead.detection],
        frames.frames[message.lead.frame].id, out.ground.under_detections);
    if (constraint) out.constraints.push_back(std::move(*constraint));
  }
  const TrackFrame& reference = out.views[frames.reference];
  const DashFocalLength& dashes = scaled.dash_focal_length;
  out.focal_length = focal_length_evidence(
      frames.camera, reference.detections, reference.supports, reference.estimates, options.fit,
      options.num_threads, dashes.strokes > 0 ? std::optional(dashes.factor) : std::nullopt);
  return out;
}

}  // namespace stages
}  // namespace camber
