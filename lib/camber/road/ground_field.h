#pragma once

#include <Eigen/Core>
#include <memory>
#include <vector>

#include "camber/geometry/pinhole_camera.h"
#include "camber/geometry/plane.h"

namespace camber {

/// Inverse depths of ground pixels of one image, arrays of equal length. Units: those of the
/// reconstruction (metres or baselines).
struct GroundObservations {
  std::vector<Eigen::Vector2d> pixels;
  std::vector<double> inverse_depth;
  std::vector<double> sigma;  ///< standard deviation of inverse_depth, > 0
  /// d(inverse depth) / d(shared parameters), one row a point; no columns: nothing is shared.
  Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> shared_jacobian;

  std::size_t size() const { return pixels.size(); }
};

struct GroundFieldOptions {
  double column_spacing_px = 32.0;   ///< between nodes, > 0
  double row_spacing_px = 6.0;       ///< between nodes, > 0
  double along_curvature = 0.012;    ///< 1/m, standard deviation of the road's vertical curvature
  double across_curvature = 0.05;    ///< 1/m, the same across the road (crown, side streets)
  double metres_per_baseline = 1.0;  ///< rough scale of the reconstruction, > 0
  /// Neighbouring observations share their errors: information is divided by this, >= 1.
  double correlation = 32.0;
  int iterations = 6;     ///< of the reweighting, >= 1
  int num_threads = 0;    ///< <= 0: see resolve_num_threads; the same result for any number
  void validate() const;  ///< throws std::invalid_argument
};

/// The ground as a smooth function of the pixel: a bilinear grid of inverse depths over the image.
///
/// A plane n . x + d = 0 has the inverse depth -(n . ray) / d, linear in the pixel, so that second
/// differences between nodes measure curvature and vanish on planes. They are held to zero within
/// what a road's curvature makes of them at each node's depth; observations and second differences
/// carry a Cauchy loss (kerbs, pavements, crests). Solved by reweighted linear least squares.
class GroundField {
 public:
  /// @param start  a rough plane of the near road, camera frame (the ego plane): observations far
  ///               off it are let in by degrees, the farther away the more freely.
  /// @throws std::invalid_argument with fewer than 3 observations or arrays that differ in length.
  GroundField(const PinholeCamera& camera, const GroundObservations& observations,
              const Plane& start, const GroundFieldOptions& options);

  /// Solves again on the same grid with other observations, starting from the field as it is and
  /// with the loss at its final width: one Gauss-Newton step of an outer problem.
  /// @param correlation  in place of that of the options; 0: theirs.
  void update(const GroundObservations& observations, int iterations, double correlation = 0.0);

  /// The same, solving for the shared parameters as well.
  /// @param information  of the shared parameters before the observations, square.
  /// @param moved  how far the shared parameters already are from where that information puts them.
  /// @return their change; *covariance is what is left of their uncertainty.
  Eigen::VectorXd update_with_shared(const GroundObservations& observations, int iterations,
                                     double correlation, const Eigen::MatrixXd& information,
                                     const Eigen::VectorXd& moved, Eigen::MatrixXd* covariance);

  /// The copy has the nodes but no covariance and no weights until it is updated.
  GroundField(const GroundField& other);
  GroundField& operator=(const GroundField&) = delete;
  ~GroundField();
  GroundField(GroundField&&) noexcept;
  GroundField& operator=(GroundField&&) noexcept;

  /// Inverse depth of the ground at a pixel (clamped to the grid); <= 0: the sky.
  double inverse_depth(const Eigen::Vector2d& pixel) const;
  /// Sum of the weights of observations around a pixel, in observations; 0: interpolated.
  double observed(const Eigen::Vector2d& pixel) const;
  /// Topmost row of the grid, px.
  double top() const;

  /// The grid's inverse depths, and their derivatives by the shared parameters (none: no columns).
  const Eigen::VectorXd& nodes() const;
  const Eigen::MatrixXd& shared() const;
  /// Values at the nodes, interpolated at a pixel as inverse_depth() is.
  double interpolated(const Eigen::Vector2d& pixel, const Eigen::VectorXd& node_values) const;
  /// The same at the pixels 0 to count - 1 of a row.
  void interpolated_row(double row, const Eigen::VectorXd& node_values, int count,
                        float* out) const;
  /// Linear functions of the nodes, one a column: row k of `coefficients` weighs inverse_depth at
  /// the pixels.
  Eigen::MatrixXd functionals(const std::vector<Eigen::Vector2d>& pixels,
                              const Eigen::MatrixXd& coefficients) const;
  /// Covariance of linear functions of the field: row k of `coefficients` weighs inverse_depth at
  /// the pixels. @param shared_covariance of the shared parameters; may be empty.
  Eigen::MatrixXd covariance(const std::vector<Eigen::Vector2d>& pixels,
                             const Eigen::MatrixXd& coefficients,
                             const Eigen::MatrixXd& shared_covariance) const;
  /// The nodes' covariance, shared parameters held, times the columns. Not before an update.
  Eigen::MatrixXd solve(const Eigen::MatrixXd& of_nodes) const;
  /// Final weight in (0, 1] of each observation, in their order.
  const std::vector<double>& weights() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace camber
