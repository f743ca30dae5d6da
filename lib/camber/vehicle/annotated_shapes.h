#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "camber/vehicle/shape_prior.h"

namespace camber {

/// Keypoints of one annotated vehicle in a frame with the axes of the vehicle frame, but with any
/// origin and any scale along each axis.
struct AnnotatedShape {
  std::string name;
  KeypointMatrix keypoints = KeypointMatrix::Zero();
};

/// Reads a CSV table: a header line, then a name and 36 x 3 numbers (x0, y0, z0, x1, ...) a row.
/// @throws InputError "file: line: found, expected".
std::vector<AnnotatedShape> read_annotated_shapes(const std::filesystem::path& path);

/// How a prior explains an annotated shape.
struct ShapeExplanation {
  KeypointMatrix aligned = KeypointMatrix::Zero();  ///< the annotation in the prior's box, m
  Eigen::Vector3d scale{1.0, 1.0, 1.0};  ///< m an annotation's unit; negative: axis reversed
  std::vector<double> coefficients;      ///< as many as asked for
  Eigen::Matrix<double, 1, kNumKeypoints> residuals =
      Eigen::Matrix<double, 1, kNumKeypoints>::Zero();  ///< m, distance of each keypoint
  double mean_residual = 0.0;                           ///< m
};

/// Least squares in the annotation's scale along each axis, its shift along the car and in height,
/// and the prior's first `count` coefficients (weakly held to their distribution, so that they stay
/// determined). Distances are in metres at the prior's mean size.
/// @throws std::invalid_argument if count exceeds the prior's coefficients.
ShapeExplanation explain_shape(const ShapePrior& prior, const AnnotatedShape& shape, int count);

/// A prior learnt from annotated shapes.
struct AnnotatedPrior {
  ShapePrior prior;
  std::vector<int> outliers;  ///< indices of shapes that were left out as gross errors, ascending
};

/// Aligns every shape to `reference`, leaves out gross errors (a reversed axis, or a residual
/// beyond 3.5 robust standard deviations of the population's and twice its median), and learns mean
/// and principal components. Annotations have no metric size: it is taken from `size`, or from the
/// reference if that is nullptr, independent of the coefficients.
/// @throws std::invalid_argument with fewer than two usable shapes.
AnnotatedPrior learn_annotated_prior(const std::string& name,
                                     const std::vector<AnnotatedShape>& shapes,
                                     const ShapePrior& reference, const SizePrior* size,
                                     const ShapeLearningOptions& options);

}  // namespace camber
