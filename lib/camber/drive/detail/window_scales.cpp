#include "camber/drive/detail/window_scales.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <optional>
#include <utility>

#include "camber/core/median.h"
#include "camber/road/detail/banded_ldlt.h"

namespace camber::detail {
namespace {

constexpr Eigen::Index kPose = 6;

/// Windows that know their scale; where some know metres, only those.
void choose_votes(const TrajectoryNoise& noise, std::vector<Measurement>* measured) {
  bool metric = false;
  for (Measurement& m : *measured) {
    const WindowMeasurement& w = *m.window;
    m.votes = w.log_scale && std::isfinite(*w.log_scale) &&
              std::hypot(w.scale_sigma, w.common_scale_sigma) <= noise.weakest_scale;
    metric = metric || (m.votes && w.metric);
  }
  for (Measurement& m : *measured) m.votes = m.votes && m.window->metric == metric;
  // Errors of an autoregressive process: a mean's variance is so much larger than of as many
  // independent ones.
  constexpr double kLeast = 1e-3;
  for (auto m = measured->begin(); m != measured->end(); ++m) {
    const auto add = [&](const Measurement& other) {
      const auto away =
          std::abs(static_cast<double>(other.place()) - static_cast<double>(m->place()));
      const double share = std::pow(noise.scale_correlation, away);
      if (other.votes) m->alike += share;
      return share > kLeast;
    };
    for (auto other = m; other != measured->begin() && add(*--other);) {
    }
    for (auto other = std::next(m); other != measured->end() && add(*other); ++other) {
    }
  }
}

/// Whether a window's motion is what its type promises; one that is not would carry all poses away.
bool has_sound_motion(const WindowMeasurement& w) {
  constexpr double kMost = 2.0;  // baselines: the longest has length 1, but for its noise
  const auto size = static_cast<Eigen::Index>(w.frame_from_reference.size());
  if (size < 2 || w.covariance.rows() != kPose * (size - 1)) return false;
  if (w.covariance.cols() != w.covariance.rows() || !w.covariance.allFinite()) return false;
  return std::all_of(
      w.frame_from_reference.begin(), w.frame_from_reference.end(), [](const SE3& pose) {
        return pose.rotation().coeffs().allFinite() && pose.translation().norm() <= kMost;
      });
}

Eigen::Vector3d center_in_reference(const WindowMeasurement& w, std::size_t k) {
  return w.frame_from_reference[k].inverse().translation();
}

/// Logarithm by which two windows' lengths between frames that both have differ; nothing where no
/// two are in both or they stand.
std::optional<double> log_length_ratio(const WindowMeasurement& a, const WindowMeasurement& b) {
  std::vector<std::pair<std::size_t, std::size_t>> both;
  for (std::size_t i = 0; i < a.frames.size(); ++i) {
    const auto found = std::find(b.frames.begin(), b.frames.end(), a.frames[i]);
    if (found != b.frames.end()) both.emplace_back(i, found - b.frames.begin());
  }
  if (both.size() < 2) return std::nullopt;
  const auto length = [&](const WindowMeasurement& w, std::size_t i, std::size_t j) {
    return (center_in_reference(w, i) - center_in_reference(w, j)).norm();
  };
  const double in_a = length(a, both.front().first, both.back().first);
  const double in_b = length(b, both.front().second, both.back().second);
  if (!(in_a > 1e-3) || !(in_b > 1e-3)) return std::nullopt;
  return std::log(in_a / in_b);
}

}  // namespace

double student_weight(double squared, double dimension, double freedom) {
  return (freedom + dimension) / (freedom + squared);
}

std::vector<Measurement> measurements_of(const std::vector<int>& ids,
                                         const std::vector<WindowMeasurement>& windows,
                                         const TrajectoryNoise& noise) {
  std::vector<Measurement> out;
  for (const WindowMeasurement& window : windows) {
    if (!has_sound_motion(window)) continue;
    Measurement m;
    m.window = &window;
    m.reference = window.index_of_reference();
    for (const int id : window.frames) {
      const auto found = std::lower_bound(ids.begin(), ids.end(), id);
      m.at.push_back(static_cast<std::size_t>(found - ids.begin()));
    }
    Eigen::MatrixXd covariance = noise.motion_inflation * window.covariance;
    for (Eigen::Index i = 0; i < covariance.rows(); ++i) {
      const double floor = i % kPose < 3 ? noise.rotation_floor : noise.translation_floor;
      covariance(i, i) += floor * floor;
    }
    m.covariance = std::move(covariance);
    out.push_back(std::move(m));
  }
  choose_votes(noise, &out);
  return out;
}

double common_sigma(const std::vector<Measurement>& measured) {
  std::vector<double> common;
  for (const Measurement& m : measured) {
    if (m.votes) common.push_back(m.window->common_scale_sigma);
  }
  return common.empty() ? 0.0 : upper_median(&common);
}

std::vector<double> start_scales(const std::vector<Measurement>& measured,
                                 const TrajectoryNoise& noise) {
  constexpr double kRatioSigma = 0.02;  // of a length in two windows
  constexpr int kIterations = 30;
  const std::size_t count = measured.size();
  struct Tie {
    std::size_t a, b;
    double difference;  // scale of b less that of a
  };
  std::vector<Tie> ties;
  std::size_t band = 1;
  for (std::size_t i = 0; i < count; ++i) {
    for (std::size_t j = i + 1; j < std::min(count, i + 3); ++j) {
      const auto ratio = log_length_ratio(*measured[i].window, *measured[j].window);
      if (!ratio) continue;
      ties.push_back({i, j, *ratio});
      band = std::max(band, j - i);
    }
  }
  std::vector<double> scale(count, 0.0);
  for (std::size_t i = 0; i < count; ++i) {
    if (measured[i].votes) scale[i] = *measured[i].window->log_scale;
  }
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    SymmetricBand normal(static_cast<Eigen::Index>(count), static_cast<Eigen::Index>(band));
    Eigen::VectorXd right = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(count));
    for (std::size_t i = 0; i < count; ++i) {
      const auto at = static_cast<Eigen::Index>(i);
      const WindowMeasurement& w = *measured[i].window;
      double information = 1e-8;
      if (measured[i].votes) {
        const double variance =
            w.scale_sigma * w.scale_sigma + noise.scale_floor * noise.scale_floor;
        const double off = scale[i] - *w.log_scale;
        information =
            (iteration == 0 ? 1.0
                            : student_weight(off * off / variance, 1.0, noise.scale_freedom)) /
            variance;
      }
      normal.at(at, at) += information;
      if (measured[i].votes) right[at] += information * *w.log_scale;
    }
    for (const Tie& tie : ties) {
      const auto a = static_cast<Eigen::Index>(tie.a), b = static_cast<Eigen::Index>(tie.b);
      const double off = (scale[tie.b] - scale[tie.a] - tie.difference) / kRatioSigma;
      const double information =
          (iteration == 0 ? 1.0 : student_weight(off * off, 1.0, noise.motion_freedom)) /
          (kRatioSigma * kRatioSigma);
      normal.at(a, a) += information;
      normal.at(b, b) += information;
      normal.at(b, a) -= information;
      right[b] += information * tie.difference;
      right[a] -= information * tie.difference;
    }
    BandedLdlt factor;
    if (!factor.factorise(std::move(normal))) break;
    const Eigen::VectorXd solved = factor.solve_vector(right);
    for (std::size_t i = 0; i < count; ++i) scale[i] = solved[static_cast<Eigen::Index>(i)];
  }
  return scale;
}

}  // namespace camber::detail
