#include "camber/pipeline/lift_box.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "camber/vehicle/shape_prior.h"

namespace camber {

namespace {

constexpr double kPi = 3.14159265358979323846;
/// Of the logarithm of the distance, where the detector's is not used.
constexpr double kUnknownDepth = 3.0;
constexpr int kMaxIterations = 20;

/// What is estimated of a row: (logarithm of the distance over the detector's, px by which the
/// centre's row is off at that distance, logarithm of the height over the label's).
struct BoxState {
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();

  double depth_sigma() const { return std::sqrt(std::max(covariance(0, 0), 0.0)); }
};

/// One row of a label file in the frame of its camera.
class BoxGeometry {
 public:
  BoxGeometry(const KittiLabel& label, const KittiCalibration::Camera& camera)
      : label_(label),
        camera_(camera),
        start_(label.location + camera.offset - Eigen::Vector3d(0.0, 0.5 * label.height, 0.0)) {}

  const Eigen::Vector3d& start() const { return start_; }  ///< centre by the detector
  Eigen::Vector3d centre(const Eigen::Vector3d& x) const {
    return std::exp(x[0]) * (start_ + Eigen::Vector3d(0.0, x[1] * start_.z() / camera_.fy, 0.0));
  }
  double height(const Eigen::Vector3d& x) const { return label_.height * std::exp(x[2]); }

  /// The projected box (columns of `rotation`: front, up, right); none if it reaches behind.
  std::optional<Box2> projected(const Eigen::Vector3d& x, const Eigen::Matrix3d& rotation) const {
    const double h = height(x);
    const OrientedBox box{SE3(rotation, centre(x) - 0.5 * h * rotation.col(1)),
                          {label_.length, label_.width, h}};
    const Eigen::Matrix<double, 3, 8> corners = box.corners();
    if (!(corners.row(2).minCoeff() > 0.1)) return std::nullopt;
    const Eigen::Array<double, 1, 8> u =
        camera_.fx * corners.row(0).array() / corners.row(2).array() + camera_.cx;
    const Eigen::Array<double, 1, 8> v =
        camera_.fy * corners.row(1).array() / corners.row(2).array() + camera_.cy;
    return Box2{u.minCoeff(), v.minCoeff(), u.maxCoeff(), v.maxCoeff()};
  }

  /// Height of the box's bottom above a plane, m.
  double clearance(const Eigen::Vector3d& x, const Plane& plane) const {
    return plane.signed_distance(centre(x)) - 0.5 * height(x);
  }

  /// Columns front, up, right on a plane, with the label's rotation_y.
  Eigen::Matrix3d rotation_on(const Eigen::Vector3d& normal) const {
    Eigen::Vector3d front = rotation_from_rotation_y(label_.rotation_y).col(0);
    front.y() = -(normal.x() * front.x() + normal.z() * front.z()) / normal.y();
    front.normalize();
    Eigen::Matrix3d out;
    out << front, normal, front.cross(normal);
    return out;
  }

 private:
  const KittiLabel& label_;
  const KittiCalibration::Camera& camera_;
  Eigen::Vector3d start_;
};

/// The ground below a place: its plane in the camera, and the variance of its height there.
struct GroundBelow {
  SurfaceQuery query;
  UncertainPlane support;
  Plane plane;
  double variance = 0.0;  ///< m^2

  /// Normal for a vehicle: the plane's, drawn to the level by the variances of both.
  Eigen::Vector3d vehicle_up(double tilt_sigma) const {
    const Eigen::Vector3d level(0.0, -1.0, 0.0);
    const Eigen::Matrix2d tilt = support.covariance.topLeftCorner<2, 2>();
    const Eigen::Matrix2d prior = tilt_sigma * tilt_sigma * Eigen::Matrix2d::Identity();
    // A tilt (a, b) moves the normal by b axis1 - a axis2.
    const Eigen::Vector2d off(-support.axis2.dot(level), support.axis1.dot(level));
    const Eigen::Vector2d step = tilt * (tilt + prior).inverse() * off;
    return (plane.normal * plane.normal.dot(level) + support.axis1 * step[1] -
            support.axis2 * step[0])
        .normalized();
  }
};

/// Priors and measurements of one row, and their joint estimate by Gauss and Newton.
class BoxFusion {
 public:
  BoxFusion(const BoxGeometry& geometry, const KittiLabel& label, const RoadSurface& surface,
            const std::optional<SE3>& camera_from_reference, const LiftOptions& options)
      : geometry_(geometry),
        label_(label),
        surface_(surface),
        camera_from_reference_(camera_from_reference),
        options_(options),
        rotation_(rotation_from_rotation_y(label.rotation_y)) {
    // The height by the detector, and by the class where the two agree.
    size_mean_ = 0.0;
    size_variance_ = options.size_sigma * options.size_sigma;
    const SizePrior prior = shipped_vehicle_prior().size(label.type);
    const double off = std::log(prior.mean[2] / label.height);
    const double variance = prior.covariance(2, 2) / (prior.mean[2] * prior.mean[2]);
    if (off * off <= options.gate * options.gate * (variance + size_variance_)) {
      size_mean_ = off * size_variance_ / (size_variance_ + variance);
      size_variance_ = size_variance_ * variance / (size_variance_ + variance);
    }
  }

  struct Sources {
    bool detector = true, box = false, surface = false;
  };

  /// Empty where the box can be used; else why not.
  std::string box_problem() const {
    if (!(label_.box.width() > 2.0 && label_.box.height() > 2.0)) return "no 2D box";
    if (label_.truncated > 0.0) return "the 2D box is cut by the image";
    const std::optional<Box2> box = geometry_.projected(prior_mean(), rotation_);
    if (!box) return "the 3D box reaches behind the camera";
    const double aspect = label_.box.width() / label_.box.height() * box->height() / box->width();
    // Its own sides' noise, on the form: width over height of four sides.
    const double noise = 2.0 * std::sqrt(side_variance()) *
                         std::hypot(1.0 / label_.box.width(), 1.0 / label_.box.height());
    if (std::abs(std::log(aspect)) > std::log1p(options_.aspect_tolerance) + noise) {
      return "the 2D box has not the 3D box's form";
    }
    return {};
  }

  /// Ground below the box at a state; none where the surface does not cover it.
  std::optional<GroundBelow> ground(const Eigen::Vector3d& x, std::string* why = nullptr) const {
    const Eigen::Vector3d foot =
        geometry_.centre(x) + Eigen::Vector3d(0.0, 0.5 * geometry_.height(x), 0.0);
    GroundBelow out;
    out.query = surface_.query(camera_from_reference_->inverse() * foot, options_.reach);
    if (out.query.status == Status::kFailed) {
      if (why) *why = "the surface does not cover the place: " + out.query.reason;
      return std::nullopt;
    }
    if (out.query.status == Status::kNotObservable) {
      if (why) *why = "the ground is not observable there: " + out.query.reason;
      return std::nullopt;
    }
    out.support = out.query.plane.transformed(*camera_from_reference_);
    out.plane = out.support.plane;
    out.variance = out.query.sigma_height * out.query.sigma_height +
                   options_.height_sigma * options_.height_sigma;
    const PlanePatch* patch = surface_.find(out.query.patch);
    if (patch && out.query.plane.covariance != patch->plane.covariance) {  // extrapolated
      out.variance += options_.step_sigma * options_.step_sigma;
    }
    return out;
  }

  /// Joint estimate from `start`; none if a source cannot be evaluated at a step.
  std::optional<BoxState> estimate(const Sources& use, const Eigen::Vector3d& start) const {
    BoxState out;
    out.mean = start;
    for (int iteration = 0; iteration < kMaxIterations; ++iteration) {
      Eigen::Matrix3d information = Eigen::Matrix3d::Zero();
      Eigen::Vector3d gradient = Eigen::Vector3d::Zero();
      add_priors(use.detector, out.mean, information, gradient);
      if (use.box && !add_box(out.mean, information, gradient)) return std::nullopt;
      if (use.surface && !add_surface(out.mean, information, gradient)) return std::nullopt;
      out.covariance = information.inverse();
      Eigen::Vector3d step = -out.covariance * gradient;
      step[0] = std::clamp(step[0], -0.3, 0.3);
      if (iteration > 10) step *= 0.5;  // between two patches it may go to and fro
      out.mean += step;
      if (std::abs(step[0]) < 1e-7) break;
    }
    return out;
  }

  /// How far the surface is off a state, in standard deviations of both.
  double surface_deviation(const BoxState& state, const GroundBelow& ground) const {
    const Eigen::RowVector3d j = clearance_jacobian(state.mean, ground.plane);
    const double variance = ground.variance + (j * state.covariance * j.transpose()).value();
    return std::abs(geometry_.clearance(state.mean, ground.plane)) / std::sqrt(variance);
  }

  Eigen::Vector3d prior_mean() const { return {0.0, 0.0, size_mean_}; }

 private:
  void add_priors(bool detector, const Eigen::Vector3d& x, Eigen::Matrix3d& information,
                  Eigen::Vector3d& gradient) const {
    const double depth = detector ? options_.depth_sigma : kUnknownDepth;
    const double row = std::max(options_.pixel_sigma, 1e-6);
    const Eigen::Vector3d weight(1.0 / (depth * depth), 1.0 / (row * row), 1.0 / size_variance_);
    information.diagonal() += weight;
    gradient += weight.cwiseProduct(x - prior_mean());
  }

  bool add_box(const Eigen::Vector3d& x, Eigen::Matrix3d& information,
               Eigen::Vector3d& gradient) const {
    const std::optional<Box2> at = geometry_.projected(x, rotation_);
    if (!at) return false;
    constexpr double kStep = 1e-5;
    Eigen::Matrix<double, 2, 3> jacobian;
    for (int k = 0; k < 3; ++k) {
      const Eigen::Vector3d off = x + kStep * Eigen::Vector3d::Unit(k);
      const std::optional<Box2> moved = geometry_.projected(off, rotation_);
      if (!moved) return false;
      jacobian.col(k) = Eigen::Vector2d(moved->y1 - at->y1, moved->y2 - at->y2) / kStep;
    }
    const double variance = side_variance();
    const Eigen::Vector2d residual(at->y1 - label_.box.y1, at->y2 - label_.box.y2);
    information += jacobian.transpose() * jacobian / variance;
    gradient += jacobian.transpose() * residual / variance;
    return true;
  }

  bool add_surface(const Eigen::Vector3d& x, Eigen::Matrix3d& information,
                   Eigen::Vector3d& gradient) const {
    const std::optional<GroundBelow> below = ground(x);
    if (!below) return false;
    const Eigen::RowVector3d jacobian = clearance_jacobian(x, below->plane);
    const double variance = std::max(below->variance, 1e-12);
    information += jacobian.transpose() * jacobian / variance;
    gradient += jacobian.transpose() * geometry_.clearance(x, below->plane) / variance;
    return true;
  }

  double side_variance() const {  // px^2
    const double share = options_.box_share * label_.box.height();
    return options_.box_pixel_sigma * options_.box_pixel_sigma + share * share;
  }

  Eigen::RowVector3d clearance_jacobian(const Eigen::Vector3d& x, const Plane& plane) const {
    const Eigen::Vector3d centre = geometry_.centre(x);
    const Eigen::Vector3d row = geometry_.centre(x + Eigen::Vector3d::UnitY()) - centre;
    return {plane.normal.dot(centre), plane.normal.dot(row), -0.5 * geometry_.height(x)};
  }

  const BoxGeometry& geometry_;
  const KittiLabel& label_;
  const RoadSurface& surface_;
  const std::optional<SE3>& camera_from_reference_;
  const LiftOptions& options_;
  Eigen::Matrix3d rotation_;  // of the projected box: upright, as the label's
  double size_mean_ = 0.0, size_variance_ = 0.0;
};

/// The sources that agree, their joint estimate, and why others were left out.
struct Joined {
  BoxFusion::Sources sources;
  BoxState state;
  std::optional<GroundBelow> ground;  ///< where the surface is used
  std::string without_box, without_surface;
};

/// Distances that two estimates of one row differ by, in standard deviations.
double deviation(const BoxState& a, const BoxState& b) {
  const double variance = a.covariance(0, 0) + b.covariance(0, 0);
  return std::abs(a.mean[0] - b.mean[0]) / std::sqrt(std::max(variance, 1e-300));
}

/// Joins the surface to a state if it covers the place and agrees.
bool join_surface(const BoxFusion& fusion, double gate, Joined& joined) {
  std::string why;
  const std::optional<GroundBelow> below = fusion.ground(joined.state.mean, &why);
  if (!below) {
    joined.without_surface = why;
    return false;
  }
  const double off = fusion.surface_deviation(joined.state, *below);
  if (off > gate) {
    joined.without_surface = fmt::format("the surface contradicts by {:.1f} sigma", off);
    return false;
  }
  BoxFusion::Sources all = joined.sources;
  all.surface = true;
  const std::optional<BoxState> state = fusion.estimate(all, joined.state.mean);
  const std::optional<GroundBelow> found =
      state ? fusion.ground(state->mean) : std::optional<GroundBelow>();
  if (!found) {
    joined.without_surface = "the surface ends short of the place";
    return false;
  }
  joined.sources = all;
  joined.state = *state;
  joined.ground = found;
  return true;
}

Joined join_sources(const BoxFusion& fusion, bool surface_known, const LiftOptions& options) {
  Joined detector;
  detector.state = *fusion.estimate({true, false, false}, fusion.prior_mean());
  detector.without_box = fusion.box_problem();
  Joined both = detector;
  if (detector.without_box.empty()) {
    const auto box = fusion.estimate({false, true, false}, fusion.prior_mean());
    const double off = box ? deviation(*box, detector.state) : 0.0;
    if (!box) {
      detector.without_box = "the 2D box has no answer";
    } else if (off <= options.gate) {
      both.sources.box = true;
      both.state = fusion.estimate(both.sources, fusion.prior_mean()).value_or(detector.state);
      if (surface_known) join_surface(fusion, options.gate, both);
      return both;
    } else {
      detector.without_box = fmt::format("the 2D box contradicts by {:.1f} sigma", off);
      // Detector and box disagree: the surface decides where it agrees with one of them alone.
      Joined by_box = detector;
      by_box.sources = {false, true, false};
      by_box.state = *box;
      by_box.without_box.clear();
      const bool with_box = surface_known && join_surface(fusion, options.gate, by_box);
      const bool with_detector = surface_known && join_surface(fusion, options.gate, detector);
      if (with_box && !with_detector) return by_box;
      if (!with_detector) {  // undecided: the detector's distance, but not to its sigma
        const double apart = box->mean[0] - detector.state.mean[0];
        detector.state.covariance(0, 0) += apart * apart;
      }
      return detector;
    }
  }
  if (surface_known) join_surface(fusion, options.gate, detector);
  return detector;
}

}  // namespace

RoadSurface surface_without_vehicles(RoadSurface surface) {
  for (PlanePatch& patch : surface.patches) {
    if (patch.without_vehicle) patch.plane = *patch.without_vehicle;
  }
  return surface;
}

void LiftOptions::validate() const {
  const auto check = [](bool good, const char* name, double value, const char* bound) {
    if (!good) {
      throw std::invalid_argument(fmt::format("{}: {}, must be {}", name, value, bound));
    }
  };
  check(depth_sigma > 0.0 && depth_sigma <= 10.0, "depth_sigma", depth_sigma, "in (0, 10]");
  check(size_sigma > 0.0 && size_sigma <= 10.0, "size_sigma", size_sigma, "in (0, 10]");
  check(pixel_sigma >= 0.0, "pixel_sigma", pixel_sigma, ">= 0");
  check(box_pixel_sigma > 0.0, "box_pixel_sigma", box_pixel_sigma, "> 0");
  check(box_share >= 0.0, "box_share", box_share, ">= 0");
  check(height_sigma >= 0.0, "height_sigma", height_sigma, ">= 0");
  check(step_sigma >= 0.0, "step_sigma", step_sigma, ">= 0");
  check(tilt_sigma > 0.0, "tilt_sigma", tilt_sigma, "> 0");
  check(reach >= 0.0, "reach", reach, ">= 0");
  check(gate > 0.0, "gate", gate, "> 0");
  check(aspect_tolerance > 0.0 && aspect_tolerance < 1.0, "aspect_tolerance", aspect_tolerance,
        "in (0, 1)");
}

LiftedBox lift_box(const KittiLabel& label, const RoadSurface& surface,
                   const std::optional<SE3>& camera_from_reference,
                   const KittiCalibration::Camera& camera, const LiftOptions& options) {
  options.validate();
  LiftedBox out;
  out.label = label;
  out.status = Status::kFailed;
  if (label.dont_care() || !label.has_box3()) {
    out.reason = "the row has no 3D box";
    return out;
  }
  const BoxGeometry geometry(label, camera);
  if (!(geometry.start().z() > 0.5)) {
    out.reason = "the box is not in front of the camera";
    out.sigma_depth = options.depth_sigma * geometry.start().norm();
    return out;
  }
  const BoxFusion fusion(geometry, label, surface, camera_from_reference, options);
  Joined joined = join_sources(fusion, camera_from_reference.has_value(), options);
  if (!camera_from_reference) {
    joined.without_surface = "the surface's run has no frame";
    if (label.frame >= 0) joined.without_surface += fmt::format(" {}", label.frame);
  }
  const Eigen::Vector3d centre = geometry.centre(joined.state.mean);
  out.by_detector = joined.sources.detector;
  out.by_box = joined.sources.box;
  out.by_surface = joined.sources.surface;
  out.sigma_depth = joined.state.depth_sigma() * centre.norm();
  const std::string box_note = joined.without_box.empty() ? "" : "; " + joined.without_box;
  if (!out.by_surface && !out.by_box) {
    out.reason = joined.without_surface + box_note;
    return out;
  }
  out.depth_factor = centre.z() / geometry.start().z();
  Eigen::Vector3d up(0.0, -1.0, 0.0);
  if (out.by_surface) {
    const GroundBelow& below = *joined.ground;
    up = below.vehicle_up(options.tilt_sigma);
    out.tilt = tilt_of(geometry.rotation_on(up));
    out.patch = below.query.patch;
    out.status = below.query.status;
    out.reason = below.query.reason;
    if (out.reason.empty() && !joined.without_box.empty()) out.reason = joined.without_box;
  } else {
    out.status = Status::kWeak;
    out.reason = "distance by the 2D box: " + joined.without_surface;
  }
  out.label.location = centre - 0.5 * label.height * up - camera.offset;
  out.label.alpha = std::remainder(
      label.rotation_y - std::atan2(out.label.location.x(), out.label.location.z()), 2.0 * kPi);
  return out;
}

}  // namespace camber
