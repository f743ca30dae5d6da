#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "camber/core/errors.h"
#include "camber/evaluate/detail/compare_steps.h"

namespace camber::detail {

using Eigen::Matrix4d;
using Eigen::Vector3d;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

AlignmentResult iterate_closest(const std::vector<Vector3d>& estimate, const Shape& truth,
                                const ShapeSearch& search, Alignment alignment) {
  constexpr std::size_t kSample = 20000;
  constexpr double kPointWeight = 0.01;
  AlignmentResult out;
  out.alignment = alignment;
  std::vector<Vector3d> sample;
  const std::size_t stride = std::max<std::size_t>(1, estimate.size() / kSample);
  for (std::size_t i = 0; i < estimate.size(); i += stride) {
    if (estimate[i].allFinite()) sample.push_back(estimate[i]);
  }
  if (sample.size() < 10) {
    throw NoAnswerError("found " + std::to_string(sample.size()) +
                        " points to align, expected at least 10");
  }
  // Scale is about the coordinates' zero, the camera; turns are about the middle of the sample.
  Vector3d middle = Vector3d::Zero();
  if (alignment != Alignment::kScale) {
    for (const Vector3d& p : sample) middle += p / static_cast<double>(sample.size());
  }
  const bool turns = alignment == Alignment::kRigid || alignment == Alignment::kSimilarity;
  const bool scales = alignment == Alignment::kScale || alignment == Alignment::kSimilarity;
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
  Vector3d translation = Vector3d::Zero();
  double scale = 1.0;
  double spread = 0.0;
  for (const Vector3d& p : sample) spread += (p - middle).squaredNorm();
  spread = std::sqrt(spread / static_cast<double>(sample.size()));
  double last_residual = kInfinity;
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
    const double limit = 3.0 * median_of(distances) + 1e-9;
    Eigen::Matrix<double, 7, 7> hessian = Eigen::Matrix<double, 7, 7>::Zero();
    Eigen::Matrix<double, 7, 1> gradient = Eigen::Matrix<double, 7, 1>::Zero();
    double squares = 0.0;
    std::size_t pairs = 0;
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
  return out;
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
