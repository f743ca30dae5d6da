#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <string>
#include <vector>

#include "camber/geometry/box.h"
#include "camber/vehicle/vehicle_estimate.h"

namespace camber {

inline constexpr int kNumSideKeypoints = 18;  ///< left side; rows i + 18 mirror them

/// Keypoints of one vehicle, one a column: 3 x 36, vehicle frame, m.
using KeypointMatrix = Eigen::Matrix<double, 3, kNumKeypoints>;

/// Shape and metric size of one kind of vehicle, as a joint normal distribution.
///
/// A vehicle of dimensions (l, w, h) and coefficients a has its left keypoints at
/// diag(l, h, w) (mean + sum_k a_k basis_k), right ones mirrored in z. Shares of the full box carry
/// the wheel radius (the wheel centres' height) and the margins between keypoints and box.
struct ShapePrior {
  std::string name;                                  ///< "car", "van"
  int samples = 0;                                   ///< vehicles that it was learnt from
  Eigen::Matrix<double, 3, kNumSideKeypoints> mean;  ///< x / length, y / height, z / width
  std::vector<Eigen::Matrix<double, 3, kNumSideKeypoints>> basis;  ///< same unit, a of variance 1
  /// Standard deviation of each coordinate about the mean shape, m, at the mean size.
  Eigen::Matrix<double, 3, kNumSideKeypoints> sigma;
  Eigen::VectorXd parameters_mean;        ///< length, width, height (m), then K zeros
  Eigen::MatrixXd parameters_covariance;  ///< (3 + K) x (3 + K)

  int num_coefficients() const { return static_cast<int>(basis.size()); }
  Dimensions mean_dimensions() const {
    return {parameters_mean[0], parameters_mean[1], parameters_mean[2]};
  }

  /// Keypoints in the vehicle frame, m. @param coefficients at most num_coefficients() of them.
  KeypointMatrix keypoints(const Dimensions& dimensions,
                           const std::vector<double>& coefficients = {}) const;

  /// What the first `count` coefficients leave of `sigma`, m.
  Eigen::Matrix<double, 3, kNumSideKeypoints> residual_sigma(int count) const;

  /// The same prior cut to its first `count` coefficients (or all, if it has fewer).
  ShapePrior truncated(int count) const;
};

/// Metric size of a class of vehicles that has no keypoint shape.
struct SizePrior {
  std::string name;            ///< "truck", "bus", ...
  Eigen::Vector3d mean;        ///< length, width, height, m
  Eigen::Matrix3d covariance;  ///< m^2
};

/// All that is known beforehand about vehicles.
struct VehiclePrior {
  std::string source;              ///< what it was learnt from
  std::vector<ShapePrior> shapes;  ///< not empty; the first answers for unknown classes
  std::vector<SizePrior> sizes;    ///< classes without a shape

  /// The prior of a class; upper and lower case alike. Unknown: the first shape's.
  const ShapePrior& shape(const std::string& vehicle_class) const;
  /// Whether the class has keypoint shapes (an unknown class has).
  bool has_shape(const std::string& vehicle_class) const;
  /// Size of a class, with or without a shape.
  SizePrior size(const std::string& vehicle_class) const;
};

/// One vehicle to learn from.
struct ShapeSample {
  Dimensions dimensions;     ///< full box, m
  KeypointMatrix keypoints;  ///< vehicle frame, m
};

struct ShapeLearningOptions {
  int num_coefficients = 20;  ///< principal directions to retain, >= 0
  void validate() const;      ///< throws std::invalid_argument
};

/// Learns a shape prior: mean and principal components (in metres at the mean size) of the left
/// and mirrored right keypoints' average, in shares of the box, with the joint covariance of
/// coefficients and sizes. Components' signs are fixed by their largest entry being positive.
/// @throws std::invalid_argument with fewer than two samples or a box without volume.
ShapePrior learn_shape_prior(const std::string& name, const std::vector<ShapeSample>& samples,
                             const ShapeLearningOptions& options);

/// Metric sizes of the classes without a keypoint shape, from published dimensions: rigid and
/// articulated trucks of 7.5 to 40 t, city buses and coaches, trams, motorcycles, bicycles with
/// their riders, and standing persons.
std::vector<SizePrior> published_sizes();

/// The prior that ships with the library, learnt from the parametric car family
/// (`camber prior learn --family`). Made once, on first use; safe from any thread.
const VehiclePrior& shipped_vehicle_prior();

/// Prior files: JSON, format "camber-prior", version 1.
/// @throws InputError "file: JSON path: found, expected".
VehiclePrior read_vehicle_prior(const std::filesystem::path& path);
/// Writes a prior file atomically. @throws OutputError.
void write_vehicle_prior(const VehiclePrior& prior, const std::filesystem::path& path);
/// The text of a prior file; the same prior gives the same bytes.
std::string vehicle_prior_text(const VehiclePrior& prior);
/// Inverse of vehicle_prior_text; `name` stands for the file in messages.
VehiclePrior parse_vehicle_prior(const std::string& text, const std::string& name);

}  // namespace camber
