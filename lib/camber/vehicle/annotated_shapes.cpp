#include "camber/vehicle/annotated_shapes.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <charconv>
#include <cmath>
#include <fstream>
#include <stdexcept>

#include "camber/core/errors.h"
#include "camber/core/median.h"

namespace camber {

namespace {

using SideMatrix = Eigen::Matrix<double, 3, kNumSideKeypoints>;

Eigen::Vector3d box_sides(const ShapePrior& prior) {  // along x, y, z
  return {prior.parameters_mean[0], prior.parameters_mean[2], prior.parameters_mean[1]};
}

/// Whether a row has a name where the first number would be.
bool is_header(const std::string& line) {
  const std::size_t comma = line.find(',');
  double value = 0.0;
  return comma == std::string::npos ||
         std::from_chars(line.data() + comma + 1, line.data() + line.size(), value).ec !=
             std::errc();
}

}  // namespace

std::vector<AnnotatedShape> read_annotated_shapes(const std::filesystem::path& path) {
  std::ifstream in(path);
  if (!in || std::filesystem::is_directory(path)) {
    throw InputError(path.string(), "cannot be read");
  }
  std::vector<AnnotatedShape> out;
  std::string line;
  for (int number = 1; std::getline(in, line); ++number) {
    if (!line.empty() && line.back() == '\r') line.pop_back();
    if (line.empty() || (number == 1 && is_header(line))) continue;
    const std::string position = fmt::format("line {}", number);
    std::vector<std::string> fields;
    std::size_t start = 0;
    while (true) {
      const std::size_t comma = line.find(',', start);
      fields.push_back(line.substr(start, comma - start));
      if (comma == std::string::npos) break;
      start = comma + 1;
    }
    if (fields.size() != 1 + 3 * kNumKeypoints) {
      throw InputError(path.string(), position,
                       fmt::format("found {} fields, expected a name and {} numbers", fields.size(),
                                   3 * kNumKeypoints));
    }
    AnnotatedShape shape;
    shape.name = fields[0];
    for (int i = 0; i < 3 * kNumKeypoints; ++i) {
      const std::string& field = fields[i + 1];
      double value = 0.0;
      const auto [end, error] = std::from_chars(field.data(), field.data() + field.size(), value);
      if (error != std::errc() || end != field.data() + field.size() || !std::isfinite(value)) {
        throw InputError(path.string(), position,
                         fmt::format("field {}: found no finite number", i + 2));
      }
      shape.keypoints(i % 3, i / 3) = value;
    }
    out.push_back(std::move(shape));
  }
  if (out.empty()) throw InputError(path.string(), "line 2", "found no row, expected a shape");
  return out;
}

ShapeExplanation explain_shape(const ShapePrior& prior, const AnnotatedShape& shape, int count) {
  if (count < 0 || count > prior.num_coefficients()) {
    throw std::invalid_argument(
        fmt::format("coefficients: {}, the prior has {}", count, prior.num_coefficients()));
  }
  const Eigen::Vector3d sides = box_sides(prior);
  // Unknowns: scales x y z, shifts x y, coefficients. Residual: model - (scale * point + shift).
  const int unknowns = 5 + count;
  Eigen::MatrixXd normal = Eigen::MatrixXd::Zero(unknowns, unknowns);
  Eigen::VectorXd right = Eigen::VectorXd::Zero(unknowns);
  Eigen::VectorXd row(unknowns);
  for (int i = 0; i < kNumKeypoints; ++i) {
    const int side = i % kNumSideKeypoints;
    const double mirror = i < kNumSideKeypoints ? 1.0 : -1.0;
    for (int axis = 0; axis < 3; ++axis) {
      const double sign = axis == 2 ? mirror : 1.0;
      row.setZero();
      row[axis] = shape.keypoints(axis, i);
      if (axis < 2) row[3 + axis] = 1.0;
      for (int k = 0; k < count; ++k) {
        row[5 + k] = -sign * sides[axis] * prior.basis[k](axis, side);
      }
      normal += row * row.transpose();
      right += row * (sign * sides[axis] * prior.mean(axis, side));
    }
  }
  // A keypoint is annotated to some 3 cm: the weight of a coefficient's unit normal prior.
  constexpr double kAnnotationSigma = 0.03;
  for (int k = 0; k < count; ++k) {
    normal(5 + k, 5 + k) += kAnnotationSigma * kAnnotationSigma;
  }
  const Eigen::VectorXd solved = normal.ldlt().solve(right);

  ShapeExplanation out;
  out.coefficients.assign(solved.data() + 5, solved.data() + unknowns);
  const Eigen::Vector3d shift(solved[3], solved[4], 0.0);
  out.scale = solved.head<3>();
  out.aligned = (out.scale.asDiagonal() * shape.keypoints).colwise() + shift;
  const KeypointMatrix model = prior.keypoints(prior.mean_dimensions(), out.coefficients);
  out.residuals = (out.aligned - model).colwise().norm();
  out.mean_residual = out.residuals.mean();
  return out;
}

AnnotatedPrior learn_annotated_prior(const std::string& name,
                                     const std::vector<AnnotatedShape>& shapes,
                                     const ShapePrior& reference, const SizePrior* size,
                                     const ShapeLearningOptions& options) {
  std::vector<ShapeExplanation> aligned;
  std::vector<double> residuals;
  for (const AnnotatedShape& shape : shapes) {
    aligned.push_back(explain_shape(reference, shape, 0));
    residuals.push_back(aligned.back().mean_residual);
  }
  AnnotatedPrior out;
  std::vector<ShapeSample> samples;
  if (!shapes.empty()) {
    const double median = upper_median(residuals);
    std::vector<double> deviations;
    for (double r : residuals) deviations.push_back(std::abs(r - median));
    const double limit =
        std::max(median + 3.5 * kSigmaFromMad * upper_median(deviations), 2.0 * median);
    for (std::size_t i = 0; i < shapes.size(); ++i) {
      if (residuals[i] > limit || aligned[i].scale.minCoeff() <= 0.0) {
        out.outliers.push_back(static_cast<int>(i));
      } else {
        samples.push_back({reference.mean_dimensions(), aligned[i].aligned});
      }
    }
  }
  out.prior = learn_shape_prior(name, samples, options);
  const SizePrior own{reference.name, reference.parameters_mean.head<3>(),
                      reference.parameters_covariance.topLeftCorner<3, 3>()};
  const SizePrior& chosen = size ? *size : own;
  out.prior.parameters_mean.head<3>() = chosen.mean;
  const int retained = out.prior.num_coefficients();
  out.prior.parameters_covariance = Eigen::MatrixXd::Identity(3 + retained, 3 + retained);
  out.prior.parameters_covariance.topLeftCorner<3, 3>() = chosen.covariance;
  return out;
}

}  // namespace camber
