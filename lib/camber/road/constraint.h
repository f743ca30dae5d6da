#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

namespace camber {

/// An error that the measurements of all windows of one camera share, as that of its given height.
struct CommonError {
  std::string name;
  Eigen::VectorXd by;  ///< what the measurements are off by one standard deviation of it
};

/// One source's knowledge of the road or its scale: measurements, linearised at a
/// RoadPosterior's mean, of the metric ground ahead, of the ego plane and of the scale.
struct Constraint {
  std::string name;    ///< the source in the field's words: "camera_height", "lane_markings", ...
  std::string source;  ///< what was measured here: "4 dashes, 1 crossing to 31 m"

  /// Pixels of the reference image; row k of by_inverse_depth is the derivative of measurement k by
  /// the metric inverse depths (1/m) of the ground there. No columns: not of the ground ahead.
  std::vector<Eigen::Vector2d> pixels;
  Eigen::MatrixXd by_inverse_depth;
  Eigen::MatrixXd by_ego;        ///< by (tilt, tilt, height) of the ego plane, rad and m; or empty
  Eigen::VectorXd by_log_scale;  ///< by the logarithm of the scale; or empty
  Eigen::VectorXd residual;      ///< measured minus predicted at the mean
  Eigen::MatrixXd covariance;    ///< of the measurements
  std::vector<CommonError> common;  ///< what of `covariance` is common to all windows; may be empty

  /// Standard deviations (root of the normalised squared innovation over its degrees of freedom)
  /// beyond which the source is taken to contradict the others.
  double gate = 4.0;

  Eigen::Index size() const { return residual.size(); }
  /// @throws std::invalid_argument naming the first block whose size does not fit.
  void validate() const;
};

/// What became of a source.
struct ConstraintReport {
  std::string name, source;
  /// Innovation against all other accepted sources, in standard deviations; NaN where nothing was
  /// measured.
  double residual_sigma = 0.0;
  bool accepted = false;
  std::string reason;  ///< why not
};

}  // namespace camber
