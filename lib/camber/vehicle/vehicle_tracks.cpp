#include "camber/vehicle/vehicle_tracks.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <memory>
#include <optional>
#include <stdexcept>

#include "camber/core/threads.h"
#include "camber/vehicle/detail/ground_propagation.h"
#include "camber/vehicle/single_view_problem.h"
#include "camber/vehicle/vehicle_registration.h"

namespace camber {

namespace {

using namespace internal;

// Changes of pose from one view to the next, of a parked vehicle: what the cameras' motion leaves.
constexpr double kParkedShift = 0.002;  // m, beside the cameras' own
constexpr double kParkedTurn = 0.001;   // rad
// Of a moving one, for each second: off its heading, turning, and changes of speed.
constexpr double kSideways = 0.3;      // m / s
constexpr double kTurning = 0.25;      // rad / s
constexpr double kAcceleration = 4.0;  // m / s^2
constexpr double kSpeed = 15.0;        // m / s, standard deviation of a moving vehicle's speed
// Squared standard deviations beyond which a registration loses its weight: it may have failed.
constexpr double kLinkScale = 9.0;
constexpr int kGroundRounds = 2;  // of message passing

using View = TrackView;

struct TrackState {
  std::vector<State> views;  // one size and shape for all
  double log_scale = 0.0;    // of the way between the cameras
  ShapeErrors errors = ShapeErrors::Zero();
};

/// Normal equations of a track; the shape errors are eliminated.
struct TrackEquations {
  Eigen::MatrixXd hessian;  // of the others, once the shape errors follow
  Eigen::VectorXd gradient;
  // errors = -(errors_at + errors_by * step) for a step of the others
  Eigen::Matrix<double, 3 * kNumKeypoints, Eigen::Dynamic> errors_by;
  Eigen::Matrix<double, 3 * kNumKeypoints, 1> errors_at;
  double errors_log_determinant = 0.0;
};

/// One vehicle in several images: a pose for each, one size and one shape.
class TrackProblem {
 public:
  TrackProblem(const PinholeCamera& camera, const std::vector<TrackFrame>& frames,
               const std::vector<View>& views, const VehicleFitOptions& options, double scale_sigma)
      : camera_(camera),
        frames_(frames),
        views_(views),
        scale_variance_(scale_sigma * scale_sigma) {
    for (const View& view : views) {
      supports_.push_back(frames[view.frame].supports[view.detection]);
    }
    for (std::size_t k = 0; k < views.size(); ++k) {
      problems_.push_back(std::make_unique<SingleViewProblem>(
          camera, frames[views[k].frame].detections[views[k].detection], supports_[k], options,
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

  /// Registers the grey values of every view with those of view `lead`, from poses that are right
  /// to a few pixels.
  void register_views(const VehiclePrior& prior, int lead, const TrackState& state) {
    const std::vector<State>& states = state.views;
    links_.clear();
    const View& from = views_[static_cast<std::size_t>(lead)];
    const TrackFrame& first = frames_[from.frame];
    if (!first.image) return;
    const State& here = states[static_cast<std::size_t>(lead)];
    VehicleEstimate vehicle = first.estimates[from.detection];
    write_state(prior, here, &vehicle);
    std::vector<const VehicleEstimate*> others;
    for (std::size_t i = 0; i < first.detections.size(); ++i) {
      const VehicleEstimate& other = first.estimates[i];
      if (i == from.detection || other.status == Status::kFailed) continue;
      if (other.pose.bottom_center().norm() < here.translation.norm()) {
        others.push_back(&other);
      }
    }
    std::vector<VehicleShift> shifts;
    const auto pixels = VehicleTemplate::cut(camera_, *first.image, vehicle, others);
    if (!pixels) return;
    const SE3 lead_pose(here.rotation, here.translation);
    for (int k = 0; k < count_; ++k) {
      if (k == lead) continue;
      const TrackFrame& second = frames_[views_[static_cast<std::size_t>(k)].frame];
      if (!second.image) continue;
      const State& there = states[static_cast<std::size_t>(k)];
      const auto shift = pixels->find_in(
          *second.image, SE3(there.rotation, there.translation) * lead_pose.inverse());
      if (!shift) continue;
      Link link;
      link.a = lead;
      link.b = k;
      const Eigen::Vector3d c = lead_pose.inverse() * shift->anchor;
      link.share = {c.x() / here.size[0], c.y() / here.size[2], c.z() / here.size[1]};
      link.measured << shift->displacement, shift->log_depth_ratio;
      shifts.push_back(*shift);
      links_.push_back(link);
    }
    for (std::size_t i = 0; i < links_.size(); ++i) {
      links_[i].information = shifts[i].noise.inverse();
      links_[i].by_common << Eigen::Matrix3d::Identity(), shifts[i].by_depth;
    }
    if (links_.empty()) return;
    common_information_.setZero();  // one template has them all
    common_information_.topLeftCorner<3, 3>() = shifts.front().shared.inverse();
    common_information_(3, 3) = 1.0 / (shifts.front().depth_sigma * shifts.front().depth_sigma);
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

  /// Minus log posterior. Parameters: poses of the views, size and coefficients, log scale of the
  /// cameras' way; and what the coefficients leave of the shape, the same in all views.
  double evaluate(const TrackState& state, bool parked, TrackEquations* equations,
                  bool observed = false) const {
    const std::vector<State>& states = state.views;
    const int total = 6 * count_ + shared_ + 1;
    Eigen::MatrixXd* hessian = equations ? &equations->hessian : nullptr;
    Eigen::VectorXd* gradient = equations ? &equations->gradient : nullptr;
    if (equations) {
      hessian->setZero(total, total);
      gradient->setZero(total);
    }
    // One view's shape errors are integrated out exactly.
    const ShapeErrors* errors = count_ > 1 ? &state.errors : nullptr;
    std::vector<std::array<ShapeErrorTerms, kNumKeypoints>> terms;
    if (equations && errors) terms.resize(static_cast<std::size_t>(count_));
    double cost = 0.0;
    Matrix h;
    Vector g;
    for (int k = 0; k < count_; ++k) {
      const auto at = static_cast<std::size_t>(k);
      cost +=
          problems_[at]->evaluate(states[at], equations ? &h : nullptr, equations ? &g : nullptr,
                                  observed, errors, terms.empty() ? nullptr : &terms[at]);
      if (!std::isfinite(cost)) return kInfinity;
      if (!equations) continue;
      hessian->block(6 * k, 6 * k, 6, 6) += h.topLeftCorner(6, 6);
      hessian->block(6 * k, 6 * count_, 6, shared_) += h.topRightCorner(6, shared_);
      hessian->block(6 * count_, 6 * k, shared_, 6) += h.bottomLeftCorner(shared_, 6);
      hessian->block(6 * count_, 6 * count_, shared_, shared_) +=
          h.bottomRightCorner(shared_, shared_);
      gradient->segment(6 * k, 6) += g.head(6);
      gradient->segment(6 * count_, shared_) += g.tail(shared_);
    }
    const double scale_weight = 1.0 / scale_variance_;
    const double scale_off = state.log_scale - scale_mean_;
    cost += 0.5 * scale_weight * scale_off * scale_off;
    if (equations) {
      (*hessian)(total - 1, total - 1) += scale_weight;
      (*gradient)[total - 1] += scale_weight * scale_off;
    }
    add_motion(state, parked, &cost, hessian, gradient);
    if (!add_links(states, &cost, hessian, gradient)) return kInfinity;
    if (errors) {
      for (int i = 0; i < kNumKeypoints; ++i) {
        cost += 0.5 * error_weight(i) * errors->col(i).squaredNorm();
      }
    }
    if (!terms.empty()) eliminate_errors(*errors, terms, equations);
    return cost;
  }

  /// What integrating out the shape adds to the gradient (SingleViewProblem::shape_pull).
  Eigen::VectorXd shape_pull(const TrackState& state, const TrackEquations& equations) const {
    Eigen::VectorXd pull = Eigen::VectorXd::Zero(equations.hessian.rows());
    const int shape = shared_ - kSizeParameters, size_at = 6 * count_;
    if (shape == 0) return pull;
    const int shape_at = size_at + kSizeParameters;
    const Eigen::MatrixXd block = equations.hessian.block(shape_at, shape_at, shape, shape);
    const Eigen::MatrixXd of_shape = block.ldlt().solve(Eigen::MatrixXd::Identity(shape, shape));
    const ShapeErrors* errors = count_ > 1 ? &state.errors : nullptr;
    Eigen::MatrixXd errors_by_shape;
    if (errors) errors_by_shape = equations.errors_by.middleCols(shape_at, shape);
    for (int k = 0; k < count_; ++k) {
      const auto at = static_cast<std::size_t>(k);
      const auto own =
          problems_[at]->shape_pull(state.views[at], of_shape, errors, errors_by_shape);
      pull.segment(6 * k, 6) += own.head<kPoseParameters>();
      pull.segment<kSizeParameters>(size_at) += own.tail<kSizeParameters>();
    }
    return pull;
  }

  /// Moved by a step of all parameters.
  TrackState moved(const TrackState& state, const Eigen::VectorXd& step) const {
    TrackState out = state;
    out.log_scale += step[step.size() - 1];
    for (int k = 0; k < count_; ++k) {
      Vector own(6 + shared_);
      own.head(6) = step.segment(6 * k, 6);
      own.tail(shared_) = step.segment(6 * count_, shared_);
      const double turn = own.segment<3>(3).norm();
      if (turn > 0.3) own.segment<3>(3) *= 0.3 / turn;
      const auto at = static_cast<std::size_t>(k);
      out.views[at] = problems_[at]->moved(out.views[at], own);
    }
    return out;
  }

  /// Minus log evidence of a hypothesis (Laplace), up to what both share.
  double evidence(const TrackState& state, bool parked) const {
    TrackEquations equations;
    double cost = evaluate(state, parked, &equations);
    const Eigen::LDLT<Eigen::MatrixXd> factors(equations.hessian);
    if (!std::isfinite(cost) || factors.info() != Eigen::Success || !factors.isPositive()) {
      return kInfinity;
    }
    cost += 0.5 * (factors.vectorD().array().log().sum() + equations.errors_log_determinant);
    for (int k = 0; k + 1 < count_; ++k) {
      cost += motion_sigma(state.views, k, parked).array().log().sum();
    }
    return cost;
  }

  /// What is known of view k's plane and of the scale: changes of the frame's own support plane and
  /// their covariance.
  void set_plane(int k, const Eigen::Vector3d& mean, const Eigen::Matrix3d& covariance) {
    const View& v = views_[static_cast<std::size_t>(k)];
    UncertainPlane& plane = supports_[static_cast<std::size_t>(k)].plane;
    plane = frames_[v.frame].supports[v.detection].plane;
    plane.plane = plane.perturbed(mean);
    plane.covariance = covariance;
  }
  void set_scale(double mean, double variance) {
    scale_mean_ = mean;
    scale_variance_ = variance;
  }

  /// What the vehicle measures of the plane under view `lead` (as changes of the frame's own
  /// support plane) and of the log scale: its posterior without their priors.
  std::optional<GroundMessage> message(int lead, const TrackState& state, bool parked) const {
    for (const bool observed : {true, false}) {
      TrackEquations equations;
      if (!std::isfinite(evaluate(state, parked, &equations, observed))) continue;
      Eigen::MatrixXd& hessian = equations.hessian;
      Eigen::VectorXd& gradient = equations.gradient;
      gradient += shape_pull(state, equations);
      Matrix h;
      Vector g;
      for (int k = 0; k < count_; ++k) {
        // A plane depends on the pose alone.
        problems_[static_cast<std::size_t>(k)]->plane_terms(
            state.views[static_cast<std::size_t>(k)], &h, &g);
        hessian.block(6 * k, 6 * k, 6, 6) -= h.topLeftCorner(6, 6);
        gradient.segment(6 * k, 6) -= g.head(6);
      }
      const Eigen::Index rest = hessian.rows() - 1;
      hessian(rest, rest) -= 1.0 / scale_variance_;
      gradient[rest] -= (state.log_scale - scale_mean_) / scale_variance_;

      auto out = ground_message(hessian, gradient, 6 * lead,
                                problems_[static_cast<std::size_t>(lead)]->stance_terms(
                                    state.views[static_cast<std::size_t>(lead)]));
      if (!out) continue;
      // From the changes at this state to those of the frame's own plane.
      const View& v = views_[static_cast<std::size_t>(lead)];
      const UncertainPlane& own = frames_[v.frame].supports[v.detection].plane;
      const UncertainPlane& now = supports_[static_cast<std::size_t>(lead)].plane;
      Eigen::Vector4d moved;
      const Eigen::Vector3d turn = now.plane.normal - own.plane.normal;
      moved << -own.axis2.dot(turn), own.axis1.dot(turn),
          own.plane.signed_distance(own.centroid) - now.plane.signed_distance(own.centroid),
          state.log_scale;
      out->information_vector += out->information * moved;
      return out;
    }
    return std::nullopt;
  }

  double refine(TrackState* state, bool parked, int max_iterations, double tolerance) const {
    TrackEquations equations;
    double cost = evaluate(*state, parked, &equations);
    double lambda = 1e-3;
    for (int i = 0; i < max_iterations && std::isfinite(cost); ++i) {
      Eigen::MatrixXd damped = equations.hessian;
      damped.diagonal() *= 1.0 + lambda;
      const Eigen::VectorXd step = -damped.ldlt().solve(equations.gradient);
      TrackState candidate = moved(*state, step);
      if (count_ > 1) {
        const Eigen::Matrix<double, 3 * kNumKeypoints, 1> change =
            equations.errors_at + equations.errors_by * step;
        candidate.errors.reshaped() -= change;
      }
      const double next = evaluate(candidate, parked, nullptr);
      if (next < cost) {
        const double gain = cost - next;
        *state = std::move(candidate);
        cost = next;
        lambda = std::max(lambda * 0.2, 1e-8);
        if (gain < tolerance) break;
        evaluate(*state, parked, &equations);
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
    out.bottomRightCorner(shared_, shared_) = all.block(6 * count_, 6 * count_, shared_, shared_);
    return out;
  }

 private:
  double error_weight(int keypoint) const {
    const double sigma = problems_.front()->shape_error_sigma(keypoint);
    return 1.0 / std::max(sigma * sigma, 1e-8);
  }

  /// Schur complement of the shape errors, 3 x 3 each.
  void eliminate_errors(const ShapeErrors& errors,
                        const std::vector<std::array<ShapeErrorTerms, kNumKeypoints>>& terms,
                        TrackEquations* equations) const {
    const Eigen::Index total = equations->hessian.rows();
    std::array<Eigen::Matrix3d, kNumKeypoints> own;
    Eigen::Matrix<double, 3 * kNumKeypoints, 1> gradient;
    Eigen::Matrix<double, 3 * kNumKeypoints, Eigen::Dynamic> cross;
    cross.setZero(3 * kNumKeypoints, total);
    for (int i = 0; i < kNumKeypoints; ++i) {
      own[static_cast<std::size_t>(i)] = error_weight(i) * Eigen::Matrix3d::Identity();
      gradient.segment<3>(3 * i) = error_weight(i) * errors.col(i);
    }
    for (int k = 0; k < count_; ++k) {
      const auto at = static_cast<std::size_t>(k);
      for (const int i : problems_[at]->used_keypoints()) {
        const ShapeErrorTerms& t = terms[at][static_cast<std::size_t>(i)];
        own[static_cast<std::size_t>(i)] += t.own;
        gradient.segment<3>(3 * i) += t.gradient;
        cross.block<3, 6>(3 * i, 6 * k) += t.cross.leftCols<6>();
        cross.block(3 * i, 6 * count_, 3, shared_) += t.cross.rightCols(shared_);
      }
    }
    equations->errors_by.resize(3 * kNumKeypoints, total);
    equations->errors_log_determinant = 0.0;
    for (int i = 0; i < kNumKeypoints; ++i) {
      const Eigen::Matrix3d inverse = own[static_cast<std::size_t>(i)].inverse();
      equations->errors_by.middleRows<3>(3 * i).noalias() = inverse * cross.middleRows<3>(3 * i);
      equations->errors_at.segment<3>(3 * i) = inverse * gradient.segment<3>(3 * i);
      equations->errors_log_determinant -= std::log(inverse.determinant());
    }
    equations->hessian.noalias() -= cross.transpose() * equations->errors_by;
    equations->gradient.noalias() -= cross.transpose() * equations->errors_at;
  }

  /// Shift and turn from view k to k + 1 in the vehicle's frame at k, with derivatives: rows shift
  /// then turn, columns the six parameters of each pose.
  using Step = Eigen::Matrix<double, 6, 1>;
  using StepJacobian = Eigen::Matrix<double, 6, 13>;  // pose at k, pose at k + 1, log scale

  void step_between(const TrackState& state, int k, Step* r, StepJacobian* j) const {
    const State &a = state.views[static_cast<std::size_t>(k)],
                &b = state.views[static_cast<std::size_t>(k + 1)];
    const SE3& wa = frames_[views_[static_cast<std::size_t>(k)].frame].world_from_camera;
    const SE3& wb = frames_[views_[static_cast<std::size_t>(k + 1)].frame].world_from_camera;
    const Eigen::Matrix3d ra = wa.rotation_matrix() * a.rotation;
    const Eigen::Matrix3d rb = wb.rotation_matrix() * b.rotation;
    const Eigen::Vector3d way = std::exp(state.log_scale) * (wb.translation() - wa.translation());
    const Eigen::Vector3d between =
        wb.rotation() * b.translation - wa.rotation() * a.translation + way;
    const Eigen::Vector3d shift = ra.transpose() * between;
    const Eigen::Matrix3d turned = ra.transpose() * rb;
    r->head<3>() = shift;
    r->tail<3>() = rotation_to_vector(Eigen::Quaterniond(turned));
    if (!j) return;
    j->setZero();
    j->block<3, 3>(0, 0) = -ra.transpose() * wa.rotation_matrix();
    j->block<3, 3>(0, 3) = skew(shift);
    j->block<3, 3>(0, 6) = ra.transpose() * wb.rotation_matrix();
    j->block<3, 1>(0, 12) = ra.transpose() * way;
    // Turns between views are small: the logarithm's derivative is taken as the identity.
    j->block<3, 3>(3, 3) = -turned.transpose();
    j->block<3, 3>(3, 9) = Eigen::Matrix3d::Identity();
  }

  double interval(int k) const { return std::max(time(k + 1) - time(k), 1e-3); }

  /// Of the step from view k to k + 1; of its first component, for a moving vehicle after the first
  /// step, that of the change against the step before.
  Eigen::Matrix<double, 6, 1> motion_sigma(const std::vector<State>& states, int k,
                                           bool parked) const {
    Eigen::Matrix<double, 6, 1> sigma;
    if (parked) {
      const TrackFrame& a = frames_[views_[static_cast<std::size_t>(k)].frame];
      const TrackFrame& b = frames_[views_[static_cast<std::size_t>(k + 1)].frame];
      const double turn = std::hypot(a.pose_sigma_turn, b.pose_sigma_turn);
      const double shift = std::hypot(a.pose_sigma_shift, b.pose_sigma_shift, kParkedShift);
      sigma << Eigen::Vector3d::Constant(
          std::hypot(shift, turn * states[static_cast<std::size_t>(k)].translation.norm())),
          Eigen::Vector3d::Constant(std::hypot(turn, kParkedTurn));
      return sigma;
    }
    const double dt = interval(k);
    const double along = k == 0 ? kSpeed * dt : kAcceleration * 0.5 * (dt + interval(k - 1)) * dt;
    sigma << along, Eigen::Vector2d::Constant(kSideways * dt),
        Eigen::Vector3d::Constant(kTurning * dt);
    return sigma;
  }

  void add_motion(const TrackState& state, bool parked, double* cost, Eigen::MatrixXd* hessian,
                  Eigen::VectorXd* gradient) const {
    Step r, last;
    StepJacobian j, last_j;
    const int scale_at = 6 * count_ + shared_;
    for (int k = 0; k + 1 < count_; ++k) {
      step_between(state, k, &r, hessian ? &j : nullptr);
      Step weight = motion_sigma(state.views, k, parked).cwiseAbs2().cwiseInverse();
      const double along_weight = weight[0];
      const bool follows = !parked && k > 0;  // its speed changes little
      if (follows) weight[0] = 0.0;
      *cost += 0.5 * r.cwiseAbs2().dot(weight);
      if (hessian) {
        const StepJacobian weighted = weight.asDiagonal() * j;
        scatter<13>(j.transpose() * weighted, weighted.transpose() * r,
                    {{6 * k, 0, 12}, {scale_at, 12, 1}}, hessian, gradient);
      }
      if (follows) {
        const double ratio = interval(k) / interval(k - 1);
        const double change = r[0] - ratio * last[0];
        *cost += 0.5 * along_weight * change * change;
        if (hessian) {
          Eigen::Matrix<double, 19, 1> row = Eigen::Matrix<double, 19, 1>::Zero();
          row.head<12>() -= ratio * last_j.block<1, 12>(0, 0).transpose();
          row.segment<12>(6) += j.block<1, 12>(0, 0).transpose();
          row[18] = j(0, 12) - ratio * last_j(0, 12);
          scatter<19>(along_weight * row * row.transpose(), along_weight * change * row,
                      {{6 * (k - 1), 0, 18}, {scale_at, 18, 1}}, hessian, gradient);
        }
      }
      last = r;
      if (hessian) last_j = j;
    }
  }

  /// Where a run of a term's own parameters lies among all.
  struct Place {
    int all, own, length;
  };
  template <int N>
  static void scatter(const Eigen::Matrix<double, N, N>& h, const Eigen::Matrix<double, N, 1>& g,
                      const std::vector<Place>& places, Eigen::MatrixXd* hessian,
                      Eigen::VectorXd* gradient) {
    for (const Place& p : places) {
      gradient->segment(p.all, p.length) += g.segment(p.own, p.length);
      for (const Place& q : places) {
        hessian->block(p.all, q.all, p.length, q.length) +=
            h.block(p.own, q.own, p.length, q.length);
      }
    }
  }

  /// A registration at a state: where its place on the body is, and what is missing.
  struct LinkRow {
    Eigen::Vector3d body, xa, xb;  // vehicle's frame; cameras of the two views
    Eigen::Vector3d residual;
  };

  /// Errors that all registrations have in common (the lead image's own, the depth of the body),
  /// given the residuals; `information` is what is then known of them.
  Eigen::Vector4d common_errors(const std::vector<LinkRow>& rows,
                                Eigen::Matrix4d* information) const {
    Eigen::Vector4d common = Eigen::Vector4d::Zero();
    for (int round = 0; round < 20; ++round) {
      *information = common_information_;
      Eigen::Vector4d right = Eigen::Vector4d::Zero();
      for (std::size_t i = 0; i < rows.size(); ++i) {
        const Link& link = links_[i];
        const Eigen::Vector3d r = rows[i].residual - link.by_common * common;
        const double weight = 1.0 / (1.0 + r.dot(link.information * r) / kLinkScale);
        const Eigen::Matrix<double, 4, 3> weighted =
            weight * link.by_common.transpose() * link.information;
        *information += weighted * link.by_common;
        right += weighted * rows[i].residual;
      }
      const Eigen::Vector4d next = information->ldlt().solve(right);
      const Eigen::Vector4d change = next - common;
      common = next;
      if (change.dot(*information * change) < 1e-10) break;
    }
    return common;
  }

  /// What the registered grey values say of the poses of all views against the lead's. The errors
  /// that they have in common are solved for at every state and eliminated.
  bool add_links(const std::vector<State>& states, double* cost, Eigen::MatrixXd* hessian,
                 Eigen::VectorXd* gradient) const {
    if (links_.empty()) return true;
    std::vector<LinkRow> rows;
    for (const Link& link : links_) {
      const State& sa = states[static_cast<std::size_t>(link.a)];
      const State& sb = states[static_cast<std::size_t>(link.b)];
      LinkRow row;
      row.body = {link.share.x() * sa.size[0], link.share.y() * sa.size[2],
                  link.share.z() * sa.size[1]};
      row.xa = sa.rotation * row.body + sa.translation;
      row.xb = sb.rotation * row.body + sb.translation;
      if (!(row.xa.z() > 0.3) || !(row.xb.z() > 0.3)) return false;
      row.residual << camera_.fx * (row.xb.x() / row.xb.z() - row.xa.x() / row.xa.z()),
          camera_.fy * (row.xb.y() / row.xb.z() - row.xa.y() / row.xa.z()),
          std::log(row.xb.z() / row.xa.z());
      row.residual -= link.measured;
      rows.push_back(row);
    }
    Eigen::Matrix4d common_information;
    const Eigen::Vector4d common = common_errors(rows, &common_information);
    *cost += 0.5 * common.dot(common_information_ * common);
    Eigen::Matrix<double, 4, Eigen::Dynamic> common_by_state;
    if (hessian) common_by_state.setZero(4, hessian->cols());
    for (std::size_t i = 0; i < rows.size(); ++i) {
      const Link& link = links_[i];
      const LinkRow& row = rows[i];
      const Eigen::Vector3d r = row.residual - link.by_common * common;
      const double squared = r.dot(link.information * r);
      *cost += 0.5 * kLinkScale * std::log1p(squared / kLinkScale);
      if (!hessian) continue;
      const State& sa = states[static_cast<std::size_t>(link.a)];
      const State& sb = states[static_cast<std::size_t>(link.b)];
      const Eigen::Matrix3d information = link.information / (1.0 + squared / kLinkScale);
      const auto to_measured = [&](const Eigen::Vector3d& x) {
        Eigen::Matrix3d j;
        const double iz = 1.0 / x.z();
        j << camera_.fx * iz, 0.0, -camera_.fx * x.x() * iz * iz, 0.0, camera_.fy * iz,
            -camera_.fy * x.y() * iz * iz, 0.0, 0.0, iz;
        return j;
      };
      Eigen::Matrix<double, 3, 15> j;  // pose of a, pose of b, size
      const Eigen::Matrix3d ja = -to_measured(row.xa), jb = to_measured(row.xb);
      j.block<3, 3>(0, 0) = ja;
      j.block<3, 3>(0, 3) = -ja * sa.rotation * skew(row.body);
      j.block<3, 3>(0, 6) = jb;
      j.block<3, 3>(0, 9) = -jb * sb.rotation * skew(row.body);
      const Eigen::Matrix3d turned = ja * sa.rotation + jb * sb.rotation;
      j.col(12) = turned.col(0) * link.share.x();
      j.col(13) = turned.col(2) * link.share.z();
      j.col(14) = turned.col(1) * link.share.y();
      const Eigen::Matrix<double, 3, 15> weighted = information * j;
      scatter<15>(j.transpose() * weighted, weighted.transpose() * r,
                  {{6 * link.a, 0, 6}, {6 * link.b, 6, 6}, {6 * count_, 12, 3}}, hessian, gradient);
      const Eigen::Matrix<double, 4, 15> own = link.by_common.transpose() * weighted;
      common_by_state.middleCols(6 * link.a, 6) += own.leftCols(6);
      common_by_state.middleCols(6 * link.b, 6) += own.middleCols(6, 6);
      common_by_state.middleCols(6 * count_, 3) += own.rightCols(3);
    }
    if (hessian) {
      *hessian -= common_by_state.transpose() * common_information.ldlt().solve(common_by_state);
    }
    return true;
  }

  struct Link {
    int a = 0, b = 0;  // views
    Eigen::Vector3d share = Eigen::Vector3d::Zero(), measured = Eigen::Vector3d::Zero();
    Eigen::Matrix3d information = Eigen::Matrix3d::Zero();
    Eigen::Matrix<double, 3, 4> by_common = Eigen::Matrix<double, 3, 4>::Zero();
  };

  const PinholeCamera& camera_;
  const std::vector<TrackFrame>& frames_;
  std::vector<View> views_;
  std::vector<SupportPlane> supports_;  // one a view
  double scale_mean_ = 0.0, scale_variance_;
  std::vector<Link> links_;
  Eigen::Matrix4d common_information_ = Eigen::Matrix4d::Identity();  // on what the links share
  std::vector<std::unique_ptr<SingleViewProblem>> problems_;
  int count_ = 0, shared_ = 0;
};

bool trusted(const VehicleEstimate& e) { return std::isfinite(e.reprojection_rmse_px); }

double center_spread(const VehicleEstimate& e) {
  return e.covariance.topLeftCorner<3, 3>().trace();
}

/// One vehicle being solved.
struct SolvedTrack {
  std::vector<View> views;  // of one opinion
  int lead = 0;             // the surest of them
  std::unique_ptr<TrackProblem> problem;
  TrackState moving, parked;
  bool stands = false;  // parked, by the evidence
  const TrackState& answer() const { return stands ? parked : moving; }
};

/// A view of a track and where its vehicle is refined from.
struct TrackStart {
  View view;
  const VehicleEstimate* own = nullptr;
  Eigen::Vector3d ahead;        // the vehicle's heading, world
  std::optional<State> turned;  // in place of the single fit: the other way round
};

State state_of(const VehicleEstimate& e, const SingleViewProblem& problem) {
  State s = problem.mean_state();
  s.rotation = e.pose.camera_from_vehicle.rotation_matrix();
  s.translation = e.pose.bottom_center();
  const auto kept = std::min<std::size_t>(e.shape.size(), static_cast<std::size_t>(s.shape.size()));
  for (std::size_t i = 0; i < kept; ++i) s.shape[static_cast<int>(i)] = e.shape[i];
  s.size = {e.pose.dimensions.length, e.pose.dimensions.width, e.pose.dimensions.height};
  return s;
}

/// Views that see the vehicle the other way round: front and rear of a far one look alike in each
/// of them, but not in all. Every view says what it thinks of both headings, and all take the
/// likelier one; a view that is sure of the other is dropped.
void agree_on_heading(const PinholeCamera& camera, const std::vector<TrackFrame>& frames,
                      const VehicleFitOptions& options, const Eigen::Vector3d& ahead,
                      std::vector<TrackStart>* starts) {
  constexpr double kSure = 15.0;  // log likelihood
  struct Opinion {
    double cost[2];  // along `ahead`, and the other way
    State state[2];
  };
  std::vector<Opinion> opinions;
  double difference = 0.0;
  for (const TrackStart& start : *starts) {
    const TrackFrame& frame = frames[start.view.frame];
    SingleViewProblem problem(camera, frame.detections[start.view.detection],
                              frame.supports[start.view.detection], options,
                              /*use_keypoints=*/true, options.num_coefficients);
    const State own = state_of(*start.own, problem);
    State turned = own;
    turned.rotation.col(0) *= -1.0;
    turned.rotation.col(2) *= -1.0;
    const int same = start.ahead.dot(ahead) > 0.0 ? 0 : 1;
    Opinion opinion;
    opinion.state[same] = own;
    opinion.state[1 - same] = turned;
    for (int i = 0; i < 2; ++i) {
      for (int round = 0; round < 3; ++round) {
        problem.update_visibility(opinion.state[i]);
        opinion.cost[i] = problem.refine(&opinion.state[i], 8, 1e-2);
      }
    }
    difference += std::clamp(opinion.cost[1] - opinion.cost[0], -kSure, kSure);
    opinions.push_back(opinion);
  }
  const int chosen = difference < 0.0 ? 1 : 0;
  std::vector<TrackStart> out;
  for (std::size_t i = 0; i < starts->size(); ++i) {
    TrackStart start = (*starts)[i];
    const Opinion& opinion = opinions[i];
    if (!(opinion.cost[chosen] < opinion.cost[1 - chosen] + kSure)) continue;
    if ((start.ahead.dot(ahead) > 0.0 ? 0 : 1) != chosen) start.turned = opinion.state[chosen];
    out.push_back(std::move(start));
  }
  *starts = std::move(out);
}

/// Chooses the views of a track that can be joined and starts from their single fits.
/// @return nothing if fewer than `least_views` are left.
std::optional<SolvedTrack> start_track(const PinholeCamera& camera,
                                       const std::vector<TrackFrame>& frames,
                                       const std::vector<View>& track,
                                       const VehicleFitOptions& options, double scale_sigma,
                                       std::size_t least_views) {
  std::vector<TrackStart> starts;
  for (const View& v : track) {
    const TrackFrame& frame = frames[v.frame];
    const VehicleEstimate& e = frame.estimates[v.detection];
    if (!trusted(e)) continue;
    starts.push_back(
        {v, &e,
         frame.world_from_camera.rotation() * e.pose.camera_from_vehicle.rotation_matrix().col(0),
         std::nullopt});
  }
  if (starts.size() < std::max<std::size_t>(least_views, 1)) return std::nullopt;
  const auto surest = [&] {
    return std::min_element(starts.begin(), starts.end(),
                            [](const TrackStart& a, const TrackStart& b) {
                              return center_spread(*a.own) < center_spread(*b.own);
                            });
  };
  // The surest view says the heading, but for its sense; views that see another one are not of its
  // opinion.
  const Eigen::Vector3d ahead = surest()->ahead;
  starts.erase(
      std::remove_if(starts.begin(), starts.end(),
                     [&](const TrackStart& s) { return std::abs(s.ahead.dot(ahead)) < 0.9; }),
      starts.end());
  if (std::any_of(starts.begin(), starts.end(),
                  [&](const TrackStart& s) { return s.ahead.dot(ahead) < 0.0; })) {
    agree_on_heading(camera, frames, options, ahead, &starts);
  }
  // Its keypoints' names stay swapped here: its own fit knows better.
  if (starts.size() < std::max<std::size_t>(least_views, 1) ||
      (starts.size() == 1 && starts.front().own->reason == kSidesSwapped)) {
    return std::nullopt;
  }

  SolvedTrack out;
  for (const TrackStart& s : starts) out.views.push_back(s.view);
  out.lead = static_cast<int>(surest() - starts.begin());
  out.problem = std::make_unique<TrackProblem>(camera, frames, out.views, options, scale_sigma);
  for (std::size_t k = 0; k < starts.size(); ++k) {
    SingleViewProblem& problem = out.problem->problem(static_cast<int>(k));
    State s = starts[k].turned ? *starts[k].turned : state_of(*starts[k].own, problem);
    problem.prepare(s);
    out.moving.views.push_back(s);
  }
  // One size and shape for all.
  const State lead = out.moving.views[static_cast<std::size_t>(out.lead)];
  for (State& s : out.moving.views) {
    s.size = lead.size;
    s.shape = lead.shape;
  }
  out.problem->share();
  return out;
}

/// Both hypotheses from where they are; the one of greater evidence.
void choose_hypothesis(SolvedTrack* fit) {
  const TrackProblem& problem = *fit->problem;
  // Along the viewing ray the valley is long and flat.
  constexpr int kIterations = 60;
  constexpr double kTolerance = 5e-4;
  const double moving_cost = problem.refine(&fit->moving, false, kIterations, kTolerance);
  if (problem.num_views() < 2) return;
  // Far from what a moving one explains, standing still need not be told exactly.
  constexpr double kHopeless = 60.0;
  double parked_cost = problem.refine(&fit->parked, true, 8, 0.01);
  if (parked_cost < moving_cost + kHopeless) {
    parked_cost = problem.refine(&fit->parked, true, kIterations, kTolerance);
  }
  fit->stands = parked_cost < moving_cost + kHopeless &&
                problem.evidence(fit->parked, true) < problem.evidence(fit->moving, false);
}

void solve_track(const VehiclePrior& prior, SolvedTrack* fit) {
  TrackProblem& problem = *fit->problem;
  problem.refine(&fit->moving, false, 10, 0.1);  // within a pixel or two, for the registration
  problem.register_views(prior, fit->lead, fit->moving);
  fit->parked = fit->moving;
  const SE3 stand =
      problem.world_from_vehicle(fit->lead, fit->moving.views[static_cast<std::size_t>(fit->lead)]);
  for (int k = 0; k < problem.num_views(); ++k) {
    problem.place(k, stand, &fit->parked.views[static_cast<std::size_t>(k)]);
  }
  choose_hypothesis(fit);
}

/// Leaves `out` as it is where the solution is not to be trusted.
void write_track(const PinholeCamera& camera, const std::vector<TrackFrame>& frames,
                 const VehiclePrior& prior, SolvedTrack& fit,
                 std::vector<std::vector<VehicleEstimate>>* out) {
  TrackProblem& problem = *fit.problem;
  TrackEquations equations;
  if (!std::isfinite(problem.evaluate(fit.answer(), fit.stands, &equations, /*observed=*/true))) {
    return;
  }
  const Eigen::MatrixXd& hessian = equations.hessian;
  const Eigen::LDLT<Eigen::MatrixXd> factors(hessian);
  if (factors.info() != Eigen::Success || !factors.isPositive()) return;
  const Eigen::MatrixXd covariance =
      factors.solve(Eigen::MatrixXd::Identity(hessian.rows(), hessian.cols()));
  // The answer is the maximum once the shape is integrated out.
  const TrackState states = problem.moved(
      fit.answer(), Eigen::VectorXd(-covariance * problem.shape_pull(fit.answer(), equations)));
  for (int k = 0; k < problem.num_views(); ++k) {
    const View& v = fit.views[static_cast<std::size_t>(k)];
    const State& s = states.views[static_cast<std::size_t>(k)];
    const TrackFrame& frame = frames[v.frame];
    VehicleEstimate answer = frame.estimates[v.detection];
    if (!distrust_of(problem.problem(k), s, camera, frame.detections[v.detection].box).empty())
      continue;
    write_answer(problem.problem(k), prior, s, problem.covariance(k, covariance), kInfinity,
                 &answer);
    if (problem.num_views() == 1 && answer.status == Status::kOk &&
        frame.estimates[v.detection].reason == kTwoHeadings) {
      answer.status = Status::kWeak;
      answer.reason = kTwoHeadings;
    }
    finish_answer(frame.supports[v.detection], &answer);
    if (answer.status != Status::kFailed) (*out)[v.frame][v.detection] = answer;
  }
}

/// First row of each detection's plane in a shared ground, [frame][detection].
std::vector<std::vector<Eigen::Index>> ground_rows(const std::vector<TrackFrame>& frames,
                                                   const Eigen::MatrixXd& covariance) {
  std::vector<std::vector<Eigen::Index>> out;
  Eigen::Index next = 0;
  for (const TrackFrame& f : frames) {
    out.emplace_back();
    for (std::size_t j = 0; j < f.supports.size(); ++j, next += 3) out.back().push_back(next);
  }
  if (covariance.rows() != next + 1 || covariance.cols() != next + 1) {
    throw std::invalid_argument(fmt::format("ground.covariance: {} x {}, must be {} square",
                                            covariance.rows(), covariance.cols(), next + 1));
  }
  return out;
}

/// One round of message passing: every vehicle's message, and what follows from those of the
/// others.
struct GroundRound {
  std::vector<GroundNode> nodes;     // one a fit
  std::vector<std::string> reasons;  // why a node has no message
  GroundPropagation result;
};

GroundRound pass_messages(const PinholeCamera& camera, const std::vector<TrackFrame>& frames,
                          const Eigen::MatrixXd& covariance,
                          const std::vector<std::vector<Eigen::Index>>& rows, int num_threads,
                          const std::vector<SolvedTrack>& fits) {
  GroundRound out;
  out.nodes.resize(fits.size());
  out.reasons.resize(fits.size());
  parallel_for(fits.size(), num_threads, [&](std::size_t i) {
    const SolvedTrack& fit = fits[i];
    GroundNode& node = out.nodes[i];
    std::string& reason = out.reasons[i];
    for (const View& v : fit.views) node.rows.push_back(rows[v.frame][v.detection]);
    node.lead = static_cast<std::size_t>(fit.lead);
    const View& lead = fit.views[node.lead];
    // What no road point shows is the smoothness prior's, which others have already.
    if (frames[lead.frame].supports[lead.detection].status == Status::kNotObservable) {
      reason = "the plane below it is not observable";
      return;
    }
    reason = distrust_of(fit.problem->problem(fit.lead), fit.answer().views[node.lead], camera,
                         frames[lead.frame].detections[lead.detection].box);
    if (!reason.empty()) return;
    node.message = fit.problem->message(fit.lead, fit.answer(), fit.stands);
    if (!node.message) reason = "its problem has no minimum";
  });
  out.result = propagate(covariance, out.nodes);
  return out;
}

/// Every vehicle is solved again with what the others' messages leave of its planes' prior.
void solve_with_cavities(const GroundRound& round, int num_threads,
                         std::vector<SolvedTrack>* fits) {
  parallel_for(fits->size(), num_threads, [&](std::size_t i) {
    SolvedTrack& fit = (*fits)[i];
    const GroundCavity& cavity = round.result.cavities[i];
    for (int k = 0; k < fit.problem->num_views(); ++k) {
      fit.problem->set_plane(k, cavity.mean.segment(3 * k, 3),
                             cavity.covariance.block(3 * k, 3 * k, 3, 3));
    }
    const Eigen::Index last = cavity.mean.size() - 1;
    fit.problem->set_scale(cavity.mean[last], cavity.covariance(last, last));
    choose_hypothesis(&fit);
  });
}

std::vector<TrackMessage> report_messages(const GroundRound& round,
                                          const std::vector<SolvedTrack>& fits) {
  std::vector<TrackMessage> out(fits.size());
  for (std::size_t i = 0; i < fits.size(); ++i) {
    const View& lead = fits[i].views[static_cast<std::size_t>(fits[i].lead)];
    out[i].lead = lead;
    out[i].views = fits[i].views;
    out[i].reason = round.reasons[i];
    if (!round.nodes[i].message) continue;
    out[i].message = *round.nodes[i].message;
    out[i].weight = round.result.weights[i];
    out[i].mahalanobis = std::sqrt(round.result.squared_distances[i]);
    out[i].accepted = out[i].weight >= 0.5;
    if (!out[i].accepted) {
      out[i].reason = fmt::format("{:.1f} standard deviations off the road and the other vehicles",
                                  out[i].mahalanobis);
    }
  }
  return out;
}

/// Numbers of tracks of more than one detection; given ones stay, the others come after them.
std::vector<std::vector<int>> report_tracks(const std::vector<TrackFrame>& frames,
                                            const std::vector<std::vector<int>>& numbers,
                                            const std::map<int, std::vector<View>>& tracks) {
  int next = 0;
  for (const TrackFrame& f : frames) {
    for (const VehicleDetection& d : f.detections) next = std::max(next, d.track + 1);
  }
  std::vector<std::vector<int>> out;
  for (const std::vector<int>& n : numbers) out.emplace_back(n.size(), -1);
  for (const auto& [number, views] : tracks) {
    (void)number;
    const int given = frames[views.front().frame].detections[views.front().detection].track;
    if (given < 0 && views.size() < 2) continue;
    const int reported = given < 0 ? next++ : given;
    for (const View& v : views) out[v.frame][v.detection] = reported;
  }
  return out;
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

TrackFit fit_tracks(const PinholeCamera& camera, const std::vector<TrackFrame>& frames,
                    const VehicleFitOptions& options, int num_threads, double scale_sigma,
                    const SharedGround* ground) {
  options.validate();
  if (!(scale_sigma > 0.0)) {
    throw std::invalid_argument(fmt::format("scale_sigma: {}, must be > 0", scale_sigma));
  }
  const std::vector<std::vector<int>> numbers = find_tracks(camera, frames);
  const bool shared = ground && ground->covariance.size() > 0;
  std::vector<std::vector<Eigen::Index>> rows;
  if (shared) rows = ground_rows(frames, ground->covariance);
  // One view alone has a message and takes those of others where the ground is shared.
  const std::size_t least_views = shared ? 1 : 2;
  std::map<int, std::vector<View>> tracks;
  TrackFit out;
  for (std::size_t t = 0; t < frames.size(); ++t) {
    out.estimates.push_back(frames[t].estimates);
    for (std::size_t j = 0; j < numbers[t].size(); ++j) tracks[numbers[t][j]].push_back({t, j});
  }
  std::vector<std::vector<View>> lists;
  for (auto& [number, views] : tracks) {
    (void)number;
    // A given track may name two detections of one frame: the first stands.
    views.erase(std::unique(views.begin(), views.end(),
                            [](const View& a, const View& b) { return a.frame == b.frame; }),
                views.end());
    if (views.size() >= least_views) lists.push_back(views);
  }
  out.tracks = report_tracks(frames, numbers, tracks);
  const VehiclePrior& prior = options.prior ? *options.prior : shipped_vehicle_prior();
  std::vector<std::optional<SolvedTrack>> started(lists.size());
  parallel_for(lists.size(), num_threads, [&](std::size_t i) {
    started[i] = start_track(camera, frames, lists[i], options, scale_sigma, least_views);
    if (started[i]) solve_track(prior, &*started[i]);
  });
  std::vector<SolvedTrack> fits;
  for (std::optional<SolvedTrack>& f : started) {
    if (f) fits.push_back(std::move(*f));
  }
  if (shared) {
    const auto round = [&] {
      return pass_messages(camera, frames, ground->covariance, rows, num_threads, fits);
    };
    for (int i = 0; i < kGroundRounds; ++i) solve_with_cavities(round(), num_threads, &fits);
    out.messages = report_messages(round(), fits);
    for (TrackMessage& m : out.messages) m.track = out.tracks[m.lead.frame][m.lead.detection];
  }
  parallel_for(fits.size(), num_threads,
               [&](std::size_t i) { write_track(camera, frames, prior, fits[i], &out.estimates); });
  return out;
}

}  // namespace camber
