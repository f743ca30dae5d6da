#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <sstream>
#include <string>

#include "camber/core/errors.h"
#include "camber/core/median.h"
#include "camber/evaluate/detail/compare_steps.h"

namespace camber::detail {

using Eigen::Matrix4d;
using Eigen::Vector3d;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

namespace {

constexpr std::size_t kSample = 20000;
/// An alignment that changes the scale by more than this from where it started has shrunk onto a
/// part of the truth, or spread beyond it.
constexpr double kLeastScale = 0.2, kLargestScale = 5.0;

/// Where the iterations start: moved = scale * (p - middle) + middle + translation.
struct Start {
  Vector3d translation = Vector3d::Zero();
  double scale = 1.0;
};

/// An alignment and how much of both shapes its pairs reach over.
struct Candidate {
  AlignmentResult result;
  double scale_change = 1.0;
  double truth_covered = 0.0;     ///< spread of the places on the truth by that of the truth
  double estimate_covered = 0.0;  ///< spread of the paired points by that of the estimate
};

Vector3d mean_of(const std::vector<Vector3d>& points) {
  Vector3d mean = Vector3d::Zero();
  for (const Vector3d& p : points) mean += p / static_cast<double>(points.size());
  return mean;
}

/// Median distance from the median place: a few points far off do not move it.
double spread_of(const std::vector<Vector3d>& points) {
  Vector3d middle;
  std::vector<double> values(points.size());
  for (Eigen::Index axis = 0; axis < 3; ++axis) {
    for (std::size_t i = 0; i < points.size(); ++i) values[i] = points[i][axis];
    middle[axis] = upper_median(values);
  }
  for (std::size_t i = 0; i < points.size(); ++i) values[i] = (points[i] - middle).norm();
  return upper_median(values);
}

/// The box of all but the outermost fiftieth at either end of each axis.
Eigen::AlignedBox3d box_of(const std::vector<Vector3d>& points) {
  Eigen::AlignedBox3d box;
  box.min().setZero();
  box.max().setZero();
  std::vector<double> values(points.size());
  const auto outermost = static_cast<std::ptrdiff_t>(points.size() / 50);
  for (Eigen::Index axis = 0; axis < 3; ++axis) {
    for (std::size_t i = 0; i < points.size(); ++i) values[i] = points[i][axis];
    std::nth_element(values.begin(), values.begin() + outermost, values.end());
    box.min()[axis] = values[static_cast<std::size_t>(outermost)];
    std::nth_element(values.begin(), values.end() - 1 - outermost, values.end());
    box.max()[axis] = *(values.end() - 1 - outermost);
  }
  return box;
}

/// @param place  of each of `count` points
template <typename Place>
std::vector<Vector3d> finite_sample(std::size_t count, Place&& place) {
  std::vector<Vector3d> sample;
  const std::size_t stride = std::max<std::size_t>(1, count / kSample);
  for (std::size_t i = 0; i < count; i += stride) {
    const Vector3d p = place(i);
    if (p.allFinite()) sample.push_back(p);
  }
  return sample;
}

/// Whether the estimate lies beside the truth: their boxes are apart, and by more than an offset of
/// flat shapes. Searches would take long: seen from far off all points of the truth are as near.
/// @param rms  set to the distance from the truth's box, m, where it does
bool lies_apart(const std::vector<Vector3d>& sample, const std::vector<Vector3d>& truth,
                double* rms) {
  if (truth.empty()) return false;
  const Eigen::AlignedBox3d box = box_of(truth);
  if (box_of(sample).intersects(box)) return false;
  std::vector<double> distances;
  double squares = 0.0;
  for (const Vector3d& p : sample) {
    distances.push_back(box.exteriorDistance(p));
    squares += distances.back() * distances.back();
  }
  if (!(upper_median(distances) > std::max(spread_of(sample), spread_of(truth)))) return false;
  *rms = std::sqrt(squares / static_cast<double>(distances.size()));
  return true;
}

/// @param middle        of turns and of changes of scale
/// @param truth_sample  points of the truth, for the share of it that was found
Candidate iterate_from(const Start& start, const std::vector<Vector3d>& sample,
                       const Vector3d& middle, const Shape& truth,
                       const std::vector<Vector3d>& truth_sample, const ShapeSearch& search,
                       Alignment alignment) {
  constexpr double kPointWeight = 0.01;
  Candidate candidate;
  AlignmentResult& out = candidate.result;
  out.alignment = alignment;
  const bool turns = alignment == Alignment::kRigid || alignment == Alignment::kSimilarity;
  const bool scales = alignment == Alignment::kScale || alignment == Alignment::kSimilarity;
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
  Vector3d translation = start.translation;
  double scale = start.scale;
  double spread = 0.0;
  for (const Vector3d& p : sample) spread += (p - middle).squaredNorm();
  spread = std::sqrt(spread / static_cast<double>(sample.size()));
  double last_residual = kInfinity;
  std::vector<Vector3d> places, paired;  // on the truth, and the points that found them
  for (int iteration = 0; iteration < 100; ++iteration) {
    std::vector<Vector3d> moved(sample.size());
    for (std::size_t i = 0; i < sample.size(); ++i) {
      moved[i] = scale * (rotation * (sample[i] - middle)) + middle + translation;
    }
    const ShapeDistances near = search.distances(moved);
    std::vector<double> distances;
    for (const double d : near.distance) {
      if (std::isfinite(d)) distances.push_back(d);
    }
    const double limit = 3.0 * upper_median(distances) + 1e-9;
    Eigen::Matrix<double, 7, 7> hessian = Eigen::Matrix<double, 7, 7>::Zero();
    Eigen::Matrix<double, 7, 1> gradient = Eigen::Matrix<double, 7, 1>::Zero();
    double squares = 0.0;
    std::size_t pairs = 0;
    places.clear();
    paired.clear();
    for (std::size_t i = 0; i < moved.size(); ++i) {
      if (!(near.distance[i] <= limit)) continue;
      const Contact c = contact(truth, near.nearest[i], moved[i]);
      const Vector3d arm = moved[i] - middle - translation;
      Eigen::Matrix<double, 3, 7> jacobian;  // of the moved point: turn, shift, log scale
      jacobian << 0, arm.z(), -arm.y(), 1, 0, 0, arm.x(),  //
          -arm.z(), 0, arm.x(), 0, 1, 0, arm.y(),          //
          arm.y(), -arm.x(), 0, 0, 0, 1, arm.z();
      if (!turns) jacobian.leftCols<6>().setZero();
      if (!scales) jacobian.col(6).setZero();
      const Vector3d error = moved[i] - c.place;
      const double weight = c.normal.isZero() ? 1.0 : kPointWeight;
      hessian += weight * jacobian.transpose() * jacobian;
      gradient += weight * jacobian.transpose() * error;
      if (!c.normal.isZero()) {
        const Eigen::Matrix<double, 1, 7> row = c.normal.transpose() * jacobian;
        hessian += row.transpose() * row;
        gradient += row.transpose() * c.normal.dot(error);
        squares += std::pow(c.normal.dot(error), 2);
      } else {
        squares += error.squaredNorm();
      }
      places.push_back(c.place);
      paired.push_back(sample[i]);
      ++pairs;
    }
    const double residual = pairs > 0 ? std::sqrt(squares / static_cast<double>(pairs)) : kNaN;
    if (iteration == 0) out.residual_before = residual;
    out.residual_after = residual;
    out.pairs = pairs;
    out.iterations = iteration;
    if (pairs < 10) {
      throw NoAnswerError("alignment: found " + std::to_string(pairs) +
                          " pairs, expected at least 10");
    }
    for (int k = 0; k < 7; ++k) hessian(k, k) += hessian(k, k) > 0.0 ? 1e-12 * hessian(k, k) : 1.0;
    const Eigen::Matrix<double, 7, 1> step = -hessian.ldlt().solve(gradient);
    if (!step.allFinite()) break;
    const Eigen::Matrix3d turn = rotation_from_vector(Vector3d(step.head<3>())).toRotationMatrix();
    rotation = turn * rotation;
    translation += step.segment<3>(3);
    scale *= std::exp(step[6]);
    const double motion =
        spread * (step.head<3>().norm() + std::abs(step[6])) + step.segment<3>(3).norm();
    if (motion < 1e-6 || (motion < 1e-4 && std::abs(residual - last_residual) < 1e-6 * residual)) {
      break;
    }
    last_residual = residual;
  }
  out.scale = scale;
  out.transform.topLeftCorner<3, 3>() = scale * rotation;
  out.transform.topRightCorner<3, 1>() = middle + translation - scale * (rotation * middle);
  candidate.scale_change = scale / start.scale;
  const auto share = [](double part, double whole) { return whole > 0.0 ? part / whole : 1.0; };
  candidate.truth_covered = share(spread_of(places), spread_of(truth_sample));
  candidate.estimate_covered = share(spread_of(paired), spread_of(sample));
  return candidate;
}

/// Why an alignment is none; empty where it is one.
/// @param apart  the shapes did not overlap, so that whole was laid upon whole
std::string objection(const Candidate& c, bool apart) {
  const Alignment alignment = c.result.alignment;
  const auto percent = [](double share) {
    return std::to_string(static_cast<int>(std::round(100.0 * share))) + " %";
  };
  const bool far_scale = !(c.scale_change >= kLeastScale && c.scale_change <= kLargestScale);
  // The scale alone has no start to be near of: refused is only what shrank to a speck.
  const bool collapsed =
      alignment == Alignment::kScale ? far_scale && c.truth_covered < 0.01 : far_scale;
  if (collapsed) {
    std::ostringstream scale;
    scale << c.scale_change;
    return "the scale changed by a factor of " + scale.str() +
           ", expected 0.2 to 5, and the pairs reach over " + percent(c.truth_covered) +
           " of the truth's extent";
  }
  constexpr double kLeastCovered = 0.25;
  if (apart && !(std::min(c.truth_covered, c.estimate_covered) >= kLeastCovered)) {
    return "the shapes lie apart, and from centre on centre the pairs reach over " +
           percent(c.truth_covered) + " of the truth's extent and " + percent(c.estimate_covered) +
           " of the estimate's, expected at least 25 %";
  }
  return {};
}

}  // namespace

AlignmentResult iterate_closest(const std::vector<Vector3d>& estimate, const Shape& truth,
                                const ShapeSearch& search, Alignment alignment) {
  const std::vector<Vector3d> sample =
      finite_sample(estimate.size(), [&](std::size_t i) { return estimate[i]; });
  if (sample.size() < 10) {
    throw NoAnswerError("found " + std::to_string(sample.size()) +
                        " points to align, expected at least 10");
  }
  const RoadCloud spread_over =
      truth.is_mesh() ? sample_mesh(truth, kInfinity, kSample, 0) : RoadCloud();
  const RoadCloud& true_cloud = truth.is_mesh() ? spread_over : truth.cloud;
  const std::vector<Vector3d> truth_sample =
      finite_sample(true_cloud.size(), [&](std::size_t i) { return true_point(true_cloud, i); });
  // Scale is about the coordinates' zero, the camera; turns are about the middle of the sample.
  const bool moves = alignment != Alignment::kScale;
  const Vector3d middle = moves ? mean_of(sample) : Vector3d::Zero();
  double rms_apart = kNaN;
  const bool apart = moves && lies_apart(sample, truth_sample, &rms_apart);
  std::vector<Start> starts(1);
  if (apart) {
    starts[0].translation = mean_of(truth_sample) - middle;
    const double ratio = spread_of(truth_sample) / spread_of(sample);
    const bool other_size = std::abs(std::log(ratio)) > 0.2 && std::isfinite(std::log(ratio));
    if (alignment == Alignment::kSimilarity && other_size) {
      starts.push_back({starts[0].translation, ratio});
    }
  }
  std::optional<AlignmentResult> best;
  double least = kInfinity;
  std::string reason;
  for (const Start& start : starts) {
    const Candidate found =
        iterate_from(start, sample, middle, truth, truth_sample, search, alignment);
    const std::string against = objection(found, apart);
    if (!against.empty()) {
      if (reason.empty()) reason = against;
      continue;
    }
    // In the estimate's units, so that a shrunken one is none the better.
    const double badness = found.result.residual_after / (found.result.scale * found.truth_covered);
    if (best && !(badness < least)) continue;
    least = badness;
    best = found.result;
  }
  if (!best) {
    throw NoAnswerError("alignment: " + reason + "; corresponding places (--pairs) would start it");
  }
  if (apart) best->residual_before = rms_apart;
  return *best;
}

AlignmentResult align_pairs(const CompareOptions& options) {
  AlignmentResult out;
  out.alignment = options.alignment;
  out.from_pairs = true;
  out.pairs = options.pairs.size();
  const Eigen::Index n = static_cast<Eigen::Index>(options.pairs.size());
  Eigen::Matrix3Xd from(3, n), to(3, n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const auto& [estimate, truth] = options.pairs[static_cast<std::size_t>(i)];
    from.col(i) = estimate;
    to.col(i) = move(options.estimate_from_truth, truth);
  }
  if (options.alignment == Alignment::kScale) {
    const double squares = from.squaredNorm();
    if (!(squares > 0.0)) throw NoAnswerError("alignment: all pairs are at zero");
    out.scale = from.cwiseProduct(to).sum() / squares;
    out.transform.topLeftCorner<3, 3>() *= out.scale;
  } else {
    const Eigen::Matrix3Xd centred = from.colwise() - from.rowwise().mean();
    Eigen::Index farthest = 0;
    const double reach = centred.colwise().norm().maxCoeff(&farthest);
    const Vector3d line = centred.col(farthest) / reach;
    const double aside =
        (centred - line * (line.transpose() * centred)).colwise().norm().maxCoeff();
    if (!(aside > 1e-9 * reach)) {
      throw NoAnswerError("alignment: the pairs lie on one line, expected three corners");
    }
    const bool scales = options.alignment == Alignment::kSimilarity;
    out.transform = Eigen::umeyama(from, to, scales);
    out.scale = std::cbrt(out.transform.topLeftCorner<3, 3>().determinant());
  }
  const auto residual = [&](const Matrix4d& m) {
    const Eigen::Matrix3Xd moved =
        (m.topLeftCorner<3, 3>() * from).colwise() + Vector3d(m.topRightCorner<3, 1>());
    return std::sqrt((moved - to).squaredNorm() / static_cast<double>(n));
  };
  out.residual_before = residual(Matrix4d::Identity());
  out.residual_after = residual(out.transform);
  return out;
}

}  // namespace camber::detail
