#include "camber/drive/drive_tracks.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>
#include <set>

namespace camber {
namespace {

/// A detection: frame id, id within the frame.
using Detection = std::pair<int, int>;

/// Groups of detections of which no two are of one frame.
class TrackSets {
 public:
  void add(const Detection& d) {
    if (index_.emplace(d, parent_.size()).second) {
      parent_.push_back(parent_.size());
      frames_.push_back({d.first});
    }
  }
  void join(const Detection& a, const Detection& b) {
    std::size_t x = root(index_.at(a)), y = root(index_.at(b));
    if (x == y) return;
    if (frames_[x].size() < frames_[y].size()) std::swap(x, y);
    const bool meet = std::any_of(frames_[y].begin(), frames_[y].end(),
                                  [&](int frame) { return frames_[x].count(frame) > 0; });
    if (meet) return;
    parent_[y] = x;
    frames_[x].insert(frames_[y].begin(), frames_[y].end());
  }
  std::size_t set_of(const Detection& d) { return root(index_.at(d)); }

 private:
  std::size_t root(std::size_t i) {
    while (parent_[i] != i) i = parent_[i] = parent_[parent_[i]];
    return i;
  }
  std::map<Detection, std::size_t> index_;
  std::vector<std::size_t> parent_;
  std::vector<std::set<int>> frames_;
};

/// An estimate of a track in its own camera.
struct Seen {
  const VehicleEstimate* vehicle = nullptr;
  int frame = 0;
  double time = 0.0;
  SE3 world_from_camera;
  Eigen::Matrix3d information = Eigen::Matrix3d::Zero();  // of the bottom centre, camera
};

/// A parked vehicle by all its views. The distances of all of them share a factor, since they hang
/// on one size; views from different distances measure it by the way between them.
struct Parked {
  Eigen::Vector3d position = Eigen::Vector3d::Zero();
  double log_factor = 0.0;
  Eigen::Matrix4d covariance = Eigen::Matrix4d::Zero();
  double squared = 0.0;  // sum of squared residuals, standard deviations
};

constexpr double kSizeSigma = 0.05;       // relative, of what the size does to all distances
constexpr double kViewsAlike = 5.0;       // neighbouring windows share their errors
constexpr double kMostParkedSpeed = 0.7;  // m/s, that errors of the estimates make

std::optional<Parked> fit_parked(const std::vector<Seen>& seen) {
  constexpr int kIterations = 10;
  constexpr double kFreedom = 4.0;
  Parked out;
  out.position = seen.back().world_from_camera * seen.back().vehicle->pose.bottom_center();
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    Eigen::Matrix4d normal = Eigen::Matrix4d::Zero();
    Eigen::Vector4d right = Eigen::Vector4d::Zero();
    normal(3, 3) = 1.0 / (kSizeSigma * kSizeSigma);
    right[3] = -out.log_factor * normal(3, 3);
    out.squared = 0.0;
    for (const Seen& view : seen) {
      const SE3 camera_from_world = view.world_from_camera.inverse();
      const Eigen::Vector3d here = camera_from_world * out.position;
      const double factor = std::exp(out.log_factor);
      const Eigen::Vector3d residual = view.vehicle->pose.bottom_center() - factor * here;
      Eigen::Matrix<double, 3, 4> by;
      by.leftCols<3>() = factor * camera_from_world.rotation_matrix();
      by.col(3) = factor * here;
      const double squared = residual.dot(view.information * residual);
      const double weight = (kFreedom + 3.0) / (kFreedom + squared);
      normal += weight * by.transpose() * view.information * by;
      right += weight * by.transpose() * view.information * residual;
      out.squared += std::min(squared, 25.0);
    }
    const Eigen::LDLT<Eigen::Matrix4d> factor(normal);
    if (factor.info() != Eigen::Success) return std::nullopt;
    const Eigen::Vector4d change = factor.solve(right);
    out.position += change.head<3>();
    out.log_factor += change[3];
    out.covariance =
        std::min<double>(kViewsAlike, seen.size()) * factor.solve(Eigen::Matrix4d::Identity());
  }
  return out;
}

/// Speed over the ground by a straight line through the places, m/s, with its standard deviation.
std::pair<double, double> speed_of(const std::vector<Seen>& seen) {
  double sum = 0.0, mean_time = 0.0;
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  std::vector<double> weight;
  std::vector<Eigen::Vector3d> place;
  for (const Seen& view : seen) {
    place.push_back(view.world_from_camera * view.vehicle->pose.bottom_center());
    weight.push_back(view.information.trace());
    sum += weight.back();
    mean_time += weight.back() * view.time;
    mean += weight.back() * place.back();
  }
  mean_time /= sum;
  mean /= sum;
  Eigen::Vector3d moment = Eigen::Vector3d::Zero();
  double squares = 0.0, largest = 0.0;
  for (std::size_t i = 0; i < seen.size(); ++i) {
    const double t = seen[i].time - mean_time;
    moment += weight[i] * t * (place[i] - mean);
    squares += weight[i] * t * t;
    // Of the direction that is known worst.
    const Eigen::LDLT<Eigen::Matrix3d> factor(seen[i].information);
    largest = std::max(largest, factor.solve(Eigen::Matrix3d::Identity()).trace());
  }
  if (!(squares > 0.0)) return {0.0, 1e3};
  const double spread = std::sqrt(squares / sum);
  const double sigma = std::sqrt(largest * kViewsAlike / static_cast<double>(seen.size())) / spread;
  return {moment.norm() / squares, sigma};
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

Dimensions mean_dimensions(const std::vector<Seen>& seen) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  double weights = 0.0;
  for (const Seen& view : seen) {
    const double weight = view.information.trace();
    const Dimensions& d = view.vehicle->pose.dimensions;
    sum += weight * Eigen::Vector3d(d.length, d.width, d.height);
    weights += weight;
  }
  sum /= weights;
  return {sum.x(), sum.y(), sum.z()};
}

/// The heading of greatest weight: views that see a vehicle the other way round are turned.
Eigen::Quaterniond mean_rotation(const std::vector<Seen>& seen) {
  Eigen::Vector3d front = Eigen::Vector3d::Zero(), up = Eigen::Vector3d::Zero();
  const auto axis = [](const Seen& view, int k) -> Eigen::Vector3d {
    return (view.world_from_camera.rotation() * view.vehicle->pose.camera_from_vehicle.rotation())
        .toRotationMatrix()
        .col(k);
  };
  for (const Seen& view : seen) {
    front += view.information.trace() * axis(view, 0);
    up += view.information.trace() * axis(view, 1);
  }
  up.normalize();
  Eigen::Matrix3d out;
  out.col(2) = front.cross(up).normalized();
  out.col(1) = up;
  out.col(0) = up.cross(out.col(2)).normalized();
  return Eigen::Quaterniond(out);
}

}  // namespace

DriveTracks join_tracks(const std::vector<WindowMeasurement>& windows, const Trajectory& trajectory,
                        const std::map<int, double>& time_of) {
  DriveTracks out;
  TrackSets sets;
  for (const WindowMeasurement& window : windows) {
    for (const VehicleEstimate& v : window.vehicles.vehicles) {
      sets.add({window.reference, v.id});
    }
    for (const auto& t : window.tracked) sets.add({t.frame, t.id});
  }
  for (const WindowMeasurement& window : windows) {
    std::map<int, Detection> first;
    for (const auto& t : window.tracked) {
      const auto [at, is_new] = first.emplace(t.track, Detection{t.frame, t.id});
      if (!is_new) sets.join(at->second, {t.frame, t.id});
    }
  }
  std::map<std::size_t, std::vector<Seen>> members;
  std::vector<std::size_t> order;
  for (const WindowMeasurement& window : windows) {
    const TrajectoryPose* pose = trajectory.find(window.reference);
    if (!pose) continue;
    for (const VehicleEstimate& v : window.vehicles.vehicles) {
      const std::size_t set = sets.set_of({window.reference, v.id});
      if (members.find(set) == members.end()) order.push_back(set);
      const auto time = time_of.find(window.reference);
      members[set].push_back({&v, window.reference, time == time_of.end() ? 0.0 : time->second,
                              pose->world_from_camera, information_of(v)});
    }
  }
  std::map<Detection, VehicleEstimate> answers;
  for (const std::size_t set : order) {
    const std::vector<Seen>& seen = members[set];
    DriveTrack track;
    track.id = static_cast<int>(out.tracks.size()) + 1;
    track.vehicle_class = seen.front().vehicle->vehicle_class;
    track.dimensions = mean_dimensions(seen);
    std::optional<Parked> parked;
    if (seen.size() >= 3) {
      const auto [speed, sigma] = speed_of(seen);
      if (speed < kMostParkedSpeed + 2.0 * sigma) parked = fit_parked(seen);
      if (parked && parked->squared > 6.0 * 3.0 * static_cast<double>(seen.size())) parked.reset();
      if (parked && speed > 3.0) parked.reset();
    }
    track.parked = parked.has_value();
    const Eigen::Quaterniond heading = mean_rotation(seen);
    if (parked) track.covariance = parked->covariance.topLeftCorner<3, 3>();
    for (const Seen& view : seen) {
      VehicleEstimate v = *view.vehicle;
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
