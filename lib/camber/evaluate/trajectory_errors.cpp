#include "camber/evaluate/trajectory_errors.h"

#include <Eigen/Geometry>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <stdexcept>

#include "camber/core/errors.h"
#include "camber/geometry/plane.h"

namespace camber {
namespace {

using Eigen::Matrix3d;
using Eigen::Matrix3Xd;
using Eigen::Vector3d;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

double angle_of(const SE3& motion) { return rotation_to_vector(motion.rotation()).norm(); }

double sorted_quantile(const std::vector<double>& sorted, double share) {
  if (sorted.empty()) return kNaN;
  const double at = share * static_cast<double>(sorted.size() - 1);
  const auto below = static_cast<std::size_t>(at);
  const std::size_t above = std::min(below + 1, sorted.size() - 1);
  return sorted[below] + (at - static_cast<double>(below)) * (sorted[above] - sorted[below]);
}

double quantile(std::vector<double> values, double share) {
  std::sort(values.begin(), values.end());
  return sorted_quantile(values, share);
}

/// The truth's path from the first frame to each, m.
std::vector<double> travelled(const std::vector<ComparedPose>& poses) {
  std::vector<double> out(poses.size(), 0.0);
  for (std::size_t i = 1; i < poses.size(); ++i) {
    out[i] = out[i - 1] + (poses[i].truth.translation() - poses[i - 1].truth.translation()).norm();
  }
  return out;
}

/// Sums over sub-paths of one length.
struct Sums {
  int count = 0, unanswered = 0;
  double translation = 0.0, rotation = 0.0;
};

SubPathErrors means_of(const Sums& sums, double length) {
  SubPathErrors out;
  out.length = length;
  out.count = sums.count;
  out.unanswered = sums.unanswered;
  if (sums.count > 0) {
    out.translation = sums.translation / sums.count;
    out.rotation = sums.rotation / sums.count;
  }
  return out;
}

Sums sub_paths(const std::vector<ComparedPose>& poses, const std::vector<double>& path,
               double length, int every) {
  Sums out;
  std::size_t last = 0;
  for (std::size_t first = 0; first < poses.size(); first += static_cast<std::size_t>(every)) {
    while (last < poses.size() && !(path[last] > path[first] + length)) ++last;
    if (last == poses.size()) break;
    if (!poses[first].estimate || !poses[last].estimate) {
      ++out.unanswered;
      continue;
    }
    const SE3 truth = poses[first].truth.inverse() * poses[last].truth;
    const SE3 estimate = poses[first].estimate->inverse() * *poses[last].estimate;
    const SE3 error = estimate.inverse() * truth;
    out.translation += error.translation().norm() / length;
    out.rotation += angle_of(error) / length;
    ++out.count;
  }
  return out;
}

OdometryErrors odometry_errors(const std::vector<ComparedPose>& poses,
                               const std::vector<double>& path, int every,
                               const TrajectoryErrorOptions& options) {
  OdometryErrors out;
  out.every = every;
  Sums all;
  for (const double length : options.sub_paths) {
    const Sums sums = sub_paths(poses, path, length, every);
    if (sums.count + sums.unanswered > 0) out.by_length.push_back(means_of(sums, length));
    all.count += sums.count;
    all.unanswered += sums.unanswered;
    all.translation += sums.translation;
    all.rotation += sums.rotation;
  }
  out.all = means_of(all, 0.0);
  if (path.back() > 0.0 && path.back() < options.short_drive) {
    const double half = 0.5 * path.back();
    out.half = means_of(sub_paths(poses, path, half, every), half);
  }
  return out;
}

struct Lengths {
  double truth = 0.0, estimate = 0.0;
};

/// Of the steps from posed frame to posed frame in [first, last].
Lengths lengths_of(const std::vector<ComparedPose>& poses, std::size_t first, std::size_t last) {
  Lengths out;
  const ComparedPose* before = nullptr;
  for (std::size_t i = first; i <= last; ++i) {
    if (!poses[i].estimate) continue;
    if (before) {
      out.truth += (poses[i].truth.translation() - before->truth.translation()).norm();
      out.estimate += (poses[i].estimate->translation() - before->estimate->translation()).norm();
    }
    before = &poses[i];
  }
  return out;
}

double log_ratio(double value, double truth) {
  return value > 0.0 && truth > 0.0 ? std::log(value / truth) : kNaN;
}

/// Fills what the windows give together.
void summarise(const TrajectoryErrorOptions& options, WindowErrors* out) {
  const std::vector<WindowError>& windows = out->windows;
  out->mean = out->deviation = out->p95 = out->close = out->within_2_sigma = out->own_spread = kNaN;
  if (windows.empty()) return;
  const auto count = static_cast<double>(windows.size());
  double sum = 0.0, squares = 0.0;
  int close = 0, inside = 0;
  std::vector<double> sizes;
  for (const WindowError& w : windows) {
    sum += w.error;
    sizes.push_back(std::abs(w.error));
    close += std::abs(w.error) <= options.close_window ? 1 : 0;
    if (!std::isfinite(w.sigma)) continue;
    ++out->with_sigma;
    inside += std::abs(w.error) <= 2.0 * w.sigma ? 1 : 0;
  }
  out->mean = sum / count;
  for (const WindowError& w : windows) squares += std::pow(w.error - out->mean, 2);
  if (windows.size() > 1) out->deviation = std::sqrt(squares / (count - 1.0));
  out->p95 = quantile(sizes, 0.95);
  out->close = close / count;
  if (out->with_sigma > 0) out->within_2_sigma = static_cast<double>(inside) / out->with_sigma;
  const double common = std::isfinite(options.common_sigma) ? options.common_sigma : 0.0;
  double own_squares = 0.0;
  int own = 0;
  for (const WindowError& w : windows) {
    const double variance = w.sigma * w.sigma - common * common;
    if (!(variance > 0.0)) continue;
    own_squares += std::pow(w.error - out->mean, 2) / variance;
    ++own;
  }
  if (own > 1) out->own_spread = std::sqrt(own_squares / (own - 1.0));
}

void add_window(const std::vector<ComparedPose>& poses, std::size_t first, std::size_t last,
                double sigma, const TrajectoryErrorOptions& options, WindowErrors* out) {
  if (!poses[first].estimate || !poses[last].estimate) {
    ++out->unanswered;
    return;
  }
  const Lengths lengths = lengths_of(poses, first, last);
  if (!(lengths.truth >= options.least_length)) {
    ++out->stationary;
    return;
  }
  WindowError window;
  window.first = poses[first].id;
  window.last = poses[last].id;
  window.true_length = lengths.truth;
  window.length = lengths.estimate;
  // An estimate that stands where the camera moves is infinitely too short.
  window.error = lengths.estimate > 0.0 ? std::log(lengths.estimate / lengths.truth)
                                        : -std::numeric_limits<double>::infinity();
  window.sigma = sigma;
  out->windows.push_back(window);
}

WindowErrors window_errors(const std::vector<ComparedPose>& poses,
                           const TrajectoryErrorOptions& options) {
  WindowErrors out;
  if (options.windows.empty()) {
    std::size_t first = 0;
    while (first < poses.size() && !poses[first].estimate) ++first;
    const auto steps = static_cast<std::size_t>(options.window);
    for (; first + steps < poses.size(); first += static_cast<std::size_t>(options.window_every)) {
      add_window(poses, first, first + steps, kNaN, options, &out);
    }
  }
  const auto index_of = [&](int id) {
    const auto at = std::lower_bound(poses.begin(), poses.end(), id,
                                     [](const ComparedPose& p, int value) { return p.id < value; });
    return at != poses.end() && at->id == id ? static_cast<std::size_t>(at - poses.begin())
                                             : poses.size();
  };
  for (const StatedLength& window : options.windows) {
    const std::size_t first = index_of(window.first), last = index_of(window.last);
    if (first == poses.size() || last == poses.size()) continue;  // no truth there
    add_window(poses, first, last, window.sigma, options, &out);
  }
  summarise(options, &out);
  return out;
}

/// @param truth_from_estimate  a similarity
AlignedErrors aligned_errors(const std::vector<const ComparedPose*>& posed,
                             const Eigen::Matrix4d& truth_from_estimate) {
  AlignedErrors out;
  const Matrix3d linear = truth_from_estimate.topLeftCorner<3, 3>();
  const Vector3d shift = truth_from_estimate.topRightCorner<3, 1>();
  out.scale = std::cbrt(linear.determinant());
  std::vector<double> distances;
  double sum = 0.0, squares = 0.0;
  for (const ComparedPose* pose : posed) {
    const double d =
        (linear * pose->estimate->translation() + shift - pose->truth.translation()).norm();
    distances.push_back(d);
    sum += d;
    squares += d * d;
  }
  const auto count = static_cast<double>(posed.size());
  out.ate_mean = sum / count;
  out.ate_rmse = std::sqrt(squares / count);
  out.ate_median = quantile(distances, 0.5);
  out.ate_max = quantile(distances, 1.0);
  double translations = 0.0, rotations = 0.0;
  for (std::size_t i = 1; i < posed.size(); ++i) {
    const SE3 truth = posed[i - 1]->truth.inverse() * posed[i]->truth;
    SE3 estimate = posed[i - 1]->estimate->inverse() * *posed[i]->estimate;
    estimate.set_translation(out.scale * estimate.translation());
    const SE3 error = truth.inverse() * estimate;
    translations += error.translation().squaredNorm();
    rotations += std::pow(angle_of(error), 2);
  }
  out.rpe_translation = std::sqrt(translations / (count - 1.0));
  out.rpe_rotation = std::sqrt(rotations / (count - 1.0));
  return out;
}

Vector3d step_in_camera(const SE3& from, const SE3& to) {
  return (from.inverse() * to).translation();
}

}  // namespace

void TrajectoryErrorOptions::validate() const {
  const auto refuse = [](const std::string& what) { throw std::invalid_argument(what); };
  for (const double length : sub_paths) {
    if (!(length > 0.0) || !std::isfinite(length)) {
      refuse("sub_paths: found " + std::to_string(length) + ", expected positive numbers of m");
    }
  }
  for (const auto& [name, value] :
       {std::pair{"every", every}, {"window", window}, {"window_every", window_every}}) {
    if (value < 1) {
      refuse(std::string(name) + ": found " + std::to_string(value) + ", expected at least 1");
    }
  }
  if (!(least_length > 0.0)) refuse("least_length: expected a positive number of m");
}

TrajectoryErrors trajectory_errors(const std::vector<ComparedPose>& poses,
                                   const TrajectoryErrorOptions& options) {
  options.validate();
  std::vector<const ComparedPose*> posed;
  for (const ComparedPose& pose : poses) {
    if (pose.estimate) posed.push_back(&pose);
  }
  if (posed.size() < 2) {
    throw NoAnswerError("found " + std::to_string(posed.size()) +
                        " frames with a pose and a true pose, expected at least 2");
  }
  TrajectoryErrors out;
  out.frames = static_cast<int>(poses.size());
  out.posed = static_cast<int>(posed.size());
  const Lengths lengths = lengths_of(poses, 0, poses.size() - 1);
  out.true_length = lengths.truth;
  out.length = lengths.estimate;
  out.length_error = log_ratio(lengths.estimate, lengths.truth);
  out.length_sigma = options.length_sigma;
  const std::vector<double> path = travelled(poses);
  out.every_nth = odometry_errors(poses, path, options.every, options);
  out.every_frame = odometry_errors(poses, path, 1, options);
  out.windows = window_errors(poses, options);

  const auto count = static_cast<Eigen::Index>(posed.size());
  Matrix3Xd from(3, count), to(3, count);
  for (Eigen::Index i = 0; i < count; ++i) {
    from.col(i) = posed[static_cast<std::size_t>(i)]->estimate->translation();
    to.col(i) = posed[static_cast<std::size_t>(i)]->truth.translation();
  }
  out.unaligned = aligned_errors(posed, (posed[0]->truth * posed[0]->estimate->inverse()).matrix());
  out.rigid = aligned_errors(posed, Eigen::umeyama(from, to, false));
  const Matrix3Xd centred = from.colwise() - from.rowwise().mean();
  // Without motion in the estimate no scale brings it to the truth.
  out.with_scale = centred.squaredNorm() > 0.0
                       ? aligned_errors(posed, Eigen::umeyama(from, to, true))
                       : out.rigid;
  return out;
}

std::string remark_on_frame(const std::vector<ComparedPose>& poses) {
  constexpr double kLeastStep = 0.05;                 // m: of which the direction is known
  constexpr double kFits = 0.0873, kDiffers = 0.349;  // rad: 5 and 20 degrees
  std::vector<Vector3d> truth, estimate, inverse;     // directions of the steps
  for (std::size_t i = 1; i < poses.size(); ++i) {
    if (!poses[i - 1].estimate || !poses[i].estimate) continue;
    const SE3 &a = *poses[i - 1].estimate, &b = *poses[i].estimate;
    const Vector3d true_step = step_in_camera(poses[i - 1].truth, poses[i].truth);
    const Vector3d step = step_in_camera(a, b);
    const Vector3d inverse_step = step_in_camera(a.inverse(), b.inverse());
    if (true_step.norm() < kLeastStep || step.norm() < 1e-9 || inverse_step.norm() < 1e-9) continue;
    truth.push_back(true_step.normalized());
    estimate.push_back(step.normalized());
    inverse.push_back(inverse_step.normalized());
  }
  if (truth.size() < 2) return {};
  const auto median_angle = [&](const std::vector<Vector3d>& steps, const Matrix3d& turn) {
    std::vector<double> angles;
    for (std::size_t i = 0; i < steps.size(); ++i) {
      angles.push_back(angle_between(turn * truth[i], steps[i]));
    }
    return quantile(angles, 0.5);
  };
  if (!(median_angle(estimate, Matrix3d::Identity()) > kDiffers)) return {};
  if (median_angle(inverse, Matrix3d::Identity()) < kFits) {
    return "found poses whose inverses move as the true ones do, expected world_from_camera (these "
           "look like camera_from_world)";
  }
  Matrix3d products = Matrix3d::Zero();
  for (std::size_t i = 0; i < truth.size(); ++i) products += estimate[i] * truth[i].transpose();
  const Eigen::JacobiSVD<Matrix3d> svd(products, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Vector3d signs(1.0, 1.0, (svd.matrixU() * svd.matrixV().transpose()).determinant());
  const Matrix3d turn = svd.matrixU() * signs.asDiagonal() * svd.matrixV().transpose();
  if (!(median_angle(estimate, turn) < kFits)) return {};
  Vector3d mean = Vector3d::Zero();
  for (const Vector3d& step : estimate) mean += step;
  Eigen::Index axis = 0;
  mean.cwiseAbs().maxCoeff(&axis);
  const std::string name = std::string(mean[axis] < 0.0 ? "-" : "+") + "xyz"[axis];
  return "found poses of turned axes that move along their " + name +
         " axis, expected those of the camera (x right, y down, z forward)";
}

}  // namespace camber
