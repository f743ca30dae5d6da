#include "camber/vehicle/vehicle_tracks.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <map>
#include <memory>
#include <stdexcept>

#include "camber/core/threads.h"
#include "camber/vehicle/single_view_problem.h"

namespace camber {

namespace {

using namespace internal;

// Changes of pose from one view to the next, of a parked vehicle: what the cameras' motion leaves.
constexpr double kParkedShift = 0.02;  // m
constexpr double kParkedTurn = 0.004;  // rad
// Of a moving one, for each second: off its heading, turning, and changes of speed.
constexpr double kSideways = 0.3;      // m / s
constexpr double kTurning = 0.25;      // rad / s
constexpr double kAcceleration = 4.0;  // m / s^2
constexpr double kSpeed = 15.0;        // m / s, standard deviation of a moving vehicle's speed
// Minus log likelihood by which moving must beat parked: its speed is one more free parameter.
constexpr double kMovingPenalty = 3.5;

struct View {
  std::size_t frame = 0, detection = 0;
};

/// One vehicle in several images: a pose for each, one size and one shape.
class TrackProblem {
 public:
  TrackProblem(const PinholeCamera& camera, const std::vector<TrackFrame>& frames,
               const std::vector<View>& views, const VehicleFitOptions& options)
      : frames_(frames), views_(views) {
    for (const View& view : views) {
      const TrackFrame& frame = frames[view.frame];
      problems_.push_back(std::make_unique<SingleViewProblem>(
          camera, frame.detections[view.detection], frame.supports[view.detection], options,
          /*use_keypoints=*/true, options.num_coefficients));
    }
    shared_ = kSizeParameters + problems_.front()->num_coefficients();
    count_ = static_cast<int>(views.size());
  }

  int num_views() const { return count_; }
  SingleViewProblem& problem(int k) { return *problems_[static_cast<std::size_t>(k)]; }

  /// From here on the views share prior, plane and shape errors.
  void share() {
    for (auto& p : problems_) p->share_among(count_);
  }

  SE3 world_from_vehicle(int k, const State& s) const {
    return frames_[views_[static_cast<std::size_t>(k)].frame].world_from_camera *
           SE3(s.rotation, s.translation);
  }
  void place(int k, const SE3& world_from_vehicle, State* s) const {
    const SE3 pose =
        frames_[views_[static_cast<std::size_t>(k)].frame].world_from_camera.inverse() *
        world_from_vehicle;
    s->rotation = pose.rotation_matrix();
    s->translation = pose.translation();
  }
  double time(int k) const { return frames_[views_[static_cast<std::size_t>(k)].frame].time_s; }

  double evaluate(const std::vector<State>& states, bool parked, Eigen::MatrixXd* hessian,
                  Eigen::VectorXd* gradient, bool observed = false) const {
    const int total = 6 * count_ + shared_;
    if (hessian) {
      hessian->setZero(total, total);
      gradient->setZero(total);
    }
    double cost = 0.0;
    Matrix h;
    Vector g;
    for (int k = 0; k < count_; ++k) {
      cost += problems_[static_cast<std::size_t>(k)]->evaluate(states[static_cast<std::size_t>(k)],
                                                               hessian ? &h : nullptr,
                                                               hessian ? &g : nullptr, observed);
      if (!std::isfinite(cost)) return kInfinity;
      if (!hessian) continue;
      hessian->block(6 * k, 6 * k, 6, 6) += h.topLeftCorner(6, 6);
      hessian->block(6 * k, 6 * count_, 6, shared_) += h.topRightCorner(6, shared_);
      hessian->block(6 * count_, 6 * k, shared_, 6) += h.bottomLeftCorner(shared_, 6);
      hessian->bottomRightCorner(shared_, shared_) += h.bottomRightCorner(shared_, shared_);
      gradient->segment(6 * k, 6) += g.head(6);
      gradient->tail(shared_) += g.tail(shared_);
    }
    add_motion(states, parked, &cost, hessian, gradient);
    return cost;
  }

  double refine(std::vector<State>* states, bool parked, int max_iterations) const {
    Eigen::MatrixXd hessian;
    Eigen::VectorXd gradient;
    double cost = evaluate(*states, parked, &hessian, &gradient);
    double lambda = 1e-3;
    for (int i = 0; i < max_iterations && std::isfinite(cost); ++i) {
      Eigen::MatrixXd damped = hessian;
      damped.diagonal() *= 1.0 + lambda;
      const Eigen::VectorXd step = -damped.ldlt().solve(gradient);
      std::vector<State> candidate = *states;
      for (int k = 0; k < count_; ++k) {
        Vector own(6 + shared_);
        own.head(6) = step.segment(6 * k, 6);
        own.tail(shared_) = step.tail(shared_);
        const double turn = own.segment<3>(3).norm();
        if (turn > 0.3) own.segment<3>(3) *= 0.3 / turn;
        const auto at = static_cast<std::size_t>(k);
        candidate[at] = problems_[at]->moved(candidate[at], own);
      }
      const double next = evaluate(candidate, parked, nullptr, nullptr);
      if (next < cost) {
        const double gain = cost - next;
        *states = std::move(candidate);
        cost = next;
        lambda = std::max(lambda * 0.2, 1e-8);
        if (gain < 1e-3) break;
        evaluate(*states, parked, &hessian, &gradient);
      } else {
        lambda *= 8.0;
        if (lambda > 1e8) break;
      }
    }
    return cost;
  }

  /// Covariance of view k's own parameters (pose, size, coefficients).
  Matrix covariance(int k, const Eigen::MatrixXd& all) const {
    Matrix out(6 + shared_, 6 + shared_);
    out.topLeftCorner(6, 6) = all.block(6 * k, 6 * k, 6, 6);
    out.topRightCorner(6, shared_) = all.block(6 * k, 6 * count_, 6, shared_);
    out.bottomLeftCorner(shared_, 6) = all.block(6 * count_, 6 * k, shared_, 6);
    out.bottomRightCorner(shared_, shared_) = all.bottomRightCorner(shared_, shared_);
    return out;
  }

 private:
  /// Shift and turn from view k to k + 1 in the vehicle's frame at k, with derivatives: rows shift
  /// then turn, columns the six parameters of each pose.
  void step_between(const std::vector<State>& states, int k, Eigen::Matrix<double, 6, 1>* r,
                    Eigen::Matrix<double, 6, 12>* j) const {
    const State &a = states[static_cast<std::size_t>(k)],
                &b = states[static_cast<std::size_t>(k + 1)];
    const SE3& wa = frames_[views_[static_cast<std::size_t>(k)].frame].world_from_camera;
    const SE3& wb = frames_[views_[static_cast<std::size_t>(k + 1)].frame].world_from_camera;
    const Eigen::Matrix3d ra = wa.rotation_matrix() * a.rotation;
    const Eigen::Matrix3d rb = wb.rotation_matrix() * b.rotation;
    const Eigen::Vector3d between = wb * b.translation - wa * a.translation;
    const Eigen::Vector3d shift = ra.transpose() * between;
    const Eigen::Matrix3d turned = ra.transpose() * rb;
    r->head<3>() = shift;
    r->tail<3>() = rotation_to_vector(Eigen::Quaterniond(turned));
    if (!j) return;
    j->setZero();
    j->block<3, 3>(0, 0) = -ra.transpose() * wa.rotation_matrix();
    j->block<3, 3>(0, 3) = skew(shift);
    j->block<3, 3>(0, 6) = ra.transpose() * wb.rotation_matrix();
    // Turns between views are small: the logarithm's derivative is taken as the identity.
    j->block<3, 3>(3, 3) = -turned.transpose();
    j->block<3, 3>(3, 9) = Eigen::Matrix3d::Identity();
  }

  void add_motion(const std::vector<State>& states, bool parked, double* cost,
                  Eigen::MatrixXd* hessian, Eigen::VectorXd* gradient) const {
    Eigen::Matrix<double, 6, 1> r, last;
    Eigen::Matrix<double, 6, 12> j, last_j;
    for (int k = 0; k + 1 < count_; ++k) {
      step_between(states, k, &r, hessian ? &j : nullptr);
      const double dt = std::max(time(k + 1) - time(k), 1e-3);
      Eigen::Matrix<double, 6, 1> sigma;
      if (parked) {
        sigma << Eigen::Vector3d::Constant(kParkedShift), Eigen::Vector3d::Constant(kParkedTurn);
      } else {
        sigma << kSpeed * dt, Eigen::Vector2d::Constant(kSideways * dt),
            Eigen::Vector3d::Constant(kTurning * dt);
      }
      const Eigen::Matrix<double, 6, 1> weight = sigma.cwiseAbs2().cwiseInverse();
      *cost += 0.5 * r.cwiseAbs2().dot(weight);
      if (hessian) {
        hessian->block(6 * k, 6 * k, 12, 12) += j.transpose() * weight.asDiagonal() * j;
        gradient->segment(6 * k, 12) += j.transpose() * weight.cwiseProduct(r);
      }
      if (!parked && k > 0) {  // speed along the heading changes little
        const double before = time(k) - time(k - 1);
        const double change = r[0] / dt - last[0] / before;
        const double s = kAcceleration * 0.5 * (dt + before);
        *cost += 0.5 * change * change / (s * s);
        if (hessian) {
          Eigen::Matrix<double, 18, 1> row = Eigen::Matrix<double, 18, 1>::Zero();
          row.head<12>() -= last_j.row(0).transpose() / before;
          row.tail<12>() += j.row(0).transpose() / dt;
          hessian->block(6 * (k - 1), 6 * (k - 1), 18, 18) += row * row.transpose() / (s * s);
          gradient->segment(6 * (k - 1), 18) += row * (change / (s * s));
        }
      }
      last = r;
      if (hessian) last_j = j;
    }
  }

  const std::vector<TrackFrame>& frames_;
  std::vector<View> views_;
  std::vector<std::unique_ptr<SingleViewProblem>> problems_;
  int count_ = 0, shared_ = 0;
};

bool trusted(const VehicleEstimate& e) { return std::isfinite(e.reprojection_rmse_px); }

double center_spread(const VehicleEstimate& e) {
  return e.covariance.topLeftCorner<3, 3>().trace();
}

/// Solves one track; leaves `out` as it is where the views cannot be joined.
void fit_track(const PinholeCamera& camera, const std::vector<TrackFrame>& frames,
               std::vector<View> views, const VehicleFitOptions& options,
               std::vector<std::vector<VehicleEstimate>>* out) {
  const auto single = [&](const View& v) -> const VehicleEstimate& {
    return frames[v.frame].estimates[v.detection];
  };
  views.erase(std::remove_if(views.begin(), views.end(),
                             [&](const View& v) { return !trusted(single(v)); }),
              views.end());
  if (views.size() < 2) return;
  // The surest view says the heading; views that see another one are not of its opinion.
  const auto best = std::min_element(views.begin(), views.end(), [&](const View& a, const View& b) {
    return center_spread(single(a)) < center_spread(single(b));
  });
  const VehicleEstimate& lead = single(*best);
  const Eigen::Vector3d ahead = frames[best->frame].world_from_camera.rotation() *
                                lead.pose.camera_from_vehicle.rotation_matrix().col(0);
  const View lead_view = *best;
  views.erase(std::remove_if(views.begin(), views.end(),
                             [&](const View& v) {
                               const Eigen::Vector3d other =
                                   frames[v.frame].world_from_camera.rotation() *
                                   single(v).pose.camera_from_vehicle.rotation_matrix().col(0);
                               return other.dot(ahead) < 0.9;
                             }),
              views.end());
  if (views.size() < 2) return;

  TrackProblem problem(camera, frames, views, options);
  const int count = problem.num_views();
  std::vector<State> moving;
  int lead_at = 0;
  for (int k = 0; k < count; ++k) {
    const View& v = views[static_cast<std::size_t>(k)];
    if (v.frame == lead_view.frame) lead_at = k;
    const VehicleEstimate& e = single(v);
    State s = problem.problem(k).mean_state();
    s.rotation = e.pose.camera_from_vehicle.rotation_matrix();
    s.translation = e.pose.bottom_center();
    const auto kept =
        std::min<std::size_t>(e.shape.size(), static_cast<std::size_t>(s.shape.size()));
    for (std::size_t i = 0; i < kept; ++i) s.shape[static_cast<int>(i)] = e.shape[i];
    s.size = {e.pose.dimensions.length, e.pose.dimensions.width, e.pose.dimensions.height};
    problem.problem(k).prepare(s);
    // One size and shape for all.
    s.shape = Vector::Zero(s.shape.size());
    for (std::size_t i = 0; i < std::min(kept, lead.shape.size()); ++i) {
      s.shape[static_cast<int>(i)] = lead.shape[i];
    }
    s.size = {lead.pose.dimensions.length, lead.pose.dimensions.width, lead.pose.dimensions.height};
    moving.push_back(s);
  }
  problem.share();
  std::vector<State> parked = moving;
  const SE3 stand = problem.world_from_vehicle(lead_at, moving[static_cast<std::size_t>(lead_at)]);
  for (int k = 0; k < count; ++k) problem.place(k, stand, &parked[static_cast<std::size_t>(k)]);

  const double parked_cost = problem.refine(&parked, true, 25);
  const double moving_cost = problem.refine(&moving, false, 25);
  const bool stands = parked_cost < moving_cost + kMovingPenalty;
  const std::vector<State>& states = stands ? parked : moving;
  Eigen::MatrixXd hessian;
  Eigen::VectorXd gradient;
  if (!std::isfinite(problem.evaluate(states, stands, &hessian, &gradient, /*observed=*/true)))
    return;
  const Eigen::LDLT<Eigen::MatrixXd> factors(hessian);
  if (factors.info() != Eigen::Success || !factors.isPositive()) return;
  const Eigen::MatrixXd covariance =
      factors.solve(Eigen::MatrixXd::Identity(hessian.rows(), hessian.cols()));
  const VehiclePrior& prior = options.prior ? *options.prior : shipped_vehicle_prior();
  for (int k = 0; k < count; ++k) {
    const View& v = views[static_cast<std::size_t>(k)];
    const State& s = states[static_cast<std::size_t>(k)];
    const TrackFrame& frame = frames[v.frame];
    VehicleEstimate answer = single(v);
    if (!distrust_of(problem.problem(k), s, camera, frame.detections[v.detection].box).empty())
      continue;
    write_answer(problem.problem(k), prior, s, problem.covariance(k, covariance), kInfinity,
                 &answer);
    finish_answer(frame.supports[v.detection], &answer);
    if (answer.status != Status::kFailed) (*out)[v.frame][v.detection] = answer;
  }
}

/// Overlap of an earlier vehicle's box with a later detection: as if it stood still, or as it was.
double track_overlap(const PinholeCamera& camera, const TrackFrame& from, std::size_t i,
                     const TrackFrame& to, std::size_t j) {
  const Box2& later = to.detections[j].box;
  double best = intersection_over_union(from.detections[i].box, later);
  const VehicleEstimate& e = from.estimates[i];
  if (e.status == Status::kFailed || e.status == Status::kNotRun) return best;
  const SE3 to_from_from = to.world_from_camera.inverse() * from.world_from_camera;
  const auto corners = e.pose.corners();
  Box2 here{1e9, 1e9, -1e9, -1e9}, there = here;
  const auto grow = [&](Box2& box, const Eigen::Vector2d& p) {
    box = {std::min(box.x1, p.x()), std::min(box.y1, p.y()), std::max(box.x2, p.x()),
           std::max(box.y2, p.y())};
  };
  for (int k = 0; k < 8; ++k) {
    const Eigen::Vector3d x = corners.col(k);
    const auto before = camera.project(x), after = camera.project(to_from_from * x);
    if (!before || !after) return best;
    grow(here, *before);
    grow(there, *after);
  }
  // The box's own edges moved as the vehicle's corners do: their errors cancel.
  const Box2& box = from.detections[i].box;
  const Box2 moved{box.x1 + there.x1 - here.x1, box.y1 + there.y1 - here.y1,
                   box.x2 + there.x2 - here.x2, box.y2 + there.y2 - here.y2};
  return std::max(best, intersection_over_union(moved.clipped(camera.width, camera.height), later));
}

}  // namespace

std::vector<std::vector<int>> find_tracks(const PinholeCamera& camera,
                                          const std::vector<TrackFrame>& frames) {
  std::vector<std::vector<int>> out;
  for (const TrackFrame& f : frames) {
    if (f.estimates.size() != f.detections.size() || f.supports.size() != f.detections.size()) {
      throw std::invalid_argument(
          fmt::format("frames: {} detections with {} supports and {} estimates",
                      f.detections.size(), f.supports.size(), f.estimates.size()));
    }
    out.emplace_back(f.detections.size(), -1);
  }
  int next = 0;
  std::map<int, int> known;  // given track to number
  for (std::size_t t = 0; t < frames.size(); ++t) {
    const std::vector<VehicleDetection>& now = frames[t].detections;
    for (std::size_t j = 0; j < now.size(); ++j) {
      if (now[j].track < 0) continue;
      const auto [it, fresh] = known.emplace(now[j].track, next);
      next += fresh ? 1 : 0;
      out[t][j] = it->second;
    }
    for (std::size_t back = 1; back <= 2 && back <= t; ++back) {
      const std::size_t s = t - back;
      struct Pair {
        double overlap;
        std::size_t i, j;
      };
      std::vector<Pair> pairs;
      for (std::size_t i = 0; i < frames[s].detections.size(); ++i) {
        if (frames[s].detections[i].track >= 0) continue;
        if (back == 2 &&
            std::find(out[t - 1].begin(), out[t - 1].end(), out[s][i]) != out[t - 1].end()) {
          continue;  // it goes on in the frame between
        }
        for (std::size_t j = 0; j < now.size(); ++j) {
          if (out[t][j] >= 0 || now[j].track >= 0) continue;
          if (now[j].vehicle_class != frames[s].detections[i].vehicle_class) continue;
          const double overlap = track_overlap(camera, frames[s], i, frames[t], j);
          if (overlap >= 0.3) pairs.push_back({overlap, i, j});
        }
      }
      std::stable_sort(pairs.begin(), pairs.end(),
                       [](const Pair& a, const Pair& b) { return a.overlap > b.overlap; });
      std::vector<bool> used(frames[s].detections.size());
      for (const Pair& p : pairs) {
        if (used[p.i] || out[t][p.j] >= 0) continue;
        used[p.i] = true;
        out[t][p.j] = out[s][p.i];
      }
    }
    for (std::size_t j = 0; j < now.size(); ++j) {
      if (out[t][j] < 0) out[t][j] = next++;
    }
  }
  return out;
}

std::vector<std::vector<VehicleEstimate>> fit_tracks(const PinholeCamera& camera,
                                                     const std::vector<TrackFrame>& frames,
                                                     const VehicleFitOptions& options,
                                                     int num_threads) {
  options.validate();
  const std::vector<std::vector<int>> numbers = find_tracks(camera, frames);
  std::map<int, std::vector<View>> tracks;
  std::vector<std::vector<VehicleEstimate>> out;
  for (std::size_t t = 0; t < frames.size(); ++t) {
    out.push_back(frames[t].estimates);
    for (std::size_t j = 0; j < numbers[t].size(); ++j) tracks[numbers[t][j]].push_back({t, j});
  }
  std::vector<std::vector<View>> lists;
  for (auto& [number, views] : tracks) {
    (void)number;
    // A given track may name two detections of one frame: the first stands.
    views.erase(std::unique(views.begin(), views.end(),
                            [](const View& a, const View& b) { return a.frame == b.frame; }),
                views.end());
    if (views.size() > 1) lists.push_back(views);
  }
  parallel_for(lists.size(), num_threads,
               [&](std::size_t i) { fit_track(camera, frames, lists[i], options, &out); });
  return out;
}

}  // namespace camber
