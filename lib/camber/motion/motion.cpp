#include "camber/motion/motion.h"

#include <Eigen/Cholesky>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <opencv2/calib3d.hpp>
#include <optional>
#include <stdexcept>

#include "camber/core/median.h"
#include "camber/core/random.h"
#include "camber/core/threads.h"
#include "camber/motion/detail/spread_points.h"
#include "camber/motion/reduced_bundle.h"

namespace camber {
namespace {

using detail::spread_points;

constexpr double kLeastInverseDepth = 1e-5, kMostInverseDepth = 10.0;  // 1/baseline, of a point
constexpr double kRoughPoses = 2.0;  // times inlier_px, before the bundle adjustment

double quantile(std::vector<double> values, double share) {
  if (values.empty()) return std::numeric_limits<double>::quiet_NaN();
  const auto at =
      values.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

/// The usable points that an image shows.
std::vector<std::uint8_t> seen_in(const MatchedImage& match, std::vector<std::uint8_t> usable) {
  for (std::size_t i = 0; i < usable.size(); ++i) {
    if (!std::isfinite(match.round_trip_px[i])) usable[i] = 0;
  }
  return usable;
}

/// Rotation that best explains matched rays with no translation: iteratively reweighted Kabsch.
Eigen::Matrix3d best_rotation(const PinholeCamera& camera, const std::vector<Eigen::Vector2d>& from,
                              const std::vector<Eigen::Vector2d>& to) {
  std::vector<double> weights(from.size(), 1.0);
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
  for (int iteration = 0; iteration < 10; ++iteration) {
    Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
    for (std::size_t i = 0; i < from.size(); ++i) {
      sum += weights[i] * camera.ray(to[i]).normalized() *
             camera.ray(from[i]).normalized().transpose();
    }
    const Eigen::JacobiSVD<Eigen::Matrix3d> svd(sum, Eigen::ComputeFullU | Eigen::ComputeFullV);
    Eigen::Matrix3d sign = Eigen::Matrix3d::Identity();
    sign(2, 2) = (svd.matrixU() * svd.matrixV().transpose()).determinant() < 0 ? -1.0 : 1.0;
    rotation = svd.matrixU() * sign * svd.matrixV().transpose();
    for (std::size_t i = 0; i < from.size(); ++i) {
      const auto p = camera.project(rotation * camera.ray(from[i]));
      const double error = p ? (*p - to[i]).norm() : 1e3;
      weights[i] = 1.0 / (1.0 + error * error);  // Cauchy, 1 px
    }
  }
  return rotation;
}

/// Inverse depth of a reference ray from one other view, linearised least squares in the image;
/// NaN where it does not converge in front of both cameras.
double inverse_depth_from(const PinholeCamera& camera, const SE3& frame_from_reference,
                          const Eigen::Vector3d& ray, const Eigen::Vector2d& pixel) {
  const Eigen::Vector3d a = frame_from_reference.rotation() * ray;
  const Eigen::Vector3d t = frame_from_reference.translation();
  // (a + rho t) x (x, y, 1) = 0, two rows in normalised coordinates.
  const Eigen::Vector3d z = camera.ray(pixel);
  const double b0 = t.x() - z.x() * t.z(), b1 = t.y() - z.y() * t.z();
  const double e0 = z.x() * a.z() - a.x(), e1 = z.y() * a.z() - a.y();
  const double den = b0 * b0 + b1 * b1;
  if (den < 1e-14) return std::numeric_limits<double>::quiet_NaN();
  return (b0 * e0 + b1 * e1) / den;
}

/// Marks the motion as failed, with the reason.
void fail(MotionEstimate& out, const std::string& reason) {
  out.status = Status::kFailed;
  out.reason = reason;
}

/// Poses of the matched images, in the order of the matches.
std::vector<SE3> matched_poses(const Correspondences& matches, const MotionEstimate& motion) {
  std::vector<SE3> views;
  for (const MatchedImage& match : matches.matches) {
    views.push_back(motion.frame_from_reference[static_cast<std::size_t>(match.frame)]);
  }
  return views;
}

/// The view that is farthest from the reference.
std::size_t longest_baseline(const std::vector<SE3>& views) {
  std::size_t longest = 0;
  double length = 0.0;
  for (std::size_t m = 0; m < views.size(); ++m) {
    const double baseline = views[m].translation().norm();
    if (baseline > length) {
      length = baseline;
      longest = m;
    }
  }
  return longest;
}

/// Inverse depth of a grid point by the widest image; none where it does not agree with the motion.
std::optional<double> initial_inverse_depth(const PinholeCamera& camera,
                                            const Correspondences& matches,
                                            const std::vector<SE3>& views, std::size_t widest,
                                            double inlier_px, std::size_t i) {
  if (!std::isfinite(matches.matches[widest].round_trip_px[i])) return std::nullopt;
  const Eigen::Vector3d ray = camera.ray(matches.pixels[i].cast<double>());
  const Eigen::Vector2d z = matches.matches[widest].pixels[i].cast<double>();
  const double rho = inverse_depth_from(camera, views[widest], ray, z);
  if (!std::isfinite(rho)) return std::nullopt;
  // Near the focus of expansion the depth is unknown, yet the point constrains the rotation.
  const double used = std::clamp(rho, kLeastInverseDepth, kMostInverseDepth);
  const auto p =
      camera.project(views[widest].rotation() * ray + used * views[widest].translation());
  if (!p || (*p - z).norm() > kRoughPoses * inlier_px) return std::nullopt;
  // A wrong match may lie behind a camera that is farther ahead.
  for (std::size_t m = 0; m < views.size(); ++m) {
    if (std::isfinite(matches.matches[m].round_trip_px[i]) &&
        !((views[m].rotation() * ray + used * views[m].translation()).z() > 1e-3)) {
      return std::nullopt;
    }
  }
  return used;
}

/// Grid points whose matches agree with the motion.
struct AgreeingPoints {
  std::vector<std::uint8_t> agrees;   // one a grid point
  std::vector<double> inverse_depth;  // one a grid point, of those that agree
};

AgreeingPoints agreeing_points(const PinholeCamera& camera, const Correspondences& matches,
                               const std::vector<std::uint8_t>& usable,
                               const std::vector<SE3>& views, std::size_t widest,
                               const MotionOptions& options) {
  AgreeingPoints out{std::vector<std::uint8_t>(usable.size(), 0),
                     std::vector<double>(usable.size(), 0.0)};
  parallel_for(static_cast<std::size_t>(matches.rows), options.num_threads, [&](std::size_t row) {
    const auto columns = static_cast<std::size_t>(matches.columns);
    for (std::size_t i = row * columns; i < (row + 1) * columns; ++i) {
      if (!usable[i]) continue;
      const auto rho = initial_inverse_depth(camera, matches, views, widest, options.inlier_px, i);
      if (!rho) continue;
      out.agrees[i] = 1;
      out.inverse_depth[i] = *rho;
    }
  });
  return out;
}

/// The problem of the chosen grid points in all images that show them.
BundleProblem make_bundle(const PinholeCamera& camera, const Correspondences& matches,
                          const std::vector<int>& chosen, int num_threads) {
  BundleProblem problem;
  problem.camera = camera;
  problem.num_threads = num_threads;
  for (const int grid : chosen) {
    const auto at = static_cast<std::size_t>(grid);
    for (std::size_t m = 0; m < matches.matches.size(); ++m) {
      const MatchedImage& match = matches.matches[m];
      if (!std::isfinite(match.round_trip_px[at])) continue;
      problem.observations.push_back({static_cast<int>(problem.rays.size()), static_cast<int>(m),
                                      match.pixels[at].cast<double>()});
    }
    problem.rays.push_back(camera.ray(matches.pixels[at].cast<double>()));
  }
  return problem;
}

/// Noise of a coordinate from the residuals (median absolute deviation), px.
double coordinate_noise(const BundleProblem& problem, const std::vector<SE3>& views,
                        const std::vector<double>& depths) {
  const Eigen::Matrix2Xd errors = bundle_residuals(problem, views, depths);
  std::vector<double> residuals;
  for (Eigen::Index k = 0; k < errors.size(); ++k) {
    if (std::isfinite(errors(k))) residuals.push_back(std::abs(errors(k)));
  }
  // The depths absorb one of the 2 (n - 1) coordinates of each track.
  const auto others = static_cast<double>(views.size());
  const double freedom = std::sqrt(2.0 * others / (2.0 * others - 1.0));
  return std::max(0.02, kSigmaFromMad * upper_median(residuals) * freedom);
}

/// Covariance of the views from the reduced system, in which the baseline of `longest` is the unit.
Eigen::MatrixXd motion_covariance(const BundleProblem& problem, const std::vector<SE3>& views,
                                  const std::vector<double>& depths, std::size_t longest,
                                  double pixel_sigma, double correlation) {
  constexpr double kUnitInformation = 1e12, kRegularisation = 1e-6;
  Eigen::MatrixXd information = reduce_bundle(problem, views, depths, pixel_sigma).information;
  const Eigen::Vector3d axis = views[longest].translation();
  const auto at_longest = static_cast<Eigen::Index>(6 * longest + 3);
  information.block<3, 3>(at_longest, at_longest) += kUnitInformation * axis * axis.transpose();
  information.diagonal().array() += kRegularisation;
  const Eigen::Index n = information.rows();
  return correlation * information.ldlt().solve(Eigen::MatrixXd::Identity(n, n));
}

/// Bundle adjustment from the poses in `out`: poses and inverse depths of a spread choice of
/// points; fills status, poses, covariance, pixel_sigma and points.
void bundle_adjust(const PinholeCamera& camera, const Correspondences& matches,
                   const std::vector<std::uint8_t>& usable, std::size_t widest,
                   const MotionOptions& options, MotionEstimate& out) {
  std::vector<SE3> views = matched_poses(matches, out);
  const AgreeingPoints points = agreeing_points(camera, matches, usable, views, widest, options);
  const std::vector<int> chosen = spread_points(matches, points.agrees, options.max_bundle_points);
  if (chosen.size() < 30) {
    return fail(out, "too little texture: " + std::to_string(chosen.size()) +
                         " static points agree with the motion, expected at least 30");
  }
  constexpr double kStartSigma = 0.3;  // px, typical of the flow; re-estimated below
  const BundleProblem problem = make_bundle(camera, matches, chosen, options.num_threads);
  std::vector<double> depths;
  for (const int grid : chosen) {
    depths.push_back(points.inverse_depth[static_cast<std::size_t>(grid)]);
  }
  if (!solve_bundle(problem, widest, kStartSigma, views, depths)) {
    return fail(out, "the bundle adjustment did not converge");
  }

  // Unit: the longest baseline.
  const std::size_t longest = longest_baseline(views);
  const double length = views[longest].translation().norm();
  if (!(length > 0)) return fail(out, "the bundle adjustment found no baseline");
  for (std::size_t m = 0; m < views.size(); ++m) {
    views[m].set_translation(views[m].translation() / length);
    out.frame_from_reference[static_cast<std::size_t>(matches.matches[m].frame)] = views[m];
  }
  for (double& rho : depths) rho *= length;

  out.pixel_sigma = coordinate_noise(problem, views, depths);
  out.covariance = motion_covariance(problem, views, depths, longest, out.pixel_sigma,
                                     options.noise.correlation);
  out.points = static_cast<int>(chosen.size());
  out.status = Status::kOk;
}

/// The largest of the positions' changes, longest baselines.
double largest_change(const std::vector<SE3>& before, const std::vector<SE3>& after) {
  double change = 0.0;
  for (std::size_t m = 0; m < before.size(); ++m) {
    change = std::max(change, (after[m].translation() - before[m].translation()).norm());
  }
  return change;
}

/// Bundle adjustments until the motion stays, each of the points that agree with the one before:
/// those that agree with a wrong start keep it. One that fails changes nothing.
void adjust_until_settled(const PinholeCamera& camera, const Correspondences& matches,
                          const std::vector<std::uint8_t>& usable, const MotionOptions& options,
                          MotionEstimate& out) {
  constexpr int kMost = 10;
  constexpr double kSettled = 0.0005;  // longest baselines
  for (int round = 0; round < kMost && out.status == Status::kOk; ++round) {
    const std::vector<SE3> before = matched_poses(matches, out);
    MotionEstimate next = out;
    next.status = Status::kNotRun;
    bundle_adjust(camera, matches, usable, longest_baseline(before), options, next);
    if (next.status != Status::kOk) return;
    out = std::move(next);
    if (largest_change(before, matched_poses(matches, out)) < kSettled) return;
  }
}

/// The row of Correspondences::matches with the widest median motion among points that are seen in
/// it; none (and why) for an image without texture or a camera that stands.
std::optional<std::size_t> widest_image(const Correspondences& matches,
                                        const std::vector<std::uint8_t>& usable,
                                        const MotionOptions& options, MotionEstimate& out) {
  std::size_t widest = 0;
  double widest_motion = -1.0;
  for (std::size_t k = 0; k < matches.matches.size(); ++k) {
    const MatchedImage& match = matches.matches[k];
    std::vector<double> lengths;
    for (const int i : spread_points(matches, seen_in(match, usable), 1000)) {
      const auto at = static_cast<std::size_t>(i);
      lengths.push_back((match.pixels[at] - matches.pixels[at]).cast<double>().norm());
    }
    if (lengths.size() < 40) {
      fail(out, "too little texture: " + std::to_string(lengths.size()) +
                    " matched points between two images, expected at least 40");
      return std::nullopt;
    }
    const double motion = upper_median(lengths);
    if (motion > widest_motion) {
      widest_motion = motion;
      widest = k;
    }
  }
  if (widest_motion < options.stationary_px) {
    fail(out,
         "the camera stands still: median image motion " + std::to_string(widest_motion) + " px");
    return std::nullopt;
  }
  return widest;
}

/// Matches of the reference with one image, spread over the reference.
struct PairSample {
  std::vector<int> grid;  ///< grid points
  std::vector<Eigen::Vector2d> from, to;
};

PairSample sample_pair(const Correspondences& matches, const std::vector<std::uint8_t>& usable,
                       std::size_t other, int count) {
  const MatchedImage& match = matches.matches[other];
  PairSample sample;
  sample.grid = spread_points(matches, seen_in(match, usable), count);
  for (const int i : sample.grid) {
    const auto at = static_cast<std::size_t>(i);
    sample.from.push_back(matches.pixels[at].cast<double>());
    sample.to.push_back(match.pixels[at].cast<double>());
  }
  return sample;
}

/// Whether the points move by more than a rotation explains.
bool has_parallax(const PinholeCamera& camera, const PairSample& sample,
                  const MotionOptions& options, MotionEstimate& out) {
  const Eigen::Matrix3d rotation = best_rotation(camera, sample.from, sample.to);
  std::vector<double> parallax;
  for (std::size_t i = 0; i < sample.from.size(); ++i) {
    const auto p = camera.project(rotation * camera.ray(sample.from[i]));
    if (p) parallax.push_back((*p - sample.to[i]).norm());
  }
  const double wide = quantile(parallax, 0.9);
  if (wide > options.parallax_px) return true;
  fail(out, "no parallax: the camera only turns (90 % of the points move less than " +
                std::to_string(wide) + " px beyond a rotation)");
  return false;
}

cv::Matx33d calibration_matrix(const PinholeCamera& camera) {
  return {camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1};
}

cv::UsacParams usac_parameters(const MotionOptions& options) {
  cv::UsacParams usac;
  usac.confidence = 0.9999;
  usac.isParallel = false;
  usac.loIterations = 10;
  usac.loMethod = cv::LOCAL_OPTIM_SIGMA;
  usac.loSampleSize = 50;
  usac.maxIterations = 2000;
  usac.neighborsSearch = cv::NEIGH_GRID;
  usac.randomGeneratorState = static_cast<int>(CounterRandom(options.seed, 1).bits(0) >> 33);
  usac.sampler = cv::SAMPLING_UNIFORM;
  usac.score = cv::SCORE_METHOD_MAGSAC;
  usac.threshold = options.inlier_px;
  return usac;
}

/// Robust essential matrix of the pair: writes the image's pose into `out`.
/// @return one entry a sampled match, 0 for outliers; none where nothing explains the matches.
std::optional<std::vector<std::uint8_t>> two_view_motion(
    const PinholeCamera& camera, const Correspondences& matches, const PairSample& sample,
    std::size_t other, const MotionOptions& options, MotionEstimate& out) {
  std::vector<cv::Point2d> from, to;
  for (std::size_t i = 0; i < sample.from.size(); ++i) {
    from.emplace_back(sample.from[i].x(), sample.from[i].y());
    to.emplace_back(sample.to[i].x(), sample.to[i].y());
  }
  const cv::Matx33d k = calibration_matrix(camera);
  cv::Mat mask;
  const cv::Mat no_distortion;
  const cv::Mat essential = cv::findEssentialMat(from, to, k, k, no_distortion, no_distortion, mask,
                                                 usac_parameters(options));
  if (essential.rows != 3 || essential.cols != 3) {
    fail(out, "no epipolar geometry explains the matches");
    return std::nullopt;
  }
  std::vector<std::uint8_t> inlier(sample.grid.size());
  for (std::size_t i = 0; i < inlier.size(); ++i) {
    inlier[i] = mask.at<std::uint8_t>(static_cast<int>(i));
  }
  // A few of the inliers show which of the four decompositions has them in front of both cameras.
  constexpr std::size_t kFew = 500;
  std::vector<cv::Point2d> few_from, few_to;
  const auto inliers = static_cast<std::size_t>(cv::countNonZero(mask));
  const std::size_t stride = std::max<std::size_t>(1, inliers / kFew);
  for (std::size_t i = 0, nth = 0; i < inlier.size(); ++i) {
    if (!inlier[i] || nth++ % stride != 0) continue;
    few_from.push_back(from[i]);
    few_to.push_back(to[i]);
  }
  cv::Mat r, t;
  if (few_from.size() >= 5) cv::recoverPose(essential, few_from, few_to, cv::Mat(k), r, t, 1e6);
  if (r.empty()) {
    fail(out, "no motion explains the matches");
    return std::nullopt;
  }
  Eigen::Matrix3d rotation;
  for (int i = 0; i < 9; ++i) rotation(i / 3, i % 3) = r.at<double>(i / 3, i % 3);
  const Eigen::Vector3d translation(t.at<double>(0), t.at<double>(1), t.at<double>(2));
  out.frame_from_reference[static_cast<std::size_t>(matches.matches[other].frame)] =
      SE3(rotation, translation);
  return inlier;
}

/// Inverse depths of the pair's inliers, NaN for the others; none where too few lie in front.
std::optional<std::vector<double>> two_view_depths(const PinholeCamera& camera,
                                                   const PairSample& sample,
                                                   const std::vector<std::uint8_t>& inlier,
                                                   const SE3& other_from_reference,
                                                   MotionEstimate& out) {
  std::vector<double> inverse_depths(sample.grid.size(), std::numeric_limits<double>::quiet_NaN());
  int in_front = 0;
  for (std::size_t i = 0; i < sample.grid.size(); ++i) {
    if (!inlier[i]) continue;
    const double rho =
        inverse_depth_from(camera, other_from_reference, camera.ray(sample.from[i]), sample.to[i]);
    if (!(rho > kLeastInverseDepth)) continue;
    inverse_depths[i] = rho;
    ++in_front;
  }
  out.inlier_ratio = static_cast<double>(in_front) / static_cast<double>(sample.grid.size());
  if (in_front < 30 || out.inlier_ratio < 0.15) {
    fail(out, "no motion explains the matches: " + std::to_string(in_front) + " of " +
                  std::to_string(sample.grid.size()) + " agree on one");
    return std::nullopt;
  }
  return inverse_depths;
}

/// Pose of a further image by resection (PnP) on the pair's points, into `out`.
bool resect(const PinholeCamera& camera, const MatchedImage& match, const PairSample& sample,
            const std::vector<double>& inverse_depths, const MotionOptions& options,
            MotionEstimate& out) {
  std::vector<cv::Point3d> points;
  std::vector<cv::Point2d> pixels;
  for (std::size_t i = 0; i < sample.grid.size(); ++i) {
    const auto at = static_cast<std::size_t>(sample.grid[i]);
    if (!std::isfinite(inverse_depths[i]) || !std::isfinite(match.round_trip_px[at])) continue;
    const Eigen::Vector3d x = camera.ray(sample.from[i]) / inverse_depths[i];
    points.emplace_back(x.x(), x.y(), x.z());
    pixels.emplace_back(match.pixels[at].x(), match.pixels[at].y());
  }
  if (points.size() < 20) {
    fail(out, "image " + std::to_string(match.frame) + " shares " + std::to_string(points.size()) +
                  " points with the others, expected at least 20");
    return false;
  }
  cv::UsacParams usac = usac_parameters(options);
  usac.threshold = kRoughPoses * options.inlier_px;
  usac.maxIterations = 500;
  cv::Mat k(calibration_matrix(camera));
  cv::Mat rvec, tvec, mask;
  if (!cv::solvePnPRansac(points, pixels, k, cv::noArray(), rvec, tvec, mask, usac)) {
    fail(out, "image " + std::to_string(match.frame) + " cannot be placed on the points");
    return false;
  }
  const Eigen::Vector3d v(rvec.at<double>(0), rvec.at<double>(1), rvec.at<double>(2));
  const SE3 pose(rotation_from_vector(v),
                 Eigen::Vector3d(tvec.at<double>(0), tvec.at<double>(1), tvec.at<double>(2)));
  std::size_t inliers = 0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const auto p = camera.project(pose * Eigen::Vector3d(points[i].x, points[i].y, points[i].z));
    if (p && (*p - Eigen::Vector2d(pixels[i].x, pixels[i].y)).norm() < usac.threshold) ++inliers;
  }
  constexpr std::size_t kLeast = 20;
  constexpr double kLeastShare = 0.3;
  if (inliers < kLeast ||
      static_cast<double>(inliers) < kLeastShare * static_cast<double>(points.size())) {
    fail(out, "image " + std::to_string(match.frame) +
                  " cannot be placed: " + std::to_string(inliers) + " of " +
                  std::to_string(points.size()) + " points agree on one pose");
    return false;
  }
  out.frame_from_reference[static_cast<std::size_t>(match.frame)] = pose;
  return true;
}

}  // namespace

void MotionOptions::validate() const {
  const auto positive = [](const char* name, double value, double least) {
    if (!(value >= least) || !(value > 0)) {
      throw std::invalid_argument(std::string(name) + " = " + std::to_string(value) +
                                  " is too small");
    }
  };
  positive("max_essential_points", max_essential_points, 50);
  positive("max_bundle_points", max_bundle_points, 50);
  positive("inlier_px", inlier_px, 0);
  positive("stationary_px", stationary_px, 0);
  positive("parallax_px", parallax_px, 0);
  positive("noise.correlation", noise.correlation, 1);
}

MotionEstimate estimate_motion(const PinholeCamera& camera, const Correspondences& matches,
                               const std::vector<std::uint8_t>& usable,
                               const MotionOptions& options) {
  options.validate();
  if (usable.size() != matches.pixels.size()) {
    throw std::invalid_argument("usable has " + std::to_string(usable.size()) +
                                " entries, expected one for each of " +
                                std::to_string(matches.pixels.size()) + " grid points");
  }
  MotionEstimate out;
  const std::size_t others = matches.matches.size();
  out.frame_from_reference.resize(others + 1);
  if (others == 0) {
    fail(out, "one image alone has no motion");
    return out;
  }

  const auto widest = widest_image(matches, usable, options, out);
  if (!widest) return out;
  const PairSample sample = sample_pair(matches, usable, *widest, options.max_essential_points);
  if (!has_parallax(camera, sample, options, out)) return out;
  const auto inlier = two_view_motion(camera, matches, sample, *widest, options, out);
  if (!inlier) return out;
  const auto inverse_depths = two_view_depths(
      camera, sample, *inlier,
      out.frame_from_reference[static_cast<std::size_t>(matches.matches[*widest].frame)], out);
  if (!inverse_depths) return out;
  for (std::size_t other = 0; other < others; ++other) {
    if (other == *widest) continue;
    if (!resect(camera, matches.matches[other], sample, *inverse_depths, options, out)) return out;
  }
  bundle_adjust(camera, matches, usable, *widest, options, out);
  adjust_until_settled(camera, matches, usable, options, out);
  return out;
}

namespace {

struct Agreement {
  std::size_t matched = 0, agreeing = 0;
  double share() const {
    return matched > 0 ? static_cast<double>(agreeing) / static_cast<double>(matched) : 0.0;
  }
};

void require_fitting(const Correspondences& matches, const std::vector<std::uint8_t>& usable,
                     const MotionEstimate& motion) {
  if (usable.size() != matches.pixels.size() ||
      motion.frame_from_reference.size() != matches.matches.size() + 1) {
    throw std::invalid_argument("usable or motion does not fit the correspondences");
  }
}

void add_agreement(const PinholeCamera& camera, const Correspondences& matches,
                   const std::vector<std::uint8_t>& usable, const MotionEstimate& motion, double px,
                   std::size_t other, Agreement* sum) {
  const MatchedImage& match = matches.matches[other];
  const SE3& pose = motion.frame_from_reference[static_cast<std::size_t>(match.frame)];
  for (std::size_t i = 0; i < usable.size(); ++i) {
    if (!usable[i] || !std::isfinite(match.round_trip_px[i])) continue;
    const Eigen::Vector3d ray = camera.ray(matches.pixels[i].cast<double>());
    const Eigen::Vector3d line = pose.translation().cross(pose.rotation() * ray);
    const Eigen::Vector3d seen = camera.ray(match.pixels[i].cast<double>());
    ++sum->matched;
    sum->agreeing +=
        std::abs(line.dot(seen)) < px * std::hypot(line.x() / camera.fx, line.y() / camera.fy);
  }
}

}  // namespace

double epipolar_agreement(const PinholeCamera& camera, const Correspondences& matches,
                          const std::vector<std::uint8_t>& usable, const MotionEstimate& motion,
                          double px) {
  require_fitting(matches, usable, motion);
  Agreement sum;
  for (std::size_t other = 0; other < matches.matches.size(); ++other) {
    add_agreement(camera, matches, usable, motion, px, other, &sum);
  }
  return sum.share();
}

double epipolar_agreement(const PinholeCamera& camera, const Correspondences& matches,
                          const std::vector<std::uint8_t>& usable, const MotionEstimate& motion,
                          double px, std::size_t other) {
  require_fitting(matches, usable, motion);
  if (other >= matches.matches.size()) {
    throw std::invalid_argument("other = " + std::to_string(other) + ", expected less than " +
                                std::to_string(matches.matches.size()));
  }
  Agreement sum;
  add_agreement(camera, matches, usable, motion, px, other, &sum);
  return sum.share();
}

MotionEstimate refine_motion(const PinholeCamera& camera, const Correspondences& matches,
                             const std::vector<std::uint8_t>& usable, const MotionEstimate& start,
                             const MotionOptions& options) {
  options.validate();
  if (usable.size() != matches.pixels.size() ||
      start.frame_from_reference.size() != matches.matches.size() + 1) {
    throw std::invalid_argument("usable or start does not fit the correspondences");
  }
  MotionEstimate out = start;
  out.status = Status::kNotRun;
  const std::size_t widest = longest_baseline(matched_poses(matches, start));
  bundle_adjust(camera, matches, usable, widest, options, out);
  return out;
}

MotionEstimate motion_from_known_poses(const std::vector<SE3>& frame_from_reference,
                                       std::size_t reference, const KnownPoseOptions& options) {
  MotionEstimate out;
  if (reference >= frame_from_reference.size()) {
    throw std::invalid_argument("reference = " + std::to_string(reference) +
                                ", expected an index into the poses");
  }
  std::vector<SE3> views = frame_from_reference;
  views.erase(views.begin() + static_cast<std::ptrdiff_t>(reference));
  const std::size_t unit = views.empty() ? 0 : longest_baseline(views);
  const double longest = views.empty() ? 0.0 : views[unit].translation().norm();
  if (!(longest > options.shortest_baseline)) {
    out.status = Status::kFailed;
    out.reason = "the camera stands still: the given poses are less than 2 cm apart";
    return out;
  }
  out.frame_from_reference = frame_from_reference;
  for (SE3& pose : out.frame_from_reference) pose.set_translation(pose.translation() / longest);
  const auto n = static_cast<Eigen::Index>(6 * (frame_from_reference.size() - 1));
  out.covariance = Eigen::MatrixXd::Zero(n, n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const double sigma = i % 6 < 3 ? options.rotation_sigma : options.translation_sigma / longest;
    out.covariance(i, i) = sigma * sigma;
  }
  // In units of the longest baseline its own length is exact, and the others share its error.
  const Eigen::RowVector3d along = views[unit].translation().transpose() / longest;
  Eigen::MatrixXd by_error = Eigen::MatrixXd::Identity(n, n);
  for (std::size_t k = 0; k < views.size(); ++k) {
    by_error.block<3, 3>(static_cast<Eigen::Index>(6 * k + 3),
                         static_cast<Eigen::Index>(6 * unit + 3)) -=
        views[k].translation() / longest * along;
  }
  out.covariance = (by_error * out.covariance * by_error.transpose()).eval();
  out.pixel_sigma = options.pixel_sigma;
  out.metres_per_baseline = longest;
  out.baseline_sigma = options.translation_sigma / longest;
  out.status = Status::kOk;
  return out;
}

Eigen::Vector3d travel_direction(const MotionEstimate& motion, std::size_t reference) {
  constexpr double kStands = 0.1;  // of the longest baseline: nearer positions have no direction
  const std::vector<SE3>& poses = motion.frame_from_reference;
  double longest = 0.0;
  for (const SE3& pose : poses) longest = std::max(longest, pose.translation().norm());
  if (!(longest > 0.0)) return Eigen::Vector3d::UnitZ();
  const auto nearest = [&](std::size_t from, int step) -> std::optional<Eigen::Vector3d> {
    for (auto k = static_cast<std::ptrdiff_t>(from) + step;
         k >= 0 && k < static_cast<std::ptrdiff_t>(poses.size()); k += step) {
      const SE3& pose = poses[static_cast<std::size_t>(k)];
      if (pose.translation().norm() >= kStands * longest) return pose.inverse().translation();
    }
    return std::nullopt;
  };
  const auto before = nearest(reference, -1), after = nearest(reference, 1);
  Eigen::Vector3d direction;
  if (before && after) {
    const double l1 = before->norm(), l2 = after->norm();
    direction = *after * (l1 / l2) - *before * (l2 / l1);
  } else {
    direction = before ? Eigen::Vector3d(-*before) : *after;
  }
  // A camera that looks back along its trajectory (reversing) still sees the road ahead of it.
  if (direction.z() < 0) direction = -direction;
  return direction.normalized();
}

}  // namespace camber
