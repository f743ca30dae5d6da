#pragma once

// Inside of the fits, not installed interface: the posterior of one vehicle in one image.

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "camber/vehicle/detail/ground_propagation.h"
#include "camber/vehicle/fit_vehicle.h"

namespace camber::internal {

constexpr double kPi = 3.14159265358979323846;
constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr int kMaxCoefficients = 20;
constexpr int kMaxParameters = 9 + kMaxCoefficients;
constexpr int kPoseParameters = 6;  // translation in the camera, rotation in the vehicle's frame
constexpr int kSizeParameters = 3;  // length, width, height
constexpr int kNumExtraPoints = 10;
constexpr int kNumBodyPoints = kNumKeypoints + kNumExtraPoints;

// Reasons of weak answers that more planes and views do not undo.
inline constexpr char kTwoHeadings[] = "two headings fit alike";
inline constexpr char kSidesSwapped[] = "the keypoints' left and right are swapped";

using Vector = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMaxParameters, 1>;
using Matrix =
    Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMaxParameters, kMaxParameters>;
using PointJacobian = Eigen::Matrix<double, 2, Eigen::Dynamic, 0, 2, kMaxParameters>;

// How far a body's outline is off the prior's points, as a share of the vehicle's height: 3 cm.
constexpr double kBodyEdgeShare = 0.02;

// Pixel errors in cells (share keypoint_sigma of the box), as a mixture: keypoints that the network
// saw, ones that it guessed, and gross errors anywhere in its crop.
struct NoiseModel {
  double seen = 1.05;        // cells, each axis
  double guessed = 2.6;      // cells; most hidden keypoints
  double guessed_far = 6.0;  // cells; the rest
  double gross_share = 0.05;
  double far_share = 0.30;              // of the guessed ones
  double gross_density = 1.0 / 4096.0;  // a cell: uniform over 64 x 64
};

struct State {
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();  // camera_from_vehicle
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();   // bottom centre
  Eigen::Vector3d size = Eigen::Vector3d::Ones();          // length, width, height
  Vector shape;                                            // coefficients
};

/// What the coefficients leave of a vehicle's keypoints, m in its frame at the prior's mean size.
using ShapeErrors = Eigen::Matrix<double, 3, kNumKeypoints>;

/// Normal equations of one keypoint's shape error: its own, and with the solved parameters.
struct ShapeErrorTerms {
  Eigen::Matrix3d own = Eigen::Matrix3d::Zero();
  Eigen::Vector3d gradient = Eigen::Vector3d::Zero();
  Eigen::Matrix<double, 3, Eigen::Dynamic, 0, 3, kMaxParameters> cross;
};

/// A point of the body as shares of the box, linear in the shape coefficients.
struct BodyPoint {
  Eigen::Vector3d mean;  // x / l, y / h, z / w
  Eigen::Matrix<double, 3, Eigen::Dynamic, 0, 3, kMaxCoefficients> basis;
};

/// One side of the detection box.
struct BoxEdge {
  int axis;     // 0: u, 1: v
  double sign;  // the body's largest sign * pixel coordinate makes this edge
  double pixel;
  double sigma;    // px
  bool at_border;  // cut by the image: the body may reach farther out
};

/// Everything that stays the same during one fit.
class SingleViewProblem {
 public:
  SingleViewProblem(const PinholeCamera& camera, const VehicleDetection& detection,
                    const SupportPlane& support, const VehicleFitOptions& options,
                    bool use_keypoints, int num_coefficients)
      : camera_(camera), support_(support), options_(options) {
    const VehiclePrior& prior = options.prior ? *options.prior : shipped_vehicle_prior();
    const ShapePrior& full = prior.shape(detection.vehicle_class);
    num_coefficients_ = std::min({num_coefficients, full.num_coefficients(), kMaxCoefficients});
    num_parameters_ = kPoseParameters + kSizeParameters + num_coefficients_;
    // Shape errors that no coefficient explains, of a keypoint, m, each axis.
    const Eigen::Matrix<double, 3, kNumSideKeypoints> left = full.residual_sigma(num_coefficients_);
    for (int i = 0; i < kNumKeypoints; ++i) {
      model_variance_[i] = left.col(i % kNumSideKeypoints).squaredNorm() / 3.0;
    }

    const int known = kSizeParameters + num_coefficients_;
    prior_mean_ = full.parameters_mean.head(known);
    Matrix covariance = full.parameters_covariance.topLeftCorner(known, known);
    if (!prior.has_shape(detection.vehicle_class)) {
      const SizePrior size = prior.size(detection.vehicle_class);
      prior_mean_.head<3>() = size.mean;
      covariance.setIdentity(known, known);
      covariance.topLeftCorner<3, 3>() = size.covariance;
    }
    prior_information_ = covariance.llt().solve(Matrix::Identity(known, known));

    make_body(full, prior.has_shape(detection.vehicle_class));
    make_box(detection.box);
    cell_u_ = std::max(detection.box.width() * options.keypoint_sigma, 0.2);
    cell_v_ = std::max(detection.box.height() * options.keypoint_sigma, 0.2);
    noise_.gross_density = options.keypoint_sigma * options.keypoint_sigma;
    if (use_keypoints) read_keypoints(detection);
  }

  /// Makes this one of `count` views of the same vehicle: what all views share (prior, plane, body
  /// edges) counts once over all of them. What the coefficients leave of the shape is then given to
  /// evaluate().
  void share_among(int count) {
    shared_weight_ = 1.0 / count;
    // The body's own edges are off the prior's points by the same in all views.
    const double body = kBodyEdgeShare * body_height_px_;
    for (BoxEdge& e : edges_) e.sigma = std::sqrt(e.sigma * e.sigma + (count - 1) * body * body);
    prior_information_ *= shared_weight_;
  }

  int num_coefficients() const { return num_coefficients_; }
  int num_keypoints() const { return static_cast<int>(used_.size()); }
  const std::vector<int>& used_keypoints() const { return used_; }
  const Vector& prior_mean() const { return prior_mean_; }
  double cell_u() const { return cell_u_; }
  double cell_v() const { return cell_v_; }

  State mean_state() const {
    State s;
    s.size = prior_mean_.head<3>();
    s.shape = Vector::Zero(num_coefficients_);
    return s;
  }

  Eigen::Vector3d point_in_vehicle(const BodyPoint& point, const State& s) const {
    Eigen::Vector3d share = point.mean;
    if (num_coefficients_ > 0) share += point.basis * s.shape;
    return {s.size[0] * share.x(), s.size[2] * share.y(), s.size[1] * share.z()};
  }

  /// Pixel of a body point; false if it is not in front of the camera.
  bool project(const BodyPoint& point, const State& s, Eigen::Vector2d* pixel) const {
    const Eigen::Vector3d x = s.rotation * point_in_vehicle(point, s) + s.translation;
    if (!(x.z() > 0.3)) return false;
    *pixel = {camera_.fx * x.x() / x.z() + camera_.cx, camera_.fy * x.y() / x.z() + camera_.cy};
    return true;
  }

  /// d pixel / d parameters of a body point in front of the camera.
  void point_jacobian(const BodyPoint& point, const State& s, PointJacobian* jacobian) const {
    Eigen::Vector3d share = point.mean;
    if (num_coefficients_ > 0) share += point.basis * s.shape;
    const Eigen::Vector3d size(s.size[0], s.size[2], s.size[1]);
    const Eigen::Vector3d p = size.cwiseProduct(share);
    const Eigen::Vector3d x = s.rotation * p + s.translation;
    const double iz = 1.0 / x.z();
    Eigen::Matrix<double, 2, 3> to_pixel;
    to_pixel << camera_.fx * iz, 0.0, -camera_.fx * x.x() * iz * iz, 0.0, camera_.fy * iz,
        -camera_.fy * x.y() * iz * iz;
    const Eigen::Matrix<double, 2, 3> turned = to_pixel * s.rotation;
    jacobian->resize(2, num_parameters_);
    jacobian->leftCols<3>() = to_pixel;
    // R exp(w) p: d / dw = -R [p]x.
    jacobian->col(3) = turned.col(2) * p.y() - turned.col(1) * p.z();
    jacobian->col(4) = turned.col(0) * p.z() - turned.col(2) * p.x();
    jacobian->col(5) = turned.col(1) * p.x() - turned.col(0) * p.y();
    jacobian->col(6) = turned.col(0) * share.x();
    jacobian->col(7) = turned.col(2) * share.z();
    jacobian->col(8) = turned.col(1) * share.y();
    for (int k = 0; k < num_coefficients_; ++k) {
      jacobian->col(9 + k) = turned * size.cwiseProduct(point.basis.col(k));
    }
  }

  /// Share of keypoints that the network is expected to have seen, from the side that the car
  /// shows at this state (and from the confidences once they are trusted), and how large shape
  /// errors look. These stay as they are while a state is refined: were the spread of a keypoint to
  /// follow the state, its normaliser would pull towards small, far vehicles, the more so the more
  /// views share the errors.
  void update_visibility(const State& s) {
    // Shape errors grow with the vehicle: a larger one farther away looks the same.
    const double size = s.size.sum() / prior_mean_.head<3>().sum();
    const Eigen::Vector3d ray = s.translation / s.translation.z();
    const double scale_u = size * camera_.fx / (s.translation.z() * cell_u_);
    const double scale_v = size * camera_.fy / (s.translation.z() * cell_v_);
    shape_error_scale_ = scale_u * scale_v;
    cells_by_shape_error_.row(0) = scale_u * (s.rotation.row(0) - ray.x() * s.rotation.row(2));
    cells_by_shape_error_.row(1) = scale_v * (s.rotation.row(1) - ray.y() * s.rotation.row(2));
    const Eigen::Vector3d eye = s.rotation.transpose() * -s.translation;  // vehicle frame
    for (std::size_t j = 0; j < used_.size(); ++j) {
      const int i = used_[j];
      const int row = i % kNumSideKeypoints;
      const Eigen::Vector3d p = point_in_vehicle(body_[i], s);
      const double side = i < kNumSideKeypoints ? -1.0 : 1.0;
      bool shown = side * (eye.z() - p.z()) > 0.0;
      // Corners are seen from their end of the car as well; roof corners from above.
      if (row >= 10 && row <= 12) shown |= eye.x() < p.x();
      if (row >= 15) shown |= eye.x() > p.x();
      if (row == 13) shown |= eye.x() < p.x() || eye.y() > p.y();
      if (row == 14) shown |= eye.x() > p.x() || eye.y() > p.y();
      double share = shown ? 0.80 : 0.12;
      if (use_confidence_) {
        const double odds = share / (1.0 - share) * std::exp(8.0 * (rank_[j] - 0.5));
        share = odds / (1.0 + odds);
      }
      seen_share_[j] = share;
    }
  }

  /// Log density of a keypoint's error and its weight in a least-squares step (1 / cells^2).
  /// @param along  the share of the weight that holds along the residual's own direction, where it
  ///               matters that its component is not known: 1 - Var(precision) r^2 / E(precision),
  ///               not below 0.
  double log_density(double squared, double seen_share, double model_variance, double* weight,
                     double* kept, double* along = nullptr) const {
    const NoiseModel& n = noise_;
    const double good = 1.0 - n.gross_share;
    const double shares[3] = {good * seen_share, good * (1.0 - seen_share) * (1.0 - n.far_share),
                              good * (1.0 - seen_share) * n.far_share};
    const double sigmas[3] = {n.seen * noise_scale_, n.guessed, n.guessed_far};
    double total = n.gross_share * n.gross_density, weighted = 0.0, near = 0.0, twice = 0.0;
    for (int c = 0; c < 3; ++c) {
      const double variance = sigmas[c] * sigmas[c] + model_variance;
      const double density =
          shares[c] * std::exp(-0.5 * squared / variance) / (2.0 * kPi * variance);
      total += density;
      weighted += density / variance;
      twice += density / (variance * variance);
      if (c < 2) near += density;
    }
    if (weight) *weight = weighted / total;
    if (kept) *kept = near / total;
    if (along) {
      const double mean = weighted / total;
      *along = std::max(1.0 - (twice / total - mean * mean) * squared / mean, 0.0);
    }
    return std::log(total);
  }

  /// Standard deviation of a keypoint's shape error, m, each axis.
  double shape_error_sigma(int keypoint) const { return std::sqrt(model_variance_[keypoint]); }

  /// Variance of keypoint j's pixel from its shape error, cells^2.
  double model_variance(std::size_t j) const {
    return model_variance_[used_[j]] * shape_error_scale_;
  }

  /// Minus log posterior; optionally with the normal equations of a Gauss-Newton step (a weighted
  /// least-squares step for the mixture).
  /// @param observed  the keypoints' own second derivatives in place of the step's, which takes
  /// their
  ///                  components for known and so is a little too sure.
  /// @param errors  what the coefficients leave of the shape, if it is solved for too: its terms
  ///                (without prior) go to *error_terms, of the keypoints that have a pixel. Without
  ///                it, it is integrated out.
  double evaluate(const State& s, Matrix* hessian, Vector* gradient, bool observed = false,
                  const ShapeErrors* errors = nullptr,
                  std::array<ShapeErrorTerms, kNumKeypoints>* error_terms = nullptr) const {
    double cost = 0.0;
    if (hessian) {
      hessian->setZero(num_parameters_, num_parameters_);
      gradient->setZero(num_parameters_);
    }
    if (!add_keypoints(s, &cost, hessian, gradient, observed, errors, error_terms)) {
      return kInfinity;
    }
    if (!add_box(s, &cost, hessian, gradient)) return kInfinity;
    add_plane(s, &cost, hessian, gradient);
    add_prior(s, &cost, hessian, gradient);
    return cost;
  }

  State moved(const State& s, const Vector& step) const {
    State out = s;
    out.translation += step.segment<3>(0);
    out.rotation = s.rotation * rotation_from_vector(step.segment<3>(3)).toRotationMatrix();
    out.size += step.segment<3>(6);
    for (int i = 0; i < 3; ++i) out.size[i] = std::max(out.size[i], 0.3 * prior_mean_[i]);
    if (num_coefficients_ > 0) out.shape += step.tail(num_coefficients_);
    return out;
  }

  /// Levenberg-Marquardt on the minus log posterior. @return final cost.
  double refine(State* state, int max_iterations, double tolerance) const {
    Matrix hessian;
    Vector gradient;
    double cost = evaluate(*state, &hessian, &gradient);
    double lambda = 1e-3;
    for (int iteration = 0; iteration < max_iterations && std::isfinite(cost); ++iteration) {
      Matrix damped = hessian;
      damped.diagonal() *= 1.0 + lambda;
      Vector step = -damped.ldlt().solve(gradient);
      // A turn of more than 0.3 rad leaves the range of the linear model.
      const double turn = step.segment<3>(3).norm();
      if (turn > 0.3) step *= 0.3 / turn;
      const State candidate = moved(*state, step);
      const double next = evaluate(candidate, nullptr, nullptr);
      if (next < cost) {
        const double gain = cost - next;
        *state = candidate;
        cost = next;
        lambda = std::max(lambda * 0.2, 1e-8);
        if (gain < tolerance) break;
        evaluate(*state, &hessian, &gradient);
      } else {
        lambda *= 8.0;
        if (lambda > 1e8) break;
      }
    }
    return cost;
  }

  /// Gradient, by pose and size, of half the log determinant of the coefficients' information: what
  /// integrating them out adds to the gradient of the minus log posterior. The coefficients are
  /// shares of the size, so each that the keypoints measure is known to depth over size: at the
  /// joint maximum of pose and shape a vehicle is too near and too large.
  /// @param covariance      of the coefficients, pose and size held.
  /// @param errors          as in evaluate().
  /// @param errors_by_shape  how the errors follow the coefficients, rows as errors.reshaped().
  Eigen::Matrix<double, kPoseParameters + kSizeParameters, 1> shape_pull(
      const State& s, const Eigen::Ref<const Eigen::MatrixXd>& covariance,
      const ShapeErrors* errors = nullptr,
      const Eigen::Ref<const Eigen::MatrixXd>& errors_by_shape = Eigen::MatrixXd()) const {
    constexpr int kOthers = kPoseParameters + kSizeParameters;
    using ByShape = Eigen::Matrix<double, 2, Eigen::Dynamic, 0, 2, kMaxCoefficients>;
    Eigen::Matrix<double, kOthers, 1> pull = Eigen::Matrix<double, kOthers, 1>::Zero();
    if (num_coefficients_ == 0) return pull;
    struct Term {
      const BodyPoint* point;
      ByShape weight;  // of the point's derivatives by the coefficients, weights held
    };
    std::vector<Term> terms;
    PointJacobian jacobian;
    for (std::size_t j = 0; j < used_.size(); ++j) {
      const BodyPoint& point = body_[used_[j]];
      Eigen::Vector2d pixel;
      if (!project(point, s, &pixel)) return pull;
      Eigen::Vector2d off = error(j, pixel);
      if (errors) off += cells_by_shape_error_ * errors->col(used_[j]);
      double weight = 0.0;
      log_density(off.squaredNorm(), seen_share_[j], errors ? 0.0 : model_variance(j), &weight,
                  nullptr);
      point_jacobian(point, s, &jacobian);
      ByShape by_shape = jacobian.rightCols(num_coefficients_);
      by_shape.row(0) /= cell_u_;
      by_shape.row(1) /= cell_v_;
      if (errors) by_shape -= cells_by_shape_error_ * errors_by_shape.middleRows<3>(3 * used_[j]);
      by_shape = (weight * by_shape * covariance).eval();
      by_shape.row(0) /= cell_u_;
      by_shape.row(1) /= cell_v_;
      terms.push_back({&point, by_shape});
    }
    std::array<BoxRow, 4> rows;
    const int count = box_rows(s, &rows);
    for (int i = 0; i < count; ++i) {
      const BoxEdge& edge = edges_[rows[i].edge];
      const BodyPoint& point = body_[rows[i].point];
      point_jacobian(point, s, &jacobian);
      ByShape by_shape = ByShape::Zero(2, num_coefficients_);
      by_shape.row(edge.axis) = rows[i].weight / (edge.sigma * edge.sigma) *
                                jacobian.row(edge.axis).tail(num_coefficients_) * covariance;
      terms.push_back({&point, by_shape});
    }
    const auto sum = [&](int parameter, double step) {
      Vector change = Vector::Zero(num_parameters_);
      change[parameter] = step;
      const State at = moved(s, change);
      double out = 0.0;
      for (const Term& t : terms) {
        point_jacobian(*t.point, at, &jacobian);
        out += t.weight.cwiseProduct(jacobian.rightCols(num_coefficients_)).sum();
      }
      return out;
    };
    for (int i = 0; i < kOthers; ++i) {
      const double step = i < 3 ? 1e-4 * s.translation.norm() : 1e-4;
      pull[i] = (sum(i, step) - sum(i, -step)) / (2.0 * step);
    }
    return pull;
  }

  /// Start poses of one heading: the linear problem in the position, twice reweighted, from two
  /// guesses. @return cost of the better one (minus log posterior with the mean vehicle).
  double start_at(double yaw, const std::vector<Eigen::Vector3d>& guesses, State* best) {
    double best_cost = kInfinity;
    for (const Eigen::Vector3d& guess : guesses) {
      State s = mean_state();
      s.rotation = rotation_at(yaw);
      s.translation = guess;
      update_visibility(s);
      std::array<Eigen::Vector3d, kNumKeypoints> offset;
      for (std::size_t j = 0; j < used_.size(); ++j) {
        offset[j] = s.rotation * point_in_vehicle(body_[used_[j]], s);
      }
      for (int iteration = 0; iteration < 4; ++iteration) {
        // Robust scale in cells, shrinking: a wrong start must still feel all keypoints.
        const double scale = iteration == 0 ? 24.0 : (iteration == 1 ? 12.0 : 5.0);
        Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
        Eigen::Vector3d right = Eigen::Vector3d::Zero();
        for (std::size_t j = 0; j < used_.size(); ++j) {
          const Eigen::Vector3d x = offset[j] + s.translation;
          const double z = std::max(x.z(), 1.0);
          const Eigen::Vector3d& ray = rays_[j];
          const Eigen::Vector3d row_u(1.0, 0.0, -ray.x()), row_v(0.0, 1.0, -ray.y());
          const double ku = camera_.fx / (z * cell_u_), kv = camera_.fy / (z * cell_v_);
          const double ru = ku * row_u.dot(x), rv = kv * row_v.dot(x);
          const double weight =
              1.0 / (1.0 + (ru * ru + rv * rv) / (scale * scale)) * (0.3 + seen_share_[j]);
          normal +=
              weight * (ku * ku * row_u * row_u.transpose() + kv * kv * row_v * row_v.transpose());
          right -= weight * (ku * ku * row_u * row_u.dot(offset[j]) +
                             kv * kv * row_v * row_v.dot(offset[j]));
        }
        const Plane& plane = support_.plane.plane;
        const double variance = support_.plane.height_variance(s.translation) +
                                std::pow(options_.stance_sigma_height, 2) + 0.05 * 0.05;
        normal += plane.normal * plane.normal.transpose() / variance;
        right -= plane.normal * plane.offset / variance;
        const Eigen::Vector3d solved = normal.ldlt().solve(right);
        if (!solved.allFinite() || solved.z() < 1.0) break;
        s.translation = solved;
      }
      const double cost = evaluate(s, nullptr, nullptr);
      if (cost < best_cost) {
        best_cost = cost;
        *best = s;
      }
    }
    return best_cost;
  }

  /// The rotation of a vehicle standing on the plane, its front turned by `yaw` about the normal.
  Eigen::Matrix3d rotation_at(double yaw) const {
    const Eigen::Vector3d n = support_.plane.plane.normal;
    Eigen::Vector3d ahead(0.0, 0.0, 1.0), right;
    ahead -= ahead.dot(n) * n;
    if (ahead.norm() < 1e-3) ahead = Eigen::Vector3d(1.0, 0.0, 0.0) - n.x() * n;
    ahead.normalize();
    right = ahead.cross(n);
    Eigen::Matrix3d r;
    r.col(0) = std::cos(yaw) * ahead + std::sin(yaw) * right;
    r.col(1) = n;
    r.col(2) = r.col(0).cross(n);
    return r;
  }

  /// Where the vehicle may stand: on the plane below the box, and as far as its size says.
  std::vector<Eigen::Vector3d> position_guesses(const Box2& box) const {
    std::vector<Eigen::Vector3d> out;
    const Plane& plane = support_.plane.plane;
    const double height = prior_mean_[2];
    const double by_size =
        std::clamp(camera_.fy * height / std::max(box.height(), 1.0), 2.0, 300.0);
    const Eigen::Vector3d bottom_ray = camera_.ray({box.center().x(), box.y2});
    const Eigen::Vector3d sized = by_size * bottom_ray;
    out.push_back(sized);
    // Halfway up the box the vehicle is at half its height above the plane.
    Plane raised = plane;
    raised.offset -= 0.5 * height;
    if (const auto hit = raised.intersect_ray(camera_.ray(box.center()))) {
      if (hit->z() > 1.0 && hit->z() < 300.0) {
        out.push_back(*hit - 0.5 * height * plane.normal);
      }
    }
    return out;
  }

  /// Looks whether the confidences tell which keypoints are good: keeps them if the posterior of
  /// the residuals is clearly better with them.
  void decide_on_confidence(const State& s) {
    if (rank_.empty()) return;
    use_confidence_ = false;
    update_visibility(s);
    double without = 0.0, with = 0.0;
    if (!add_keypoints(s, &without, nullptr, nullptr)) return;
    use_confidence_ = true;
    update_visibility(s);
    add_keypoints(s, &with, nullptr, nullptr);
    if (!(with < without - 3.0)) {
      use_confidence_ = false;
      update_visibility(s);
    }
  }

  /// Widens the noise of seen keypoints to what the residuals show (a weak prior on 1).
  void adapt_noise(const State& s) {
    constexpr double kPriorCount = 16.0;
    double sum = kPriorCount, count = kPriorCount;
    PointJacobian unused;
    for (std::size_t j = 0; j < used_.size(); ++j) {
      Eigen::Vector2d pixel;
      if (!project(body_[used_[j]], s, &pixel)) return;
      const double squared = error(j, pixel).squaredNorm();
      const double model = model_variance(j);
      const double seen = noise_.seen * noise_scale_;
      double weight = 0.0;
      log_density(squared, seen_share_[j], model, &weight, nullptr);
      // Share of this keypoint in the seen component.
      const double variance = seen * seen + model;
      const double density = (1.0 - noise_.gross_share) * seen_share_[j] *
                             std::exp(-0.5 * squared / variance) / (2.0 * kPi * variance);
      const double total = std::exp(log_density(squared, seen_share_[j], model, nullptr, nullptr));
      const double share = density / total;
      sum += share * std::max(squared - 2.0 * model, 0.0) / (noise_.seen * noise_.seen);
      count += 2.0 * share;
    }
    noise_scale_ = std::clamp(std::sqrt(sum / count), 0.8, 2.2);
  }

  /// Visibility, use of the confidences and noise as a state shows them.
  void prepare(const State& s) {
    update_visibility(s);
    decide_on_confidence(s);
    adapt_noise(s);
    update_visibility(s);
  }

  /// A keypoint with what is known about its error.
  struct Seen {
    const BodyPoint* point;
    Eigen::Vector2d pixel;
    bool seen;                 // likelier seen by the network than guessed
    Eigen::Vector2d sigma_px;  // u, v; with what the coefficients leave of the shape
  };
  std::vector<Seen> keypoints(const State& s) const {
    std::vector<Seen> out;
    for (std::size_t j = 0; j < used_.size(); ++j) {
      Eigen::Vector2d pixel;
      if (!project(body_[used_[j]], s, &pixel)) continue;
      const bool seen = seen_share_[j] > 0.5;
      const double cells =
          seen ? noise_.seen * noise_scale_ : 0.5 * (noise_.guessed + noise_.guessed_far);
      const double sigma = std::sqrt(cells * cells + model_variance(j));
      out.push_back({&body_[used_[j]], pixels_[j], seen, {sigma * cell_u_, sigma * cell_v_}});
    }
    return out;
  }

  /// What the keypoints say about the fit.
  struct Agreement {
    double kept = 0.0;  // expected number of keypoints that are not far off
    double rmse_px = std::numeric_limits<double>::quiet_NaN();  // over the kept ones
  };
  Agreement agreement(const State& s) const {
    Agreement out;
    double sum = 0.0;
    for (std::size_t j = 0; j < used_.size(); ++j) {
      Eigen::Vector2d pixel;
      if (!project(body_[used_[j]], s, &pixel)) continue;
      double kept = 0.0;
      log_density(error(j, pixel).squaredNorm(), seen_share_[j], model_variance(j), nullptr, &kept);
      out.kept += kept;
      sum += kept * (pixel - pixels_[j]).squaredNorm();
    }
    if (out.kept > 0.5) out.rmse_px = std::sqrt(sum / out.kept);
    return out;
  }

  /// The body's box in the image; false if part of it is behind the camera.
  bool predicted_box(const State& s, Box2* box) const {
    *box = {kInfinity, kInfinity, -kInfinity, -kInfinity};
    for (const BodyPoint& point : body_) {
      Eigen::Vector2d pixel;
      if (!project(point, s, &pixel)) return false;
      box->x1 = std::min(box->x1, pixel.x());
      box->y1 = std::min(box->y1, pixel.y());
      box->x2 = std::max(box->x2, pixel.x());
      box->y2 = std::max(box->y2, pixel.y());
    }
    return true;
  }

  /// The plane's part of the normal equations alone.
  void plane_terms(const State& s, Matrix* hessian, Vector* gradient) const {
    hessian->setZero(num_parameters_, num_parameters_);
    gradient->setZero(num_parameters_);
    double cost = 0.0;
    add_plane(s, &cost, hessian, gradient);
  }

  /// How the vehicle stands on its plane.
  StanceTerms stance_terms(const State& s) const {
    StanceTerms out;
    Eigen::Matrix3d unused;
    stance(s, &out.value, &unused);
    out.by_pose = stance_jacobian(s).leftCols<6>();
    out.by_plane.setIdentity();
    out.by_plane.row(2) = support_.plane.height_jacobian(s.translation);
    const double tilt = std::pow(options_.stance_sigma_tilt, 2);
    out.variance = {tilt, tilt, std::pow(options_.stance_sigma_height, 2)};
    return out;
  }

  /// Squared Mahalanobis distance of the stance from the plane.
  double plane_mahalanobis(const State& s) const {
    Eigen::Vector3d e;
    Eigen::Matrix3d information;
    stance(s, &e, &information);
    return e.dot(information * e);
  }

  /// The ground as the vehicle that stands on it shows it too: posterior mean of the plane, and the
  /// standard deviation of its height at the vehicle, from the posterior covariance of the solved
  /// parameters. The ego plane and a level one, which other vehicles stand on too, stay.
  /// @param place  covariance of the vehicle's centre, m^2: where it truly stands.
  Plane posterior_plane(const State& s, const Matrix& covariance, const Eigen::Matrix3d& place,
                        double* sigma_height) const {
    const UncertainPlane& known = support_.plane;
    if (support_.source == "ego" || support_.source == "level") {
      *sigma_height = std::sqrt(std::max(known.height_variance(s.translation), 0.0));
      return known.plane;
    }
    Eigen::Vector3d e;
    Eigen::Matrix3d information;
    stance(s, &e, &information);
    const double doubt = options_.trust_plane ? 1.0 : 1.0 + e.dot(information * e) / kPlaneScale;
    Eigen::Matrix3d m = Eigen::Matrix3d::Identity();
    m.row(2) = known.height_jacobian(s.translation);
    Eigen::Matrix3d noise = Eigen::Matrix3d::Zero();
    noise(0, 0) = noise(1, 1) = std::pow(options_.stance_sigma_tilt, 2);
    noise(2, 2) = std::pow(options_.stance_sigma_height, 2);
    const Eigen::Matrix3d prior = doubt * known.covariance;
    const Eigen::Matrix3d gain =
        prior * m.transpose() * (m * prior * m.transpose() + noise).inverse();
    const auto jacobian = stance_jacobian(s);
    const Eigen::Matrix3d spread =
        prior - gain * m * prior +
        gain * (jacobian * covariance * jacobian.transpose()) * gain.transpose();
    // The vehicle may stand elsewhere on the plane, whose tilt then counts.
    Eigen::Matrix<double, 2, 3> arm;
    arm.row(0) = known.axis2.transpose();
    arm.row(1) = -known.axis1.transpose();
    const double elsewhere =
        spread.topLeftCorner<2, 2>().cwiseProduct(arm * place * arm.transpose()).sum();
    *sigma_height =
        std::sqrt(std::max((m.row(2) * spread).dot(m.row(2)), 0.0) + std::max(elsewhere, 0.0));
    return known.perturbed(gain * e);
  }

 private:
  using StanceJacobian = Eigen::Matrix<double, 3, Eigen::Dynamic, 0, 3, kMaxParameters>;
  // Cauchy beyond 4 sigma: a plane may be plainly wrong.
  static constexpr double kPlaneScale = 16.0;

  /// @param car_like  false: the vehicle fills its box (trucks, buses).
  void make_body(const ShapePrior& prior, bool car_like) {
    const int count = num_coefficients_;
    auto keypoint = [&](int i) {
      BodyPoint out;
      const int row = i % kNumSideKeypoints;
      const double side = i < kNumSideKeypoints ? 1.0 : -1.0;
      const Eigen::Vector3d mirror(1.0, 1.0, side);
      out.mean = mirror.cwiseProduct(prior.mean.col(row));
      out.basis.resize(3, count);
      for (int k = 0; k < count; ++k) {
        out.basis.col(k) = mirror.cwiseProduct(prior.basis[k].col(row));
      }
      return out;
    };
    for (int i = 0; i < kNumKeypoints; ++i) body_[i] = keypoint(i);
    int next = kNumKeypoints;
    auto fixed = [&](double x, double y, double z) {
      BodyPoint p;
      p.mean = {x, y, z};
      p.basis.setZero(3, count);
      body_[next++] = p;
    };
    if (!car_like) {
      for (int i = 0; i < 8; ++i) fixed((i & 1) - 0.5, (i >> 1) & 1, (i >> 2) - 0.5);
      while (next < kNumBodyPoints) fixed(0.0, 0.5, 0.0);
      return;
    }
    for (int i : {0, 1, 18, 19}) {  // where the tyres touch the ground
      BodyPoint p = body_[i];
      p.mean.y() = 0.0;
      p.basis.row(1).setZero();
      body_[next++] = p;
    }
    fixed(0.5, 0.33, 0.0);  // bumpers' foremost and rearmost points
    fixed(-0.5, 0.33, 0.0);
    fixed(-0.05, 1.0, 0.0);  // roof
    fixed(-0.20, 0.99, 0.0);
    fixed(0.0, 0.45, 0.5);  // widest points of the doors
    fixed(0.0, 0.45, -0.5);
  }

  void make_box(const Box2& box) {
    body_height_px_ = box.height();
    const double body = kBodyEdgeShare * body_height_px_;
    const double su = std::sqrt(std::pow(options_.box_sigma * box.width(), 2) + 1.0 + body * body);
    const double sv = std::sqrt(std::pow(options_.box_sigma * box.height(), 2) + 1.0 + body * body);
    constexpr double kBorder = 3.0;  // px
    edges_[0] = {0, -1.0, box.x1, su, box.x1 <= kBorder};
    edges_[1] = {0, 1.0, box.x2, su, box.x2 >= camera_.width - 1 - kBorder};
    edges_[2] = {1, -1.0, box.y1, sv, box.y1 <= kBorder};
    edges_[3] = {1, 1.0, box.y2, sv, box.y2 >= camera_.height - 1 - kBorder};
  }

  void read_keypoints(const VehicleDetection& detection) {
    constexpr bool kInSmallSet[kNumSideKeypoints] = {true,  true,  false, false, false, false,
                                                     false, false, false, false, false, true,
                                                     false, true,  true,  true,  true,  false};
    bool all_confident = true;
    std::vector<double> confidence;
    for (int i = 0; i < kNumKeypoints; ++i) {
      const KeypointObservation& k = detection.keypoints[i];
      if (!k.pixel.allFinite()) continue;
      if (options_.keypoint_set == 14 && !kInSmallSet[i % kNumSideKeypoints]) continue;
      used_.push_back(i);
      pixels_.push_back(k.pixel);
      rays_.push_back(camera_.ray(k.pixel));
      confidence.push_back(k.confidence);
      all_confident &= std::isfinite(k.confidence);
    }
    seen_share_.assign(used_.size(), 0.5);
    if (!all_confident || used_.size() < 8) return;
    // Ranks, shared among equals: any monotone scale serves.
    const double count = static_cast<double>(used_.size());
    rank_.resize(used_.size());
    for (std::size_t j = 0; j < used_.size(); ++j) {
      double below = 0.0;
      for (double other : confidence) {
        below += other < confidence[j] ? 1.0 : (other == confidence[j] ? 0.5 : 0.0);
      }
      rank_[j] = below / count;
    }
  }

  /// cells
  Eigen::Vector2d error(std::size_t j, const Eigen::Vector2d& pixel) const {
    return {(pixel.x() - pixels_[j].x()) / cell_u_, (pixel.y() - pixels_[j].y()) / cell_v_};
  }

  bool add_keypoints(const State& s, double* cost, Matrix* hessian, Vector* gradient,
                     bool observed = false, const ShapeErrors* errors = nullptr,
                     std::array<ShapeErrorTerms, kNumKeypoints>* error_terms = nullptr) const {
    // Rows are weighted and stacked, then multiplied at once.
    Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMaxParameters, 2 * kNumKeypoints>
        rows;
    Eigen::Matrix<double, Eigen::Dynamic, 1, 0, 2 * kNumKeypoints, 1> residuals;
    const int count = static_cast<int>(used_.size());
    if (hessian) {
      rows.resize(num_parameters_, 2 * count);
      residuals.resize(2 * count);
    }
    PointJacobian jacobian;
    for (int j = 0; j < count; ++j) {
      const BodyPoint& point = body_[used_[j]];
      Eigen::Vector2d pixel;
      if (!project(point, s, &pixel)) return false;
      Eigen::Vector2d off = error(static_cast<std::size_t>(j), pixel);
      if (errors) off += cells_by_shape_error_ * errors->col(used_[j]);
      double weight = 0.0, along = 1.0;
      const double squared = off.squaredNorm();
      *cost -= log_density(squared, seen_share_[j], errors ? 0.0 : model_variance(j), &weight,
                           nullptr, observed ? &along : nullptr);
      if (!hessian) continue;
      point_jacobian(point, s, &jacobian);
      jacobian.row(0) /= cell_u_;
      jacobian.row(1) /= cell_v_;
      const double root = std::sqrt(weight);
      rows.middleCols<2>(2 * j) = root * jacobian.transpose();
      residuals.segment<2>(2 * j) = root * off;
      const double less = along < 1.0 ? (1.0 - along) * weight / squared : 0.0;
      if (less > 0.0) {
        const Vector row = jacobian.transpose() * off;
        hessian->noalias() -= less * row * row.transpose();
      }
      if (error_terms) {
        ShapeErrorTerms& terms = (*error_terms)[static_cast<std::size_t>(used_[j])];
        const Eigen::Matrix2d information =
            weight * Eigen::Matrix2d::Identity() - less * off * off.transpose();
        const Eigen::Matrix<double, 3, 2> pulled = cells_by_shape_error_.transpose() * information;
        terms.own = pulled * cells_by_shape_error_;
        terms.gradient = weight * cells_by_shape_error_.transpose() * off;
        terms.cross = pulled * jacobian;
      }
    }
    if (hessian && count > 0) {
      hessian->noalias() += rows * rows.transpose();
      gradient->noalias() += rows * residuals;
    }
    return true;
  }

  /// A side of the box and the point of the body that makes it.
  struct BoxRow {
    int point = 0, edge = 0;
    double beyond = 0.0;  // sigmas, outwards
    double weight = 0.0;
  };
  // Cauchy beyond 3 sigma: boxes of hidden vehicles may be far off.
  static constexpr double kBoxScale = 9.0;

  /// @return how many; -1 if part of the body is behind the camera.
  int box_rows(const State& s, std::array<BoxRow, 4>* rows) const {
    std::array<double, 4> extreme;
    extreme.fill(-kInfinity);
    std::array<int, 4> point_of{};
    for (int i = 0; i < kNumBodyPoints; ++i) {
      Eigen::Vector2d pixel;
      if (!project(body_[i], s, &pixel)) return -1;
      for (int e = 0; e < 4; ++e) {
        const double value = edges_[e].sign * pixel[edges_[e].axis];
        if (value > extreme[e]) {
          extreme[e] = value;
          point_of[e] = i;
        }
      }
    }
    int count = 0;
    for (int e = 0; e < 4; ++e) {
      const BoxEdge& edge = edges_[e];
      const double beyond = extreme[e] - edge.sign * edge.pixel;  // px, outwards
      if (edge.at_border && beyond >= 0.0) continue;
      const double r = beyond / edge.sigma;
      (*rows)[count++] = {point_of[e], e, r, 1.0 / (1.0 + r * r / kBoxScale)};
    }
    return count;
  }

  bool add_box(const State& s, double* cost, Matrix* hessian, Vector* gradient) const {
    std::array<BoxRow, 4> rows;
    const int count = box_rows(s, &rows);
    if (count < 0) return false;
    PointJacobian jacobian;
    for (int i = 0; i < count; ++i) {
      const BoxRow& r = rows[i];
      const BoxEdge& edge = edges_[r.edge];
      *cost += 0.5 * kBoxScale * std::log1p(r.beyond * r.beyond / kBoxScale);
      if (!hessian) continue;
      point_jacobian(body_[r.point], s, &jacobian);
      const Vector row = (edge.sign / edge.sigma) * jacobian.row(edge.axis).transpose();
      hessian->noalias() += r.weight * row * row.transpose();
      gradient->noalias() += r.weight * r.beyond * row;
    }
    return true;
  }

  /// Tilts of the vehicle's up axis and height of its bottom centre against the plane, with their
  /// information: e = M theta + stance for a plane error theta (tilt, tilt, height).
  void stance(const State& s, Eigen::Vector3d* e, Eigen::Matrix3d* information) const {
    const UncertainPlane& plane = support_.plane;
    const Eigen::Vector3d up = s.rotation.col(1);
    *e = {-plane.axis2.dot(up), plane.axis1.dot(up), plane.plane.signed_distance(s.translation)};
    Eigen::Matrix3d m = Eigen::Matrix3d::Identity();
    m.row(2) = plane.height_jacobian(s.translation);
    Eigen::Matrix3d covariance = m * plane.covariance * m.transpose();
    covariance(0, 0) += std::pow(options_.stance_sigma_tilt, 2);
    covariance(1, 1) += std::pow(options_.stance_sigma_tilt, 2);
    covariance(2, 2) += std::pow(options_.stance_sigma_height, 2);
    *information = covariance.inverse();
  }

  /// d stance / d parameters.
  StanceJacobian stance_jacobian(const State& s) const {
    StanceJacobian jacobian;
    jacobian.setZero(3, num_parameters_);
    // up = R exp(w) e_y: d up = R (w x e_y) = -w_x ... : columns for w_x, w_z.
    const Eigen::Vector3d up_by_x = s.rotation.col(2);   // e_x x e_y = e_z
    const Eigen::Vector3d up_by_z = -s.rotation.col(0);  // e_z x e_y = -e_x
    jacobian(0, 3) = -support_.plane.axis2.dot(up_by_x);
    jacobian(0, 5) = -support_.plane.axis2.dot(up_by_z);
    jacobian(1, 3) = support_.plane.axis1.dot(up_by_x);
    jacobian(1, 5) = support_.plane.axis1.dot(up_by_z);
    jacobian.block<1, 3>(2, 0) = support_.plane.plane.normal.transpose();
    return jacobian;
  }

  void add_plane(const State& s, double* cost, Matrix* hessian, Vector* gradient) const {
    Eigen::Vector3d e;
    Eigen::Matrix3d information;
    stance(s, &e, &information);
    const double squared = e.dot(information * e);
    const bool trusted = options_.trust_plane;
    // Views that share the plane doubt it together.
    *cost += shared_weight_ *
             (trusted ? 0.5 * squared : 0.5 * kPlaneScale * std::log1p(squared / kPlaneScale));
    // An upside-down vehicle has small e as well.
    if (s.rotation.col(1).dot(support_.plane.plane.normal) < 0.0) *cost += 1e3;
    if (!hessian) return;
    const double weight = shared_weight_ * (trusted ? 1.0 : 1.0 / (1.0 + squared / kPlaneScale));
    const StanceJacobian jacobian = stance_jacobian(s);
    hessian->noalias() += weight * jacobian.transpose() * information * jacobian;
    gradient->noalias() += weight * jacobian.transpose() * (information * e);
  }

  void add_prior(const State& s, double* cost, Matrix* hessian, Vector* gradient) const {
    const int known = kSizeParameters + num_coefficients_;
    Vector difference(known);
    difference.head<3>() = s.size;
    if (num_coefficients_ > 0) difference.tail(num_coefficients_) = s.shape;
    difference -= prior_mean_;
    const Vector pull = prior_information_ * difference;
    *cost += 0.5 * difference.dot(pull);
    if (!hessian) return;
    hessian->bottomRightCorner(known, known) += prior_information_;
    gradient->tail(known) += pull;
  }

  const PinholeCamera& camera_;
  const SupportPlane& support_;
  const VehicleFitOptions& options_;
  int num_coefficients_ = 0;
  int num_parameters_ = 0;
  std::array<double, kNumKeypoints> model_variance_{};  // m^2
  NoiseModel noise_;
  double noise_scale_ = 1.0;
  double shape_error_scale_ = 1.0;  // cells^2 / m^2
  Eigen::Matrix<double, 2, 3> cells_by_shape_error_ = Eigen::Matrix<double, 2, 3>::Zero();  // 1/m
  double shared_weight_ = 1.0;
  double body_height_px_ = 0.0;
  bool use_confidence_ = false;
  Vector prior_mean_;  // size, coefficients
  Matrix prior_information_;
  std::array<BodyPoint, kNumBodyPoints> body_;
  std::array<BoxEdge, 4> edges_{};
  double cell_u_ = 1.0, cell_v_ = 1.0;  // px
  std::vector<int> used_;               // keypoints with a pixel
  std::vector<Eigen::Vector2d> pixels_;
  std::vector<Eigen::Vector3d> rays_;
  std::vector<double> rank_;  // of the confidences, in [0, 1]; empty: none
  std::vector<double> seen_share_;
};

struct Solution {
  State state;
  double cost = kInfinity;
};

/// How far the middle of the box is off that of the keypoints, as a share of its sides: bumpers,
/// roofs and mirrors of one car reach farther beyond its keypoints than those of another.
constexpr double kCentreShare = 0.004;

/// Rows of the reported parameters in terms of the solved ones; the centre with what the prior does
/// not know of it.
inline Eigen::Matrix<double, 9, 9> report_covariance(const State& s, const Matrix& covariance) {
  Eigen::Matrix<double, 9, Eigen::Dynamic, 0, 9, kMaxParameters> j;
  j.setZero(9, covariance.cols());
  j.block<3, 3>(0, 0).setIdentity();
  const Eigen::Vector3d middle(0.0, 0.5 * s.size[2], 0.0);
  j.block<3, 3>(0, 3) = -s.rotation * skew(middle);
  j.block<3, 1>(0, 8) = 0.5 * s.rotation.col(1);
  j.block<6, 6>(3, 3).setIdentity();
  Eigen::Matrix<double, 9, 9> out = j * covariance * j.transpose();
  const Eigen::Vector3d margins = kCentreShare * Eigen::Vector3d(s.size[0], s.size[2], s.size[1]);
  out.topLeftCorner<3, 3>() +=
      s.rotation * margins.cwiseAbs2().asDiagonal() * s.rotation.transpose();
  return out;
}

inline void write_state(const VehiclePrior& prior, const State& s, VehicleEstimate* out) {
  out->pose.camera_from_vehicle = SE3(s.rotation, s.translation);
  out->pose.dimensions = {s.size[0], s.size[1], s.size[2]};
  out->shape.assign(s.shape.data(), s.shape.data() + s.shape.size());
  const ShapePrior& shape = prior.shape(out->vehicle_class);
  const KeypointMatrix keypoints = shape.keypoints(out->pose.dimensions, out->shape);
  for (int i = 0; i < kNumKeypoints; ++i) {
    out->keypoints[i] = s.rotation * keypoints.col(i) + s.translation;
  }
}

inline Matrix inverse_of(const Matrix& hessian) {
  return hessian.ldlt().solve(Matrix::Identity(hessian.rows(), hessian.cols()));
}

/// Why the keypoints' answer is not to be trusted; empty if it is.
inline std::string distrust_of(const SingleViewProblem& problem, const State& s,
                               const PinholeCamera& camera, const Box2& box) {
  if (problem.agreement(s).kept < std::max(5.0, 0.3 * problem.num_keypoints())) {
    return "too few keypoints agree";
  }
  Box2 predicted;
  if (problem.predicted_box(s, &predicted) &&
      intersection_over_union(predicted.clipped(camera.width, camera.height),
                              box.clipped(camera.width, camera.height)) < 0.4) {
    return "the keypoints do not fit the box";
  }
  return "";
}

/// Writes a trusted answer with its covariance (of the solved parameters) and status.
/// @param rival  cost of the best other heading above this one's.
void write_answer(const SingleViewProblem& problem, const VehiclePrior& prior, const State& s,
                  const Matrix& covariance, double rival, VehicleEstimate* out);

/// What the support plane's own status means for the answer, the plane's height deviation there,
/// and kFailed for an answer that is not finite.
void finish_answer(const SupportPlane& support, VehicleEstimate* out);

}  // namespace camber::internal
