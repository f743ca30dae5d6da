#include "camber/vehicle/detail/keypoint_likelihood.h"

#include <algorithm>
#include <cmath>

#include "camber/vehicle/detail/keypoint_visibility.h"
#include "camber/vehicle/detail/linear_algebra.h"

namespace camber::internal {

namespace {

constexpr double kPi = 3.14159265358979323846;

}  // namespace

double ErrorDensity::share_along(double squared_error) const {
  const double mean = weight();
  return std::max(1.0 - (by_squared_precision / total - mean * mean) * squared_error / mean, 0.0);
}

ErrorDensity error_density(const KeypointNoise& noise, double gross_share,
                           const SquaredError& error, const ErrorComponents& components,
                           double shape_variance) {
  ErrorDensity out;
  out.total = gross_share * noise.cell_share * noise.cell_share;
  for (std::size_t c = 0; c < components.size(); ++c) {
    const double variance = components[c].sigma * components[c].sigma + shape_variance;
    const double squared = c == 0 ? error.seen : error.guessed;
    const double density =
        components[c].share * std::exp(-0.5 * squared / variance) / (2.0 * kPi * variance);
    const double by_precision = density / variance;
    out.total += density;
    out.by_precision += by_precision;
    out.by_squared_precision += by_precision / variance;
    if (c == 0) {
      out.seen = density;
      out.seen_by_precision = by_precision;
    }
    if (c < 2) out.near += density;
  }
  return out;
}

ErrorDensity error_density(const KeypointNoise& noise, const SquaredError& error, double seen_share,
                           double seen_scale, double shape_variance) {
  const double good = 1.0 - noise.gross_share;
  const ErrorComponents components = {
      {{good * seen_share, noise.seen * seen_scale},
       {good * (1.0 - seen_share) * (1.0 - noise.far_share), noise.guessed},
       {good * (1.0 - seen_share) * noise.far_share, noise.guessed_far}}};
  return error_density(noise, noise.gross_share, error, components, shape_variance);
}

KeypointLikelihood::KeypointLikelihood(const PinholeCamera& camera,
                                       const VehicleDetection& detection, KeypointSet keypoint_set,
                                       const KeypointNoise& noise,
                                       const std::array<double, kNumKeypoints>& shape_variance,
                                       const Eigen::Vector3d& mean_size, const Box2& cuts)
    : noise_(noise),
      focal_(camera.fx, camera.fy),
      shape_variance_(shape_variance),
      mean_size_(mean_size.sum()),
      cell_u_(std::max(detection.box.width() * noise.cell_share, noise.min_cell_px)),
      cell_v_(std::max(detection.box.height() * noise.cell_share, noise.min_cell_px)),
      first_(cuts.x1, cuts.y1),
      last_(cuts.x2, cuts.y2) {
  bool all_confident = true, all_stated = true;
  std::vector<double> confidence, sigma;
  for (int i = 0; i < static_cast<int>(detection.keypoints.size()); ++i) {
    const KeypointObservation& k = detection.keypoints[static_cast<std::size_t>(i)];
    if (!k.pixel.allFinite() || !in_keypoint_set(keypoint_set, i)) continue;
    points_.push_back(i);
    pixels_.push_back(k.pixel);
    rays_.push_back(camera.ray(k.pixel));
    confidence.push_back(k.confidence);
    sigma.push_back(k.sigma);
    all_confident &= std::isfinite(k.confidence);
    all_stated &= std::isfinite(k.sigma);
  }
  const bool cut = first_.isFinite().any() || last_.isFinite().any();
  seen_share_.assign(points_.size(), 0.5);
  if (all_stated && !points_.empty()) {
    // Stated sigmas are the same along both axes, so cells are square.
    cell_u_ = cell_v_ = std::max(cell_u_, cell_v_);
    for (std::size_t j = 0; j < points_.size(); ++j) {
      if (all_confident) seen_share_[j] = std::clamp(confidence[j], 0.0, 1.0);
      const bool may_be_outside = cut && all_confident && seen_share_[j] < 0.5;
      const double scale = noise.stated_scale * (may_be_outside ? noise.stated_cut_scale : 1.0);
      stated_.push_back(std::max(sigma[j], noise.min_cell_px) * scale / cell_u_);
    }
    return;
  }
  if (!all_confident || points_.size() < 8) return;
  // Ranks, shared among equals: any monotone scale serves.
  const double count = static_cast<double>(points_.size());
  rank_.resize(points_.size());
  for (std::size_t j = 0; j < points_.size(); ++j) {
    double below = 0.0;
    for (double other : confidence) {
      below += other < confidence[j] ? 1.0 : (other == confidence[j] ? 0.5 : 0.0);
    }
    rank_[j] = below / count;
  }
}

void KeypointLikelihood::clear() {
  points_.clear();
  pixels_.clear();
  rays_.clear();
  rank_.clear();
  stated_.clear();
  seen_share_.clear();
}

void KeypointLikelihood::update_visibility(const BodyView& at) {
  // Shape errors grow with the vehicle: a larger one farther away looks the same.
  const double size = at.form().size.sum() / mean_size_;
  const Eigen::Matrix3d& rotation = at.pose().rotation;
  const Eigen::Vector3d& translation = at.pose().translation;
  const Eigen::Vector3d ray = translation / translation.z();
  const double scale_u = size * focal_.x() / (translation.z() * cell_u_);
  const double scale_v = size * focal_.y() / (translation.z() * cell_v_);
  shape_error_scale_ = scale_u * scale_v;
  cells_by_shape_error_.row(0) = scale_u * (rotation.row(0) - ray.x() * rotation.row(2));
  cells_by_shape_error_.row(1) = scale_v * (rotation.row(1) - ray.y() * rotation.row(2));
  if (!stated_.empty()) return;  // the network states what it sees
  const Eigen::Vector3d eye = rotation.transpose() * -translation;  // vehicle frame
  for (std::size_t j = 0; j < points_.size(); ++j) {
    const Eigen::Array2d pixel = at.pixel(points_[j]).array();
    const bool in_image = (pixel >= first_).all() && (pixel <= last_).all();
    const bool shown = in_image && shown_to(eye, points_[j], at.in_vehicle(points_[j]));
    double share = shown ? noise_.seen_share_shown : noise_.seen_share_hidden;
    if (use_confidence_) {
      const double odds =
          share / (1.0 - share) * std::exp(noise_.confidence_log_odds * (rank_[j] - 0.5));
      share = odds / (1.0 + odds);
    }
    seen_share_[j] = share;
  }
}

void KeypointLikelihood::prepare(const BodyView& at) {
  update_visibility(at);
  decide_on_confidence(at);
  adapt_noise(at);
  update_visibility(at);
}

void KeypointLikelihood::decide_on_confidence(const BodyView& at) {
  if (rank_.empty()) return;
  use_confidence_ = false;
  update_visibility(at);
  if (!at.in_front()) return;
  const double without = add(at, nullptr, false, nullptr, nullptr);
  use_confidence_ = true;
  update_visibility(at);
  const double with = add(at, nullptr, false, nullptr, nullptr);
  if (!(with < without - noise_.confidence_evidence)) {
    use_confidence_ = false;
    update_visibility(at);
  }
}

void KeypointLikelihood::adapt_noise(const BodyView& at) {
  if (!at.in_front()) return;
  double sum = noise_.adapt_prior_count, count = noise_.adapt_prior_count;
  for (std::size_t j = 0; j < points_.size(); ++j) {
    const SquaredError squared = error(j, at, nullptr).squared;
    const ErrorDensity d = density(j, squared, true);
    // Of those with stated sigmas all but the far ones are as accurate as is stated.
    const double share = (stated_.empty() ? d.seen : d.near) / d.total, sigma = seen_sigma(j);
    const double counted = stated_.empty() ? squared.seen : squared.guessed;
    sum += share * std::max(counted - 2.0 * shape_variance(j), 0.0) / (sigma * sigma);
    count += 2.0 * share;
  }
  seen_scale_ = std::clamp(std::sqrt(sum / count), noise_.adapt_min, noise_.adapt_max);
}

double KeypointLikelihood::shape_variance(std::size_t j) const {
  return shape_variance_[static_cast<std::size_t>(points_[j])] * shape_error_scale_;
}

KeypointLikelihood::Error KeypointLikelihood::error(std::size_t j, const BodyView& at,
                                                    const ShapeErrors* errors) const {
  const Eigen::Array2d cell(cell_u_, cell_v_), observed = pixels_[j].array();
  Eigen::Vector2d projection = at.pixel(points_[j]).array() / cell;
  if (errors) projection += cells_by_shape_error_ * errors->col(points_[j]);
  const Eigen::Array2d first = first_ / cell, last = last_ / cell;
  Error out;
  out.off = projection.array() - observed / cell;
  out.beyond = projection.array() < first || projection.array() > last;
  out.squared.seen = out.squared.guessed = out.off.squaredNorm();
  if (out.beyond.any()) {
    const Eigen::Array2d answered = projection.array().max(first).min(last);
    out.squared.guessed = (answered - observed / cell).matrix().squaredNorm();
  }
  return out;
}

ErrorDensity KeypointLikelihood::density(std::size_t j, const SquaredError& error,
                                         bool integrate_shape) const {
  const double variance = integrate_shape ? shape_variance(j) : 0.0;
  if (stated_.empty()) {
    return error_density(noise_, error, seen_share_[j], seen_scale_, variance);
  }
  const double good = 1.0 - noise_.stated_gross_share, sigma = stated_[j] * seen_scale_;
  const double near = good * (1.0 - noise_.stated_far_share);
  const ErrorComponents components = {
      {{near * seen_share_[j], sigma},
       {near * (1.0 - seen_share_[j]), sigma},
       {good * noise_.stated_far_share, noise_.stated_far_scale * sigma}}};
  return error_density(noise_, noise_.stated_gross_share, error, components, variance);
}

double KeypointLikelihood::seen_sigma(std::size_t j) const {
  return stated_.empty() ? noise_.seen : stated_[j];
}

double KeypointLikelihood::add(const BodyView& at, const ShapeErrors* errors, bool observed,
                               NormalEquations* equations,
                               ShapeErrorEquations* error_equations) const {
  double cost = 0.0;
  const auto count = static_cast<Eigen::Index>(points_.size());
  const Eigen::Index parameters = at.num_parameters();
  // Derivatives of the errors, two columns a keypoint; weighted, then multiplied at once.
  Eigen::MatrixXd rows;
  Eigen::VectorXd residuals;
  if (equations) {
    rows.resize(parameters, 2 * count);
    residuals.resize(2 * count);
  }
  for (Eigen::Index j = 0; j < count; ++j) {
    const int point = points_[static_cast<std::size_t>(j)];
    const Error found = error(static_cast<std::size_t>(j), at, errors);
    const Eigen::Vector2d& off = found.off;
    const ErrorDensity d = density(static_cast<std::size_t>(j), found.squared, errors == nullptr);
    cost -= std::log(d.total);
    if (!equations) continue;
    const Eigen::Vector2d weight = found.weights(d);
    const double squared = found.squared.seen;
    const double along = observed && !found.beyond.any() ? d.share_along(squared) : 1.0;
    const double less = along < 1.0 ? (1.0 - along) * d.weight() / squared : 0.0;
    Eigen::MatrixXd::ColXpr du = rows.col(2 * j), dv = rows.col(2 * j + 1);
    at.jacobian(point, du.data(), dv.data());
    du /= cell_u_;
    dv /= cell_v_;
    if (less > 0.0) {
      const Eigen::VectorXd row = du * off.x() + dv * off.y();
      equations->hessian.noalias() -= (less * row) * row.transpose();
    }
    if (error_equations) {
      Eigen::Matrix2d information = -less * off * off.transpose();
      information.diagonal() += weight;
      const Eigen::Matrix<double, 3, 2> weighted = cells_by_shape_error_.transpose() * information;
      error_equations->own[static_cast<std::size_t>(point)] = weighted * cells_by_shape_error_;
      error_equations->gradient.col(point) =
          cells_by_shape_error_.transpose() * weight.cwiseProduct(off);
      for (Eigen::Index p = 0; p < parameters; ++p) {
        error_equations->cross.block<3, 1>(3 * point, p) =
            weighted.col(0) * du[p] + weighted.col(1) * dv[p];
      }
    }
    const Eigen::Vector2d root = weight.cwiseSqrt();
    du *= root.x();
    dv *= root.y();
    residuals.segment<2>(2 * j) = root.cwiseProduct(off);
  }
  if (equations && count > 0) {
    add_square(rows, &equations->hessian);
    equations->gradient.noalias() += rows * residuals;
  }
  return cost;
}

std::vector<Eigen::Vector2d> KeypointLikelihood::weights(const BodyView& at,
                                                         const ShapeErrors* errors) const {
  std::vector<Eigen::Vector2d> out(points_.size());
  for (std::size_t j = 0; j < points_.size(); ++j) {
    const Error found = error(j, at, errors);
    out[j] = found.weights(density(j, found.squared, errors == nullptr));
  }
  return out;
}

KeypointLikelihood::Agreement KeypointLikelihood::agreement(const BodyView& at) const {
  Agreement out;
  double sum = 0.0;
  for (std::size_t j = 0; j < points_.size(); ++j) {
    if (!at.in_front(points_[j])) continue;
    const ErrorDensity d = density(j, error(j, at, nullptr).squared, true);
    const double near = d.near / d.total;
    out.count += near;
    const Eigen::Array2d answered = at.pixel(points_[j]).array().max(first_).min(last_);
    sum += near * (answered - pixels_[j].array()).matrix().squaredNorm();
  }
  if (out.count > 0.5) out.rmse_px = std::sqrt(sum / out.count);
  return out;
}

std::vector<ObservedKeypoint> KeypointLikelihood::observed(const BodyView& at) const {
  std::vector<ObservedKeypoint> out;
  for (std::size_t j = 0; j < points_.size(); ++j) {
    if (!at.in_front(points_[j])) continue;
    ObservedKeypoint k;
    k.point = points_[j];
    k.pixel = pixels_[j];
    k.seen = seen_share_[j] > 0.5;
    const double cells = k.seen || !stated_.empty() ? seen_sigma(j) * seen_scale_
                                                    : 0.5 * (noise_.guessed + noise_.guessed_far);
    const double sigma = std::sqrt(cells * cells + shape_variance(j));
    k.sigma_px = {sigma * cell_u_, sigma * cell_v_};
    out.push_back(k);
  }
  return out;
}

}  // namespace camber::internal
