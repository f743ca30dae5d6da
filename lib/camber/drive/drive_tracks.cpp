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

namespace camber {
namespace {

using internal::Detection;

/// An estimate of a track in its own camera.
struct Seen {
  const VehicleEstimate* vehicle = nullptr;
  int frame = 0;
  double time = 0.0;
  SE3 world_from_camera;
  Eigen::Matrix3d information = Eigen::Matrix3d::Zero();  // of the bottom centre, camera
  bool cut = false;                                       // by a side of the picture

  Eigen::Vector3d measured() const { return vehicle->pose.bottom_center(); }
};

constexpr double kDirectionSigma = 0.15;  // m across the ray, of the centre by the visible part
constexpr double kBoxSigma = 0.003;       // rad
constexpr double kOwnRange = 0.04;        // relative, of one view beside what its covariance has
constexpr double kSizeSigma = 0.04;       // relative, of what the size does to all distances
constexpr double kViewsAlike = 5.0;       // neighbouring windows share their errors
constexpr double kSpeedSigma = 15.0;      // m/s, of vehicles that move, along their heading
constexpr double kAcrossSigma = 2.0;      // m/s, across it: it turns, and is known to some degrees

/// Where a vehicle is by all its views: directions, which the pictures show, and distances, which
/// hang on its size and share a factor. Views from several places measure the factor by the way
/// between them.
struct Path {
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  // at the mean time
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();  // m/s; zero: it stands
  double log_factor = 0.0;
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();  // of the position
  double cost = 0.0;  // robust sum of squares, standard deviations, for views that are not alike
  double log_evidence = 0.0;
};

class PathFit {
 public:
  /// @param ahead  heading of one that moves, unit, world; null: it stands.
  explicit PathFit(const std::vector<Seen>& seen, const Eigen::Vector3d* ahead = nullptr)
      : size_(ahead ? 7 : 4) {
    if (ahead) {
      const Eigen::Matrix3d along = *ahead * ahead->transpose();
      speed_information_ = along / (kSpeedSigma * kSpeedSigma) +
                           (Eigen::Matrix3d::Identity() - along) / (kAcrossSigma * kAcrossSigma);
    }
    take(seen, [](const Seen& v) { return is_observed(v) && !v.cut; });
    if (seen_.size() < 2) take(seen, is_observed);
    if (seen_.size() < 2) take(seen, [](const Seen&) { return true; });
    for (const Seen* view : seen_) mean_time_ += view->time / static_cast<double>(seen_.size());
    alike_ = std::min(kViewsAlike, static_cast<double>(seen_.size()));
  }

  std::optional<Path> solve() {
    constexpr int kIterations = 15;
    Eigen::VectorXd at = Eigen::VectorXd::Zero(size_);
    at.head<3>() = seen_.back()->world_from_camera * seen_.back()->measured();
    if (size_ == 7) start_moving(&at);
    Eigen::MatrixXd normal;
    for (int iteration = 0; iteration < kIterations; ++iteration) {
      Eigen::VectorXd right;
      linearise(at, &normal, &right);
      factor_.compute(normal);
      if (factor_.info() != Eigen::Success) return std::nullopt;
      const Eigen::VectorXd change = factor_.solve(right);
      if (!change.allFinite()) return std::nullopt;
      at += change;
    }
    Path out;
    out.position = at.head<3>();
    out.log_factor = at[3];
    const Eigen::MatrixXd inverse =
        normal.ldlt().solve(Eigen::MatrixXd::Identity(normal.rows(), normal.cols()));
    out.covariance = inverse.topLeftCorner<3, 3>();
    if (size_ == 7) out.velocity = at.tail<3>();
    out.cost = cost_;
    out.log_evidence = -0.5 * (cost_ + factor_.vectorD().array().log().sum());
    if (size_ == 7) out.log_evidence += 0.5 * std::log(speed_information_.determinant());
    return out;
  }

 private:
  static constexpr double kFreedom = 4.0;

  /// From rest one that keeps its distance ahead is not found: it seems to stand far away.
  void start_moving(Eigen::VectorXd* at) const {
    Eigen::Vector3d mean = Eigen::Vector3d::Zero(), slope = Eigen::Vector3d::Zero();
    double spread = 0.0;
    for (const Seen* view : seen_) {
      const Eigen::Vector3d place = view->world_from_camera * view->measured();
      const double time = view->time - mean_time_;
      mean += place / static_cast<double>(seen_.size());
      slope += time * place;
      spread += time * time;
    }
    at->head<3>() = mean;
    if (spread > 0.0) at->tail<3>() = slope / spread;
  }

  static bool is_observed(const Seen& view) {
    return view.vehicle->status != Status::kNotObservable;
  }

  template <typename Wanted>
  void take(const std::vector<Seen>& seen, const Wanted& wanted) {
    seen_.clear();
    for (const Seen& view : seen) {
      if (wanted(view)) seen_.push_back(&view);
    }
  }

  /// Direction (two slopes) and logarithm of the distance, over their standard deviations.
  Eigen::Vector3d residual(const Seen& view, const Eigen::VectorXd& at) const {
    Eigen::Vector3d place = at.head<3>();
    if (size_ == 7) place += (view.time - mean_time_) * at.tail<3>();
    const Eigen::Vector3d here = view.world_from_camera.inverse() * place;
    const Eigen::Vector3d measured = view.measured();
    const double range = measured.norm();
    const Eigen::Vector3d ray = measured / range;
    const Eigen::Matrix3d covariance = view.vehicle->covariance.topLeftCorner<3, 3>();
    const double along = ray.dot(covariance * ray);
    const double own = along > 0.0 ? std::sqrt(along) / range : 0.1;
    const double direction = std::hypot(kBoxSigma, kDirectionSigma / range);
    if (!(here.z() > 0.1)) return Eigen::Vector3d::Constant(50.0);
    return {(here.x() / here.z() - measured.x() / measured.z()) / direction,
            (here.y() / here.z() - measured.y() / measured.z()) / direction,
            (std::log(here.norm()) - std::log(range) + at[3]) / std::hypot(own, kOwnRange)};
  }

  void linearise(const Eigen::VectorXd& at, Eigen::MatrixXd* normal, Eigen::VectorXd* right) {
    *normal = Eigen::MatrixXd::Zero(size_, size_);
    *right = Eigen::VectorXd::Zero(size_);
    cost_ = at[3] * at[3] / (kSizeSigma * kSizeSigma);
    (*normal)(3, 3) = 1.0 / (kSizeSigma * kSizeSigma);
    (*right)[3] = -at[3] / (kSizeSigma * kSizeSigma);
    if (size_ == 7) {
      const Eigen::Vector3d velocity = at.tail<3>();
      normal->bottomRightCorner<3, 3>() = speed_information_;
      right->tail<3>() = -speed_information_ * velocity;
      cost_ += velocity.dot(speed_information_ * velocity);
    }
    for (const Seen* view : seen_) {
      const Eigen::Vector3d r = residual(*view, at);
      Eigen::MatrixXd by(3, size_);
      for (Eigen::Index i = 0; i < size_; ++i) {
        constexpr double kStep = 1e-5;
        Eigen::VectorXd up = at, down = at;
        up[i] += kStep;
        down[i] -= kStep;
        by.col(i) = (residual(*view, up) - residual(*view, down)) / (2.0 * kStep);
      }
      const double weight = (kFreedom + 3.0) / (kFreedom + r.squaredNorm()) / alike_;
      *normal += weight * by.transpose() * by;
      *right -= weight * by.transpose() * r;
      cost_ += (kFreedom + 3.0) * std::log1p(r.squaredNorm() / kFreedom) / alike_;
    }
  }

  Eigen::Index size_;  // position, logarithm of the factor, velocity
  std::vector<const Seen*> seen_;
  Eigen::Matrix3d speed_information_ = Eigen::Matrix3d::Zero();
  double mean_time_ = 0.0, alike_ = 1.0, cost_ = 0.0;
  Eigen::LDLT<Eigen::MatrixXd> factor_;
};

/// The place of a vehicle that stands; nothing where its views are rather those of one that moves
/// (evidence by Laplace's approximation: MacKay, "Information Theory, Inference, and Learning
/// Algorithms", 2003, chapter 28), either as likely before.
std::optional<Path> parked_place(const std::vector<Seen>& seen, const Eigen::Vector3d& ahead) {
  const std::optional<Path> stands = PathFit(seen).solve();
  const std::optional<Path> moves = PathFit(seen, &ahead).solve();
  if (!stands || !moves) return stands;
  return moves->log_evidence > stands->log_evidence ? std::nullopt : stands;
}

bool is_cut(const Box2& box, int image_width) {
  constexpr double kBorder = 3.0;  // px, as BoxNoise::border_px
  return box.x1 < kBorder || box.x2 > image_width - 1.0 - kBorder;
}

/// Whether a view says where its vehicle is.
bool is_placed(const Seen& view) {
  return view.vehicle->status != Status::kNotObservable && view.vehicle->status != Status::kFailed;
}

/// How high a place is above the ground of a view.
internal::MeasuredLength height_above(const Seen& view, const Path& stands) {
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

internal::TrackPlace place_of(const Seen& view) {
  const Eigen::Matrix3d turn = view.world_from_camera.rotation_matrix();
  const Eigen::Vector3d along = kOwnRange * view.measured();
  const Eigen::Matrix3d covariance = view.information.inverse() + along * along.transpose();
  return {view.time, view.world_from_camera * view.measured(),
          turn * covariance * turn.transpose()};
}

internal::TrackEvidence evidence_of(const DriveTrack& track, const std::vector<Seen>& seen,
                                    const std::optional<Path>& parked, bool metric) {
  internal::TrackEvidence out;
  out.vehicle_class = track.vehicle_class;
  if (metric) out.dimensions = track.dimensions;
  out.speed_sigma = kSpeedSigma;
  if (parked) {
    out.log_factor = parked->log_factor;
    out.log_factor_sigma = kSizeSigma;
    for (const Seen& view : seen) {
      if (is_placed(view)) out.heights.push_back(height_above(view, *parked));
    }
  }
  if (!metric) return out;
  for (const Seen& view : seen) {
    if (is_placed(view)) out.places.push_back(place_of(view));
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
SizeByNear size_by_near(const std::vector<Seen>& seen) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  double weights = 0.0, sigma = std::numeric_limits<double>::infinity();
  for (const Seen& view : seen) {
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
VehicleEstimate given_size(const Seen& view, const SizeByNear& size) {
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

}  // namespace

std::size_t DriveTracks::num_rejected() const {
  return static_cast<std::size_t>(std::count_if(
      tracks.begin(), tracks.end(), [](const DriveTrack& t) { return !t.rejected.empty(); }));
}

DriveTracks join_tracks(const std::vector<WindowMeasurement>& windows, const Trajectory& trajectory,
                        const std::map<int, double>& time_of, int image_width,
                        const VehiclePrior* prior) {
  DriveTracks out;
  std::map<Detection, Seen> views;
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
    placed[detection] = {view.vehicle->vehicle_class, place_of(view)};
  }
  std::map<Detection, VehicleEstimate> answers;
  const VehiclePrior& sizes = prior ? *prior : shipped_vehicle_prior();
  for (const std::vector<Detection>& group : internal::join_detections(windows, placed)) {
    std::vector<Seen> seen;
    for (const Detection& d : group) {
      const auto view = views.find(d);
      if (view != views.end()) seen.push_back(view->second);
    }
    if (seen.empty()) continue;
    DriveTrack track;
    track.id = static_cast<int>(out.tracks.size()) + 1;
    track.vehicle_class = seen.front().vehicle->vehicle_class;
    track.dimensions = mean_dimensions(seen);
    const Eigen::Quaterniond heading = mean_rotation(seen);
    const std::optional<Path> parked =
        seen.size() >= 3 ? parked_place(seen, heading * Eigen::Vector3d::UnitX()) : std::nullopt;
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
    for (const Seen& view : seen) {
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
