#include "camber/drive/drive_tracks.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <optional>
#include <set>
#include <tuple>

#include "camber/drive/detail/track_joining.h"
#include "camber/drive/detail/track_rejection.h"
#include "camber/drive/detail/vehicle_path.h"

namespace camber {
namespace {

using internal::Detection;
using internal::SeenVehicle;
using internal::VehiclePath;

bool is_cut(const Box2& box, int image_width) {
  constexpr double kBorder = 3.0;  // px, as BoxNoise::border_px
  return box.x1 < kBorder || box.x2 > image_width - 1.0 - kBorder;
}

/// Whether a view says where its vehicle is.
bool is_placed(const SeenVehicle& view) {
  return view.vehicle->status != Status::kNotObservable && view.vehicle->status != Status::kFailed;
}

/// How high a place is above the ground of a view.
internal::MeasuredLength height_above(const SeenVehicle& view, const VehiclePath& stands) {
  constexpr double kSlope = 0.02;  // rad: how much a road's slope changes within some lengths
  constexpr double kKerb = 0.15;   // m
  const Plane& plane = view.vehicle->plane;
  const SE3 camera_from_world = view.world_from_camera.inverse();
  const Eigen::Vector3d here = camera_from_world * stands.position;
  const Eigen::Vector3d normal = view.world_from_camera.rotation() * plane.normal;
  const double slope = kSlope * (here - view.measured()).norm();
  internal::MeasuredLength out;
  out.value = plane.signed_distance(here);
  out.sigma = std::sqrt(std::pow(view.vehicle->plane_sigma_height, 2) +
                        normal.dot(stands.covariance * normal) + slope * slope + kKerb * kKerb);
  return out;
}

internal::TrackEvidence evidence_of(const DriveTrack& track, const std::vector<SeenVehicle>& seen,
                                    const std::optional<VehiclePath>& parked, bool metric) {
  internal::TrackEvidence out;
  out.vehicle_class = track.vehicle_class;
  if (metric) out.dimensions = track.dimensions;
  out.speed_sigma = internal::kSpeedSigma;
  if (parked) {
    out.log_factor = parked->log_factor;
    out.log_factor_sigma = internal::kSizeSigma;
    for (const SeenVehicle& view : seen) {
      if (is_placed(view)) out.heights.push_back(height_above(view, *parked));
    }
  }
  if (!metric) return out;
  for (const SeenVehicle& view : seen) {
    if (is_placed(view)) out.places.push_back(internal::place_of(view));
  }
  std::stable_sort(out.places.begin(), out.places.end(),
                   [](const auto& a, const auto& b) { return a.time_s < b.time_s; });
  return out;
}

Eigen::Matrix3d information_of(const VehicleEstimate& v) {
  Eigen::Matrix3d covariance = v.covariance.topLeftCorner<3, 3>();
  if (!covariance.allFinite() || !(covariance.trace() > 0.0)) {
    const double sigma = 0.1 * v.pose.bottom_center().norm();
    covariance = sigma * sigma * Eigen::Matrix3d::Identity();
  }
  covariance.diagonal().array() += 1e-4;
  return covariance.inverse();
}

Dimensions mean_dimensions(const std::vector<SeenVehicle>& seen) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  double weights = 0.0;
  for (const SeenVehicle& view : seen) {
    const double weight = view.information.trace();
    const Dimensions& d = view.vehicle->pose.dimensions;
    sum += weight * Eigen::Vector3d(d.length, d.width, d.height);
    weights += weight;
  }
  sum /= weights;
  return {sum.x(), sum.y(), sum.z()};
}

/// One size of a vehicle that moves: a weighted mean. The error of the ground under it grows with
/// the distance, and with it that of the size.
struct SizeByNear {
  Dimensions dimensions;
  double sigma = 0.0;  // relative
};

constexpr double kAngularSigma = 0.02;  // relative, of size over distance
constexpr double kGroundSigma = 0.002;  // a metre: relative, of a distance by the ground

/// Relative, of height and width together as a view states them; the prior's where it does not.
double size_sigma(const VehicleEstimate& v) {
  constexpr double kPrior = 0.06;
  const Dimensions& d = v.pose.dimensions;
  const Eigen::Vector2d by(0.5 / d.height, 0.5 / d.width);
  const double variance = by.dot(v.covariance.bottomRightCorner<2, 2>() * by);
  return variance > 0.0 ? std::min(kPrior, std::sqrt(variance)) : kPrior;
}

/// All views share the prior and what the class's keypoints are off.
SizeByNear size_by_near(const std::vector<SeenVehicle>& seen) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  double weights = 0.0, sigma = std::numeric_limits<double>::infinity();
  for (const SeenVehicle& view : seen) {
    const double ground = kGroundSigma * view.measured().norm();
    const double weight = 1.0 / (kAngularSigma * kAngularSigma + ground * ground);
    const Dimensions& d = view.vehicle->pose.dimensions;
    sum += weight * Eigen::Vector3d(d.length, d.width, d.height);
    weights += weight;
    sigma = std::min(sigma, size_sigma(*view.vehicle));
  }
  sum /= weights;
  return {{sum.x(), sum.y(), sum.z()}, sigma};
}

/// How wide a vehicle is across the ray, m.
double width_across(const Dimensions& d, const OrientedBox& pose) {
  const Eigen::Vector3d ray = pose.bottom_center().normalized();
  const Eigen::Matrix3d axes = pose.camera_from_vehicle.rotation_matrix();
  const double along = ray.dot(axes.col(0)), across = ray.dot(axes.col(2));
  return d.width * std::sqrt(std::max(0.0, 1.0 - across * across)) +
         d.length * std::sqrt(std::max(0.0, 1.0 - along * along));
}

/// A view given the one size: along its ray to where it appears as large.
VehicleEstimate given_size(const SeenVehicle& view, const SizeByNear& size) {
  VehicleEstimate out = *view.vehicle;
  const Dimensions &own = out.pose.dimensions, &one = size.dimensions;
  const double larger = 0.5 * (std::log(one.height / own.height) +
                               std::log(width_across(one, out.pose) / width_across(own, out.pose)));
  const Eigen::Vector3d measured = view.measured();
  const double range = measured.norm();
  const Eigen::Vector3d ray = measured / range;
  const Eigen::Matrix3d place = view.information.inverse();
  const double by_ground =
      ray.dot(place * ray) / (range * range) + std::pow(kGroundSigma * range, 2);
  const double by_size = kAngularSigma * kAngularSigma + size.sigma * size.sigma;
  const double share = by_ground / (by_ground + by_size);  // of the distance by the size
  // The view's own distance has the size's error, too.
  const double in_both = size.sigma * std::min(size.sigma, std::sqrt(by_ground));
  const double variance = std::pow(1.0 - share, 2) * by_ground + share * share * by_size +
                          2.0 * share * (1.0 - share) * in_both;
  const Eigen::Vector3d shift = std::expm1(larger * share) * measured;
  out.pose.camera_from_vehicle.set_translation(measured + shift);
  out.pose.dimensions = one;
  for (Eigen::Vector3d& k : out.keypoints) k += shift;
  const Eigen::Matrix3d beside = Eigen::Matrix3d::Identity() - ray * ray.transpose();
  out.covariance.topLeftCorner<3, 3>() =
      beside * place * beside + variance * range * range * ray * ray.transpose();
  out.covariance.block<3, 6>(0, 3).setZero();
  out.covariance.block<6, 3>(3, 0).setZero();
  out.plane = Plane::through(out.pose.bottom_center(), out.plane.normal);
  return out;
}

/// The vehicles of each frame by the window whose reference is nearest; by one that the drive
/// contradicts only where no other has the frame.
std::map<int, const VehicleFrame*> vehicle_frames(const std::vector<WindowMeasurement>& windows,
                                                  const Trajectory& trajectory) {
  std::set<int> agreeing;
  for (const Trajectory::WindowScale& scale : trajectory.scales) {
    if (scale.weight >= kLeastWindowWeight) agreeing.insert(scale.reference);
  }
  struct Known {
    bool contradicted = false;
    std::ptrdiff_t steps = 0;  // from the window's reference
    const VehicleFrame* frame = nullptr;
  };
  std::map<int, Known> known;
  for (const WindowMeasurement& w : windows) {
    for (const VehicleFrame& frame : w.vehicles) {
      const auto at = std::find(w.frames.begin(), w.frames.end(), frame.id) - w.frames.begin();
      const Known now{agreeing.count(w.reference) == 0,
                      std::abs(at - static_cast<std::ptrdiff_t>(w.index_of_reference())), &frame};
      const auto [before, is_new] = known.emplace(frame.id, now);
      if (!is_new && std::tie(now.contradicted, now.steps) <
                         std::tie(before->second.contradicted, before->second.steps)) {
        before->second = now;
      }
    }
  }
  std::map<int, const VehicleFrame*> out;
  for (const auto& [id, frame] : known) out[id] = frame.frame;
  return out;
}

std::vector<SeenVehicle> seen_of(const std::vector<Detection>& group,
                                 const std::map<Detection, SeenVehicle>& views) {
  std::vector<SeenVehicle> out;
  for (const Detection& d : group) {
    const auto view = views.find(d);
    if (view != views.end()) out.push_back(view->second);
  }
  return out;
}

/// Tracks cut where two vehicles explain their views better than one.
std::vector<std::vector<Detection>> divided_groups(
    const std::vector<std::vector<Detection>>& groups,
    const std::map<Detection, SeenVehicle>& views) {
  std::vector<std::vector<Detection>> out;
  for (const std::vector<Detection>& group : groups) {
    const auto parts = internal::divided(seen_of(group, views));
    if (parts.size() < 2) {
      out.push_back(group);
      continue;
    }
    for (const std::vector<SeenVehicle>& part : parts) {
      std::vector<Detection>& detections = out.emplace_back();
      for (const SeenVehicle& view : part) detections.emplace_back(view.frame, view.vehicle->id);
    }
  }
  return out;
}

}  // namespace

std::size_t DriveTracks::num_rejected() const {
  return static_cast<std::size_t>(std::count_if(
      tracks.begin(), tracks.end(), [](const DriveTrack& t) { return !t.rejected.empty(); }));
}

DriveTracks join_tracks(const std::vector<WindowMeasurement>& windows, const Trajectory& trajectory,
                        const std::map<int, double>& time_of, int image_width,
                        const VehiclePrior* prior) {
  DriveTracks out;
  std::map<Detection, SeenVehicle> views;
  for (const auto& [id, frame] : vehicle_frames(windows, trajectory)) {
    const TrajectoryPose* pose = trajectory.find(id);
    if (!pose) continue;
    const auto time = time_of.find(id);
    for (const VehicleEstimate& v : frame->vehicles) {
      views[{id, v.id}] = {&v,
                           id,
                           time == time_of.end() ? 0.0 : time->second,
                           pose->world_from_camera,
                           information_of(v),
                           is_cut(v.box, image_width)};
    }
  }
  std::map<Detection, internal::PlacedDetection> placed;
  for (const auto& [detection, view] : views) {
    if (!trajectory.metric || view.vehicle->status == Status::kFailed) continue;
    placed[detection] = {view.vehicle->vehicle_class, internal::place_of(view)};
  }
  std::map<Detection, VehicleEstimate> answers;
  const VehiclePrior& sizes = prior ? *prior : shipped_vehicle_prior();
  std::vector<std::vector<Detection>> groups = internal::join_detections(windows, placed);
  if (trajectory.metric) {
    groups = internal::bridge_detections(divided_groups(groups, views), placed);
  }
  for (const std::vector<Detection>& group : groups) {
    const std::vector<SeenVehicle> seen = seen_of(group, views);
    if (seen.empty()) continue;
    DriveTrack track;
    track.id = static_cast<int>(out.tracks.size()) + 1;
    track.vehicle_class = seen.front().vehicle->vehicle_class;
    track.dimensions = mean_dimensions(seen);
    const Eigen::Quaterniond heading = internal::mean_rotation(seen);
    const std::optional<VehiclePath> parked =
        seen.size() >= 3 ? internal::parked_place(seen) : std::nullopt;
    track.parked = parked.has_value();
    if (parked) track.covariance = parked->covariance;
    if (seen.size() >= 3) {
      track.rejected =
          internal::why_no_vehicle(evidence_of(track, seen, parked, trajectory.metric), sizes);
    }
    std::optional<SizeByNear> size;
    if (!parked && trajectory.metric && seen.size() >= 3) {
      size = size_by_near(seen);
      track.dimensions = size->dimensions;
    }
    for (const SeenVehicle& view : seen) {
      const bool known = view.vehicle->status != Status::kFailed;
      VehicleEstimate v = size && known ? given_size(view, *size) : *view.vehicle;
      v.track = track.id;
      SE3 world_from_vehicle = view.world_from_camera * v.pose.camera_from_vehicle;
      if (parked) {
        world_from_vehicle = SE3(heading, parked->position);
        const SE3 moved = view.world_from_camera.inverse() * world_from_vehicle;
        const SE3 before = v.pose.camera_from_vehicle;
        for (Eigen::Vector3d& k : v.keypoints) k = moved * (before.inverse() * k);
        v.pose.camera_from_vehicle = moved;
        v.pose.dimensions = track.dimensions;
        const Eigen::Matrix3d turn = view.world_from_camera.rotation_matrix().transpose();
        v.covariance.topLeftCorner<3, 3>() = turn * track.covariance * turn.transpose();
        v.covariance.block<3, 6>(0, 3).setZero();
        v.covariance.block<6, 3>(3, 0).setZero();
        v.plane = Plane::through(moved.translation(), v.plane.normal);
      }
      if (!track.rejected.empty()) {
        v.status = Status::kFailed;
        v.reason = "no vehicle by its track: " + track.rejected;
      }
      track.views.push_back({view.frame, v.id, view.time, world_from_vehicle});
      answers.emplace(Detection{view.frame, v.id}, std::move(v));
    }
    std::sort(track.views.begin(), track.views.end(),
              [](const auto& a, const auto& b) { return a.frame < b.frame; });
    out.tracks.push_back(std::move(track));
  }
  std::map<int, VehicleFrame> frames;
  for (const TrajectoryPose& pose : trajectory.poses) frames[pose.frame].id = pose.frame;
  for (auto& [detection, vehicle] : answers) {
    frames[detection.first].vehicles.push_back(std::move(vehicle));
  }
  for (auto& [id, frame] : frames) out.vehicles.frames.push_back(std::move(frame));
  out.vehicles.method = "joint";
  out.vehicles.preset = "default";
  out.vehicles.metric = trajectory.metric;
  return out;
}

}  // namespace camber
