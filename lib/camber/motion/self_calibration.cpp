#include "camber/motion/self_calibration.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "camber/core/median.h"
#include "camber/motion/detail/spread_points.h"

namespace camber {
namespace {

constexpr int kMostMatches = 3000;  // over all images
constexpr int kLeastMatches = 100;
constexpr double kNearLogFactor = 0.05;
constexpr int kMotion = 5;  // parameters of an image: rotation, direction of travel

/// One match: pixels from the principal point.
struct Match {
  int image;
  Eigen::Vector2d from, to;
};

/// A focal length with each image's motion; the translations are unit vectors.
struct Calibration {
  double log_factor = 0.0;
  std::vector<SE3> views;
};

/// A step of all parameters: the factor's logarithm, then rotation (on the left, rad) and direction
/// (in the tangent plane of the unit sphere) of each image.
Calibration moved(const Calibration& at, const Eigen::VectorXd& step) {
  Calibration out = at;
  out.log_factor += step(0);
  for (std::size_t m = 0; m < at.views.size(); ++m) {
    const auto row = static_cast<Eigen::Index>(1 + kMotion * m);
    const Eigen::Vector3d t = at.views[m].translation();
    const Eigen::Vector3d u = t.unitOrthogonal(), v = t.cross(u);
    out.views[m] = SE3(rotation_from_vector(step.segment<3>(row)) * at.views[m].rotation(),
                       (t + step(row + 3) * u + step(row + 4) * v).normalized());
  }
  return out;
}

class EpipolarProblem {
 public:
  EpipolarProblem(const PinholeCamera& camera, std::vector<Match> matches, std::size_t images)
      : fx_(camera.fx), fy_(camera.fy), matches_(std::move(matches)), images_(images) {}

  Eigen::Index parameters() const { return static_cast<Eigen::Index>(1 + kMotion * images_); }
  std::size_t size() const { return matches_.size(); }

  /// Sampson errors, px.
  Eigen::VectorXd errors(const Calibration& at) const {
    const double fx = fx_ * std::exp(at.log_factor), fy = fy_ * std::exp(at.log_factor);
    std::vector<Eigen::Matrix3d> essential;
    for (const SE3& view : at.views) {
      essential.push_back(skew(view.translation()) * view.rotation_matrix());
    }
    Eigen::VectorXd out(static_cast<Eigen::Index>(matches_.size()));
    for (std::size_t i = 0; i < matches_.size(); ++i) {
      out(static_cast<Eigen::Index>(i)) =
          sampson(essential[static_cast<std::size_t>(matches_[i].image)], matches_[i], fx, fy);
    }
    return out;
  }

  /// Derivatives of the errors by the parameters, by central differences: the factor's and the
  /// motion of the match's own image, the others are zero.
  Eigen::MatrixXd jacobian(const Calibration& at) const {
    constexpr double kStep = 1e-6;
    Eigen::MatrixXd out(static_cast<Eigen::Index>(matches_.size()), 1 + kMotion);
    for (int p = 0; p <= kMotion; ++p) {
      Eigen::VectorXd step = Eigen::VectorXd::Zero(parameters());
      if (p == 0) step(0) = kStep;
      for (std::size_t m = 0; p > 0 && m < images_; ++m) {
        step(static_cast<Eigen::Index>(kMotion * m) + p) = kStep;  // all images at once
      }
      out.col(p) = (errors(moved(at, step)) - errors(moved(at, -step))) / (2.0 * kStep);
    }
    return out;
  }

  /// Half the sum of the Cauchy losses.
  static double cost(const Eigen::VectorXd& errors, double width) {
    return 0.5 * (1.0 + (errors / width).array().square()).log().sum();
  }

  struct Normal {
    Eigen::MatrixXd information;
    Eigen::VectorXd gradient;
  };
  /// Normal equations, weighted by the Cauchy loss, of errors in widths of it.
  Normal linearise(const Calibration& at, const Eigen::VectorXd& errors, double width) const {
    const Eigen::MatrixXd j = jacobian(at);
    Normal out{Eigen::MatrixXd::Zero(parameters(), parameters()),
               Eigen::VectorXd::Zero(parameters())};
    for (std::size_t i = 0; i < matches_.size(); ++i) {
      const auto row = static_cast<Eigen::Index>(i);
      const double e = errors(row) / width, weight = 1.0 / (1.0 + e * e);
      const Eigen::Matrix<double, 1 + kMotion, 1> a = j.row(row).transpose() / width;
      const auto own = static_cast<Eigen::Index>(1 + kMotion * matches_[i].image);
      const Eigen::Matrix<double, kMotion, 1> motion = a.tail<kMotion>();
      out.information(0, 0) += weight * a(0) * a(0);
      out.information.block<kMotion, 1>(own, 0) += weight * a(0) * motion;
      out.information.block<kMotion, kMotion>(own, own) += weight * motion * motion.transpose();
      out.gradient(0) += weight * e * a(0);
      out.gradient.segment<kMotion>(own) += weight * e * motion;
    }
    out.information.row(0) = out.information.col(0).transpose();
    return out;
  }

 private:
  static double sampson(const Eigen::Matrix3d& essential, const Match& match, double fx,
                        double fy) {
    const Eigen::Vector3d a(match.from.x() / fx, match.from.y() / fy, 1.0),
        b(match.to.x() / fx, match.to.y() / fy, 1.0);
    const Eigen::Vector3d line = essential * a, back = essential.transpose() * b;
    const Eigen::Vector4d slope(line.x() / fx, line.y() / fy, back.x() / fx, back.y() / fy);
    const double length = slope.norm();
    return length > 0.0 ? b.dot(line) / length : 0.0;
  }

  double fx_, fy_;
  std::vector<Match> matches_;
  std::size_t images_;
};

/// Levenberg-Marquardt. @param fixed  the focal length stays @return the cost
double minimise(const EpipolarProblem& problem, double width, bool fixed, Calibration& at) {
  constexpr int kMostIterations = 30;
  double damping = 1e-3;
  Eigen::VectorXd errors = problem.errors(at);
  double cost = EpipolarProblem::cost(errors, width);
  for (int iteration = 0; iteration < kMostIterations; ++iteration) {
    const EpipolarProblem::Normal normal = problem.linearise(at, errors, width);
    bool better = false;
    double gain = 0.0;
    while (!better && damping < 1e6) {
      Eigen::MatrixXd damped = normal.information;
      damped.diagonal() *= 1.0 + damping;
      damped.diagonal().array() += 1e-12;
      Eigen::VectorXd step = -damped.ldlt().solve(normal.gradient);
      step(0) = fixed ? 0.0 : std::clamp(step(0), -0.3, 0.3);
      const Calibration next = moved(at, step);
      const Eigen::VectorXd next_errors = problem.errors(next);
      const double next_cost = EpipolarProblem::cost(next_errors, width);
      better = next_cost < cost;
      if (!better) {
        damping *= 10.0;
        continue;
      }
      gain = cost - next_cost;
      at = next;
      errors = next_errors;
      cost = next_cost;
      damping = std::max(1e-9, 0.1 * damping);
    }
    if (!better || gain < 1e-8 * cost) break;
  }
  return cost;
}

std::vector<Match> choose_matches(const PinholeCamera& camera, const Correspondences& matches,
                                  const std::vector<std::uint8_t>& usable) {
  const Eigen::Vector2d center(camera.cx, camera.cy);
  const int share =
      kMostMatches / static_cast<int>(std::max<std::size_t>(1, matches.matches.size()));
  std::vector<Match> out;
  for (std::size_t m = 0; m < matches.matches.size(); ++m) {
    const MatchedImage& match = matches.matches[m];
    std::vector<std::uint8_t> seen = usable;
    for (std::size_t i = 0; i < seen.size(); ++i) {
      if (!std::isfinite(match.round_trip_px[i])) seen[i] = 0;
    }
    for (const int i : detail::spread_points(matches, seen, std::max(50, share))) {
      const auto at = static_cast<std::size_t>(i);
      out.push_back({static_cast<int>(m), matches.pixels[at].cast<double>() - center,
                     match.pixels[at].cast<double>() - center});
    }
  }
  return out;
}

/// The motion that keeps the image motion about the principal point if the focal length changes.
Calibration start_at(double factor, const Correspondences& matches, const MotionEstimate& motion) {
  Calibration out;
  out.log_factor = std::log(factor);
  for (const MatchedImage& match : matches.matches) {
    const SE3& view = motion.frame_from_reference[static_cast<std::size_t>(match.frame)];
    Eigen::Vector3d turn = rotation_to_vector(view.rotation()), t = view.translation();
    turn.head<2>() /= factor;
    t.head<2>() /= factor;
    out.views.emplace_back(rotation_from_vector(turn), t.normalized());
  }
  return out;
}

}  // namespace

FocalLengthEstimate estimate_focal_length(const PinholeCamera& camera,
                                          const Correspondences& matches,
                                          const std::vector<std::uint8_t>& usable,
                                          const MotionEstimate& motion, const MatchNoise& noise) {
  if (usable.size() != matches.pixels.size()) {
    throw std::invalid_argument("usable has " + std::to_string(usable.size()) +
                                " entries, expected " + std::to_string(matches.pixels.size()));
  }
  FocalLengthEstimate out;
  double turn = 0.0;
  for (const MatchedImage& match : matches.matches) {
    const SE3& view = motion.frame_from_reference.at(static_cast<std::size_t>(match.frame));
    turn = std::max(turn, rotation_to_vector(view.rotation()).norm());
    if (!(view.translation().norm() > 0.0)) return out;
  }
  if (turn < noise.least_turn) return out;
  out.status = Status::kFailed;
  const EpipolarProblem problem(camera, choose_matches(camera, matches, usable),
                                matches.matches.size());
  out.matches = static_cast<int>(problem.size());
  if (out.matches < kLeastMatches) return out;
  const double width = std::max(noise.cauchy_px, 2.0 * motion.pixel_sigma);
  Calibration as_given = start_at(1.0, matches, motion), best = as_given;
  const double given = minimise(problem, width, true, as_given);
  double least = minimise(problem, width, false, best);
  // There may be a better minimum farther away where this one is off the given length at all.
  for (const double factor : {0.6, 1.7}) {
    if (std::abs(best.log_factor) < kNearLogFactor) break;
    Calibration at = start_at(factor, matches, motion);
    const double cost = minimise(problem, width, false, at);
    if (cost < least) {
      least = cost;
      best = at;
    }
  }
  const Eigen::VectorXd errors = problem.errors(best);
  std::vector<double> sizes(static_cast<std::size_t>(errors.size()));
  for (std::size_t i = 0; i < sizes.size(); ++i) {
    sizes[i] = std::abs(errors(static_cast<Eigen::Index>(i)));
  }
  std::nth_element(sizes.begin(), sizes.begin() + static_cast<std::ptrdiff_t>(sizes.size() / 2),
                   sizes.end());
  const double pixel_sigma = std::max(0.02, kSigmaFromMad * sizes[sizes.size() / 2]);
  const EpipolarProblem::Normal normal = problem.linearise(best, errors, width);
  const Eigen::LDLT<Eigen::MatrixXd> solver(normal.information);
  if (solver.info() != Eigen::Success || !solver.isPositive()) return out;
  const Eigen::VectorXd column = solver.solve(Eigen::VectorXd::Unit(problem.parameters(), 0));
  const double variance = column(0) * std::pow(pixel_sigma / width, 2) * noise.correlation;
  if (!(variance > 0.0) || !std::isfinite(best.log_factor)) return out;
  out.factor = std::exp(best.log_factor);
  out.sigma = std::sqrt(variance);
  out.gain = std::max(0.0, given - least) * std::pow(width / pixel_sigma, 2) / noise.correlation;
  out.status = Status::kOk;
  return out;
}

}  // namespace camber
