#include "camber/drive/detail/vehicle_path.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <utility>

namespace camber::internal {
namespace {

using Views = std::vector<const SeenVehicle*>;

constexpr double kDirectionSigma = 0.15;  // m across the ray, of the centre by the visible part
constexpr double kBoxSigma = 0.003;       // rad
constexpr double kAcrossSigma = 2.0;      // m/s, across the heading: it turns, and is known to some
                                          // degrees

/// Least squares with heavy tails.
class PathFit {
 public:
  /// @param ahead  heading of one that moves, unit, world; null: it stands.
  /// @param alike  so many views count as one.
  PathFit(const std::vector<const SeenVehicle*>& seen, const Eigen::Vector3d* ahead, double alike)
      : size_(ahead ? 7 : 4), seen_(seen), alike_(alike) {
    if (ahead) {
      const Eigen::Matrix3d along = *ahead * ahead->transpose();
      speed_information_ = along / (kSpeedSigma * kSpeedSigma) +
                           (Eigen::Matrix3d::Identity() - along) / (kAcrossSigma * kAcrossSigma);
    }
    for (const SeenVehicle* view : seen_) {
      mean_time_ += view->time / static_cast<double>(seen_.size());
    }
  }

  std::optional<VehiclePath> solve() {
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
    VehiclePath out;
    out.position = at.head<3>();
    out.log_factor = at[3];
    const Eigen::MatrixXd inverse =
        factor_.solve(Eigen::MatrixXd::Identity(normal.rows(), normal.cols()));
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
    for (const SeenVehicle* view : seen_) {
      const Eigen::Vector3d place = view->world_from_camera * view->measured();
      const double time = view->time - mean_time_;
      mean += place / static_cast<double>(seen_.size());
      slope += time * place;
      spread += time * time;
    }
    at->head<3>() = mean;
    if (spread > 0.0) at->tail<3>() = slope / spread;
  }

  /// Direction (two slopes) and logarithm of the distance, over their standard deviations.
  Eigen::Vector3d residual(const SeenVehicle& view, const Eigen::VectorXd& at) const {
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
    for (const SeenVehicle* view : seen_) {
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
  const std::vector<const SeenVehicle*>& seen_;
  Eigen::Matrix3d speed_information_ = Eigen::Matrix3d::Zero();
  double mean_time_ = 0.0, alike_, cost_ = 0.0;
  Eigen::LDLT<Eigen::MatrixXd> factor_;
};

bool is_observed(const SeenVehicle& view) {
  return view.vehicle->status != Status::kNotObservable && view.measured().allFinite();
}

template <typename Wanted>
Views views_where(const std::vector<SeenVehicle>& seen, const Wanted& wanted) {
  Views out;
  for (const SeenVehicle& view : seen) {
    if (wanted(view)) out.push_back(&view);
  }
  return out;
}

/// Measurements of the place: truncated views have a biased centre.
Views whole_views(const std::vector<SeenVehicle>& seen) {
  return views_where(seen, [](const SeenVehicle& v) { return is_observed(v) && !v.cut; });
}

/// The same; where they are fewer than two all that are observed, then all.
Views views_of(const std::vector<SeenVehicle>& seen) {
  Views out = whole_views(seen);
  if (out.size() < 2) out = views_where(seen, is_observed);
  if (out.size() < 2) out = views_where(seen, [](const SeenVehicle&) { return true; });
  return out;
}

double alike(std::size_t views) { return std::min(kViewsAlike, static_cast<double>(views)); }

Eigen::Quaterniond mean_rotation(const Views& seen) {
  Eigen::Vector3d front = Eigen::Vector3d::Zero(), up = Eigen::Vector3d::Zero();
  const auto axis = [](const SeenVehicle* view, int k) -> Eigen::Vector3d {
    return (view->world_from_camera.rotation() * view->vehicle->pose.camera_from_vehicle.rotation())
        .toRotationMatrix()
        .col(k);
  };
  for (const SeenVehicle* view : seen) {
    front += view->information.trace() * axis(view, 0);
    up += view->information.trace() * axis(view, 1);
  }
  up.normalize();
  Eigen::Matrix3d out;
  out.col(2) = front.cross(up).normalized();
  out.col(1) = up;
  out.col(0) = up.cross(out.col(2)).normalized();
  return Eigen::Quaterniond(out);
}

/// How well one vehicle explains some views, standing or moving, whichever does better.
struct Explained {
  double log_evidence = 0.0, cost = 0.0;
};

std::optional<Explained> explained(const Views& views, double views_alike) {
  constexpr std::size_t kFewest = 3;  // views of one that moves
  const auto stands = PathFit(views, nullptr, views_alike).solve();
  if (!stands) return std::nullopt;
  const Explained standing{stands->log_evidence, stands->cost};
  if (views.size() < kFewest) return standing;
  const Eigen::Vector3d ahead = mean_rotation(views) * Eigen::Vector3d::UnitX();
  const auto moves = PathFit(views, &ahead, views_alike).solve();
  if (!moves || moves->log_evidence < stands->log_evidence) return standing;
  return Explained{moves->log_evidence, moves->cost};
}

/// Two vehicles in place of one have a place and a size more. Links are made where boxes overlap:
/// the other one is near the first one's ray. One link in a hundred is wrong
/// (docs/notes/drives.md).
double log_odds_of_two() {
  constexpr double kAlongRay = 2.0 * 2.0 * 30.0;  // m^3
  constexpr double kWrongLinks = 0.01;
  return std::log(kWrongLinks) - std::log(kAlongRay) + 1.5 * std::log(2.0 * M_PI) -
         std::log(kSizeSigma);
}

/// Before which views a track is cut, if it is: where it jumps (one that brakes does not), most of
/// all. Ascending; the end beside them.
std::vector<std::size_t> places_to_cut(const Views& views) {
  constexpr std::size_t kMost = 6;
  std::vector<std::pair<double, std::size_t>> jumps;
  for (std::size_t k = 1; k < views.size(); ++k) {
    const double size = squared_distance(place_of(*views[k - 1]), place_of(*views[k]));
    if (size > kMostWithin) jumps.emplace_back(-size, k);
  }
  std::sort(jumps.begin(), jumps.end());
  jumps.resize(std::min(kMost, jumps.size()));
  std::vector<std::size_t> out{views.size()};
  for (const auto& [size, k] : jumps) out.push_back(k);
  std::sort(out.begin(), out.end());
  return out;
}

/// Views from `first` on, before `last`, that are another vehicle's; none: there is one vehicle.
struct Another {
  std::size_t first = 0, last = 0;
};

std::optional<Another> another_vehicle(const Views& views) {
  const double views_alike = alike(views.size());
  const auto whole = explained(views, views_alike);
  // What is gained is at most half the cost.
  if (!whole || 0.5 * whole->cost + log_odds_of_two() < 0.0) return std::nullopt;
  std::optional<Another> best;
  double most = whole->log_evidence;
  const std::vector<std::size_t> places = places_to_cut(views);
  for (std::size_t i = 0; i < places.size(); ++i) {
    for (std::size_t j = i + 1; j < places.size(); ++j) {
      const auto first = views.begin() + static_cast<std::ptrdiff_t>(places[i]);
      const auto last = views.begin() + static_cast<std::ptrdiff_t>(places[j]);
      Views rest(views.begin(), first);
      rest.insert(rest.end(), last, views.end());
      const auto one = explained(rest, views_alike);
      const auto other = explained(Views(first, last), views_alike);
      if (!one || !other) continue;
      const double both = one->log_evidence + other->log_evidence + log_odds_of_two();
      if (both <= most) continue;
      most = both;
      best = Another{places[i], places[j]};
    }
  }
  return best;
}

}  // namespace

TrackPlace place_of(const SeenVehicle& view) {
  const Eigen::Matrix3d turn = view.world_from_camera.rotation_matrix();
  const Eigen::Vector3d along = kOwnRange * view.measured();
  const Eigen::Matrix3d covariance = view.information.inverse() + along * along.transpose();
  return {view.time, view.world_from_camera * view.measured(),
          turn * covariance * turn.transpose()};
}

double squared_distance(const TrackPlace& before, const TrackPlace& after) {
  const double way = kSpeedSigma * (after.time_s - before.time_s);
  const Eigen::Matrix3d covariance =
      before.covariance + after.covariance + way * way * Eigen::Matrix3d::Identity();
  const Eigen::Vector3d off = after.in_world - before.in_world;
  return off.dot(covariance.llt().solve(off));
}

Eigen::Quaterniond mean_rotation(const std::vector<SeenVehicle>& seen) {
  Views views;
  for (const SeenVehicle& view : seen) views.push_back(&view);
  return mean_rotation(views);
}

std::optional<VehiclePath> parked_place(const std::vector<SeenVehicle>& seen) {
  const Views views = views_of(seen);
  const Eigen::Vector3d ahead = mean_rotation(seen) * Eigen::Vector3d::UnitX();
  auto stands = PathFit(views, nullptr, alike(views.size())).solve();
  const auto moves = PathFit(views, &ahead, alike(views.size())).solve();
  if (!stands || !moves) return stands;
  return moves->log_evidence > stands->log_evidence ? std::nullopt : stands;
}

std::vector<std::vector<SeenVehicle>> divided(const std::vector<SeenVehicle>& seen) {
  const Views views = whole_views(seen);
  const std::optional<Another> another = views.size() < 2 ? std::nullopt : another_vehicle(views);
  if (!another) return {seen};
  const auto place = [&](std::size_t view) {
    return view < views.size() ? seen.begin() + (views[view] - seen.data()) : seen.end();
  };
  const auto first = place(another->first), last = place(another->last);
  std::vector<SeenVehicle> rest(seen.begin(), first);
  rest.insert(rest.end(), last, seen.end());
  std::vector<std::vector<SeenVehicle>> out = divided(rest);
  for (std::vector<SeenVehicle>& part : divided({first, last})) out.push_back(std::move(part));
  return out;
}

}  // namespace camber::internal
