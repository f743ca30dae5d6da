#include "camber/scale/detail/driven_profile.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <utility>

namespace camber::detail {
namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr double kNearest = 1.0;        // m ahead, of a point that is used
constexpr double kLossScale = 3.0;      // standard deviations, of the loss of Geman and McClure
constexpr double kInlierWeight = 0.25;  // of a point at that scale

using Terms = std::vector<std::pair<int, double>>;

/// Positions on one side of the camera, outwards, at least `reach` apart; the farthest if none is.
std::vector<Eigen::Vector3d> thinned(std::vector<Eigen::Vector3d> side, double reach) {
  std::sort(side.begin(), side.end(), [](const Eigen::Vector3d& p, const Eigen::Vector3d& q) {
    return std::abs(p.y()) < std::abs(q.y());
  });
  std::vector<Eigen::Vector3d> out;
  double last = 0.0;
  for (const Eigen::Vector3d& p : side) {
    if (std::abs(p.y()) - last < reach) continue;
    out.push_back(p);
    last = std::abs(p.y());
  }
  if (out.empty() && !side.empty()) out.push_back(side.back());
  return out;
}

class ProfileFit {
 public:
  ProfileFit(const ProfileMeasurements& measured, double metres_per_baseline,
             const EgoPlaneOptions& options)
      : measured_(measured), options_(options), weight_(measured.points.size(), 1.0) {
    double behind = 0.0;
    for (const Eigen::Vector3d& p : measured.path) {
      behind = std::max(behind, -1.25 * metres_per_baseline * p.y());
    }
    profile_.step = options.node_spacing;
    profile_.foot = 1 + static_cast<int>(behind / profile_.step);
    profile_.nodes = profile_.foot + static_cast<int>(std::ceil(options.reach / profile_.step)) + 1;
    profile_.x = Eigen::VectorXd::Zero(2 * profile_.nodes);
    profile_.x.head(profile_.nodes).setConstant(-options.camera_height);
    profile_.metres_per_baseline = metres_per_baseline;
    int between_wheels = 0;
    for (const Eigen::Vector3d& q : measured.points) {
      const Eigen::Vector3d p = metres_per_baseline * q;
      between_wheels +=
          p.y() > kNearest && p.y() < options.reach && std::abs(p.x()) < options.start_half_width;
    }
    grows_ =
        options.start_half_width < options.half_width && between_wheels >= options.narrow_points;
  }

  DrivenProfile run() {
    for (int round = 0; round < kRounds; ++round) {
      const bool last = round + 1 == kRounds;
      const auto size = profile_.x.size();
      normal_ = Eigen::MatrixXd::Zero(size, size);
      right_ = Eigen::VectorXd::Zero(size);
      shared_right_ = Eigen::MatrixXd::Zero(size, last ? shared_columns() : 0);
      add_points(half_width(round), round);
      if (profile_.points < 30) {
        profile_.failure = fmt::format("too few road points within {:g} m ahead: {}",
                                       options_.reach, profile_.points);
        return std::move(profile_);
      }
      add_path();
      add_priors(round > 2);
      normal_.diagonal().array() += 1e-8;
      const Eigen::Index cross_slope = profile_.nodes + profile_.foot;
      const Mounting mounting = this->mounting();
      add_measurement({{cross_slope, 1.0}}, measured_.level_cross_slope, mounting.sigma);
      const Eigen::LDLT<Eigen::MatrixXd> ldlt(normal_);
      profile_.x = ldlt.solve(right_);
      if (last) {
        profile_.covariance = ldlt.solve(Eigen::MatrixXd::Identity(size, size));
        const Eigen::VectorXd by_cross_slope =
            profile_.covariance.col(cross_slope) / profile_.covariance(cross_slope, cross_slope);
        profile_.covariance +=
            mounting.spread / options_.inflation * by_cross_slope * by_cross_slope.transpose();
        profile_.shared.resize(size, shared_right_.cols());
        if (shared_right_.cols() > 0) profile_.shared = ldlt.solve(shared_right_);
      } else if (profile_.x[profile_.foot] < 0) {
        const double change =
            std::clamp(options_.camera_height / profile_.camera_height(), 0.8, 1.25);
        profile_.metres_per_baseline *= change;
        profile_.x.head(profile_.nodes) *= change;
      }
    }
    if (!(profile_.x[profile_.foot] < 0)) {
      profile_.failure = "the road ahead does not pass below the camera";
    }
    return std::move(profile_);
  }

 private:
  Eigen::Index shared_columns() const { return measured_.road->shared_jacobian.cols(); }

  /// The strip of a round: a third of them hold the start's, a third widen it.
  double half_width(int round) const {
    if (!grows_) return options_.half_width;
    constexpr int kNarrow = kRounds / 3, kGrowing = kRounds / 3;
    const double grown = std::clamp((round - kNarrow + 1.0) / (kGrowing + 1.0), 0.0, 1.0);
    return options_.start_half_width + grown * (options_.half_width - options_.start_half_width);
  }

  /// Factor that carries a point along its ray to the profile; 1 where the ray does not meet it
  /// below the camera. What is normally distributed is a point's inverse distance: taken where the
  /// profile has it, its standard deviation does not hang on its own error, by which points that
  /// seem nearer would seem surer, and lift the road.
  double carried_to_profile(const Eigen::Vector3d& p) const {
    constexpr int kSteps = 3;
    constexpr double kLeast = 0.5, kMost = 2.0;
    const int nodes = profile_.nodes;
    const Eigen::VectorXd& x = profile_.x;
    double out = 1.0;
    for (int k = 0; k < kSteps; ++k) {
      const double at = out * p.y() / profile_.step + profile_.foot;
      const int j = std::clamp(static_cast<int>(at), 0, nodes - 2);
      const double f = at - j, slope = (x[j + 1] - x[j]) / profile_.step;
      const double bank = (1 - f) * x[nodes + j] + f * x[nodes + j + 1];
      const double off = out * p.z() - (x[j] + f * (x[j + 1] - x[j]) + bank * out * p.x());
      const double lever = p.z() - slope * p.y() - bank * p.x();
      if (!(lever < -kLeast * options_.camera_height)) return 1.0;
      out = std::clamp(out - off / lever, kLeast, kMost);
    }
    return out;
  }

  void add_points(double half_width, int round) {
    // While the profile is still wrong, gross errors that seem nearer would count more.
    const bool robust = round > 0, at_profile = round >= kRounds / 2;
    const double step = profile_.step;
    const int nodes = profile_.nodes;
    const Eigen::VectorXd& x = profile_.x;
    profile_.points = profile_.compared = 0;
    std::vector<double> seen;  // m ahead
    for (std::size_t i = 0; i < measured_.points.size(); ++i) {
      const Eigen::Vector3d measured = profile_.metres_per_baseline * measured_.points[i];
      const double carried = at_profile ? carried_to_profile(measured) : 1.0;
      const Eigen::Vector3d p = carried * measured;
      const double at = p.y() / step + profile_.foot, side = p.x();
      if (!(p.y() > kNearest) || at >= nodes - 1 || std::abs(side) > half_width) continue;
      ++profile_.compared;
      const int j = static_cast<int>(at);
      const double f = at - j;
      const double row[4] = {1 - f, f, (1 - f) * side, f * side};
      const Eigen::Index index[4] = {j, j + 1, nodes + j, nodes + j + 1};
      double predicted = 0.0;
      for (int k = 0; k < 4; ++k) predicted += row[k] * x[index[k]];
      const double slope = (x[j + 1] - x[j]) / step;
      // A change of the distance by a share e lifts the point off the profile by e (u - slope b).
      const double lever = measured.z() - slope * measured.y() - x[nodes + j] * measured.x();
      const double sigma =
          std::hypot(lever * carried * measured_.road->relative_sigma[i], options_.surface_sigma);
      const double residual = at_profile ? -lever * (carried - 1.0) : p.z() - predicted;
      if (robust) {
        const double scale2 = kLossScale * kLossScale * sigma * sigma;
        weight_[i] = 1.0 / std::pow(1.0 + residual * residual / scale2, 2);
      }
      const double w = weight_[i] / (options_.correlation * sigma * sigma);
      for (int m = 0; m < 4; ++m) {
        for (int k = 0; k < 4; ++k) normal_(index[m], index[k]) += w * row[m] * row[k];
        right_[index[m]] += w * row[m] * (predicted + residual);
        if (shared_right_.cols() > 0) {
          shared_right_.row(index[m]) +=
              w * row[m] * lever *
              measured_.road->shared_jacobian.row(static_cast<Eigen::Index>(i)).cast<double>();
        }
      }
      if (weight_[i] > kInlierWeight) {
        ++profile_.points;
        seen.push_back(p.y());
      }
    }
    if (seen.empty()) return;
    const auto nearest = seen.begin() + static_cast<std::ptrdiff_t>(seen.size() / 50);
    std::nth_element(seen.begin(), nearest, seen.end());
    seen_from_ = *nearest;
  }

  /// Factor on the standard deviation of one change of curvature: vertical curves begin and end
  /// abruptly (Cauchy), which the near road shows; from afar it would follow the points' errors.
  double curve_begins(int j) const {
    if (!(seen_from_ < options_.near_road * options_.camera_height)) return 1.0;
    const Eigen::VectorXd& x = profile_.x;
    const int bank = profile_.nodes + j;
    const double change =
        (x[j + 3] - 3 * x[j + 2] + 3 * x[j + 1] - x[j]) / (profile_.step * profile_.step) -
        turn() * (x[bank + 2] - x[bank + 1]);
    const double sigmas = change / (options_.curvature_walk * std::sqrt(profile_.step));
    return std::min(std::hypot(1.0, sigmas / options_.curve_begins), options_.curve_begins_most);
  }

  /// Curvature of the path in plan, 1/m.
  double turn() const { return measured_.path_curvature / profile_.metres_per_baseline; }

  void add_measurement(const Terms& terms, double value, double sigma) {
    const double w = 1.0 / (sigma * sigma);
    for (const auto& [j, cj] : terms) {
      for (const auto& [k, ck] : terms) normal_(j, k) += cj * ck * w;
      right_[j] += cj * value * w;
    }
  }

  /// The road below the camera at a position: where, and how high against the camera's height.
  struct Foot {
    double ahead, right, up;
  };

  Foot foot_below(const Eigen::Vector3d& p) const {
    const double step = profile_.step;
    const int nodes = profile_.nodes;
    const Eigen::VectorXd& x = profile_.x;
    const double at = std::clamp(p.y() / step + profile_.foot, 0.5, nodes - 1.5);
    const int j = std::clamp(static_cast<int>(std::lround(at)), 1, nodes - 2);
    const double slope = (x[j + 1] - x[j - 1]) / (2 * step), cross = x[nodes + j];
    const double h = options_.camera_height / std::sqrt(1 + slope * slope + cross * cross);
    return {p.y() + h * slope, p.x() + h * cross, p.z() + options_.camera_height - h};
  }

  /// Every position of the camera is its height above the road below it, as a random walk against
  /// the profile; without positions, the road runs along the direction of travel.
  void add_path() {
    const double step = profile_.step;
    const int foot = profile_.foot, nodes = profile_.nodes;
    if (measured_.path.empty()) {
      add_measurement({{foot - 1, -0.5 / step}, {foot + 1, 0.5 / step}}, 0.0,
                      options_.travel_sigma);
      return;
    }
    for (const double side : {-1.0, 1.0}) {
      std::vector<Eigen::Vector3d> positions;
      for (const Eigen::Vector3d& p : measured_.path) {
        if (side * p.y() > 0) positions.push_back(profile_.metres_per_baseline * p);
      }
      Foot last = foot_below(Eigen::Vector3d::Zero());
      for (const Eigen::Vector3d& p : thinned(positions, options_.travel_reach)) {
        const Foot next = foot_below(p);
        Terms terms;
        for (const auto& [f, sign] : {std::pair(last, -1.0), std::pair(next, 1.0)}) {
          const double at = std::clamp(f.ahead / step + foot, 0.0, nodes - 1.001);
          const int j = static_cast<int>(at);
          const double share = at - j;
          terms.insert(terms.end(), {{j, sign * (1 - share)},
                                     {j + 1, sign * share},
                                     {nodes + j, sign * (1 - share) * f.right},
                                     {nodes + j + 1, sign * share * f.right}});
        }
        const double apart = std::abs(next.ahead - last.ahead);
        add_measurement(
            terms, next.up - last.up,
            std::sqrt(2.0) *
                std::hypot(options_.heave,
                           options_.travel_sigma *
                               std::sqrt(apart * std::min(apart, options_.travel_reach))));
        last = next;
      }
    }
  }

  void add_priors(bool robust) {
    const double step = profile_.step, s2 = step * step;
    const int nodes = profile_.nodes;
    const double walk = options_.curvature_walk * std::sqrt(step);
    const double curvature = options_.curvature * std::sqrt((options_.reach / step + 2.0) / 4.0);
    // Along a path that turns, an even slope changes to a cross slope and back: what bends is what
    // remains.
    const double turn = this->turn();
    for (int j = 0; j + 2 < nodes; ++j) {
      add_measurement({{j, 1 / s2}, {j + 1, -2 / s2}, {j + 2, 1 / s2}, {nodes + j + 1, -turn}}, 0.0,
                      curvature);
      if (j + 3 < nodes) {
        add_measurement({{j, -1 / s2},
                         {j + 1, 3 / s2},
                         {j + 2, -3 / s2},
                         {j + 3, 1 / s2},
                         {nodes + j + 1, turn},
                         {nodes + j + 2, -turn}},
                        0.0, walk * (robust ? curve_begins(j) : 1.0));
      }
    }
    for (int j = 0; j + 1 < nodes; ++j) {
      add_measurement({{nodes + j, -1.0}, {nodes + j + 1, 1.0}, {j, -turn}, {j + 1, turn}}, 0.0,
                      options_.bank_walk * std::sqrt(step));
    }
  }

  /// The mounting as a measurement of the level cross slope under the camera.
  struct Mounting {
    double sigma;   // rad, with which the answer is the mixture's mean
    double spread;  // rad^2, between the means of the mixture's components
  };

  /// A camera is mounted level or rolled, which of both the road ahead, carried back without it,
  /// decides as far as it can: the posterior of a mixture of two normal distributions about the
  /// level cross slope.
  Mounting mounting() const {
    const Eigen::Index at = profile_.nodes + profile_.foot;
    const Eigen::LDLT<Eigen::MatrixXd> ldlt(normal_);
    const Eigen::VectorXd column = ldlt.solve(Eigen::VectorXd::Unit(normal_.rows(), at));
    const double off = column.dot(right_) - measured_.level_cross_slope;
    const double variance = options_.inflation * column[at];  // of the road's
    double weights = 0.0, mean = 0.0, square = 0.0;           // of the answer's share of `off`
    const auto add = [&](double prior, double sigma) {
      const double both = variance + sigma * sigma;
      const double weight = prior / std::sqrt(both) * std::exp(-0.5 * off * off / both);
      const double share = sigma * sigma / both;
      weights += weight;
      mean += weight * share;
      square += weight * share * share;
    };
    add(1.0 - options_.rolled_share, options_.roll_sigma);
    add(options_.rolled_share, options_.rolled_sigma);
    if (!(weights > 0.0)) return {options_.rolled_sigma, 0.0};  // beyond what doubles hold
    mean /= weights;
    square /= weights;
    return {std::sqrt(column[at] * mean / (1.0 - mean)),
            off * off * std::max(square - mean * mean, 0.0)};
  }

  static constexpr int kRounds = 12;

  const ProfileMeasurements& measured_;
  const EgoPlaneOptions& options_;
  bool grows_ = false;  // the strip, from the start's
  std::vector<double> weight_;
  DrivenProfile profile_;
  Eigen::MatrixXd normal_, shared_right_;
  Eigen::VectorXd right_;
  double seen_from_ = 0.0;  // m ahead
};

}  // namespace

Eigen::Vector3d CircularPath::along(const Eigen::Vector3d& p) const {
  constexpr double kStraight = 1e-6;
  if (std::abs(curvature) * p.head<2>().norm() < kStraight) {
    return {p.x() - 0.5 * curvature * p.y() * p.y(), p.y() * (1.0 + curvature * p.x()), p.z()};
  }
  const double radius = 1.0 / std::abs(curvature), side = curvature > 0 ? 1.0 : -1.0;
  const double inwards = radius - side * p.x();  // from the circle's centre, towards the camera
  const double angle = std::atan2(p.y(), inwards);
  return {side * (radius - std::hypot(inwards, p.y())),
          std::abs(angle) < 0.5 * kPi ? radius * angle : -radius * 0.5 * kPi, p.z()};
}

Eigen::Vector2d CircularPath::at(double distance) const {
  const double angle = curvature * distance;
  if (std::abs(angle) < 1e-6) return {0.5 * angle * distance, distance};
  return {(1.0 - std::cos(angle)) / curvature, std::sin(angle) / curvature};
}

double DrivenProfile::camera_height() const {
  return -x[foot] / std::sqrt(1.0 + slope() * slope() + cross_slope() * cross_slope());
}

DrivenProfile fit_driven_profile(const ProfileMeasurements& measured, double metres_per_baseline,
                                 const EgoPlaneOptions& options) {
  return ProfileFit(measured, metres_per_baseline, options).run();
}

}  // namespace camber::detail
