#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <vector>

#include "camber/road/detail/banded_ldlt.h"

namespace camber::detail {

/// A point of the ground beside a line.
struct StripPoint {
  double s = 0.0, v = 0.0;  ///< m along the line, and to its left
  double z = 0.0;           ///< m
  double weight = 1.0;      ///< of its noise's variance that of one with weight 1 is so much
};

/// A functional of the ground: the sum of weights times heights at places (s, v).
struct StripFunctional {
  struct Term {
    double s = 0.0, v = 0.0, weight = 0.0;
  };
  std::vector<Term> terms;
};

/// How rough the ground is: spectral densities of white noise, and a length.
struct StripRoughness {
  double along = 1e-4;   ///< of the height's second derivative along the line, 1/m
  double twist = 1e-6;   ///< of the cross slope's second derivative along the line, 1/m^3
  double across = 1e-3;  ///< of the second derivative across, 1/m
  double length = 30.0;  ///< m along the line, over which the shape across stays alike
  /// What height and cross slope have besides, which fades over `length`, too (so that kinks of the
  /// ground along the line are no surprise): standard deviations, m and rise over run.
  double level = 1e-5, tilt = 1e-5;
  /// `across` by place, for the crest of a crown and the like: factors at the inner nodes of the
  /// grid, whose mean logarithm need not be zero; empty: ones.
  std::vector<double> bends;
  /// Least of `across` at the line itself, where a road has its crest: sparse points do not show
  /// whether it bends there by the 5 % of a crown.
  double crest = 2.5e-3;

  /// How far along the line the data of one place reach, of what varies the fastest: widths of the
  /// equivalent kernels (Silverman, "Spline smoothing: the equivalent variable kernel method",
  /// 1984).
  /// @param noise    m, of a point
  /// @param density  points per m^2
  /// @param width    m across that have points
  double bandwidth(double noise, double density, double width) const;
};

/// Where the nodes of a strip stand.
struct StripGrid {
  double first = 0.0, last = 0.0;  ///< m along the line that must be covered
  double right = 0.0, left = 0.0;  ///< m across, right < left
  double along = 1.0;              ///< m between nodes
  double across = 0.25;            ///< m between nodes, at most
};

/// The ground beside a line as a smooth function of the place along and across it: its height and
/// its cross slope are integrated Wiener processes along the line, what is left of the shape across
/// is one across it and fades along the line, as a part of height and cross slope does (precision
/// matrices, one the Kronecker factor of the other), after Wood, "Generalized Additive Models", 2nd
/// edition 2017, chapters 4 and 5. Quadratic B-splines along, linear ones across; a band matrix, so
/// linear in the length of the line.
class StripSmoother {
 public:
  /// @param points  those beyond the grid are left out
  StripSmoother(const StripGrid& grid, const std::vector<StripPoint>& points);

  /// Which of the points count, and with which heights (in place of StripPoint::z).
  /// @param used, heights  one a point
  void set_data(const std::vector<char>& used, const std::vector<double>& heights);

  /// @param noise  m, standard deviation of a point of weight 1
  /// @return false: the points do not determine it.
  bool solve(const StripRoughness& roughness, double noise);

  /// -2 log of the restricted likelihood of the roughness and noise of the last solve(), but for a
  /// constant (Wood 2017, section 6.2.6).
  double deviance() const;

  /// That the data take of the last solve(): the trace of the matrix from heights to ground, by a
  /// few random directions (Hutchinson 1990).
  double degrees_of_freedom() const;

  double height(double s, double v) const;
  double value(const StripFunctional& functional) const;
  /// Twice the energy in the shape's second differences at each inner node under the posterior, in
  /// units of their prior variance with factor 1: sums over the rows, whose number is added to
  /// *count. What the factors StripRoughness::bends are made of.
  void add_bends(std::vector<double>* energy, double* count) const;
  /// Covariance of functionals, given the roughness.
  Eigen::MatrixXd covariance(const std::vector<StripFunctional>& functionals) const;

  bool inside(const StripPoint& point) const;
  const StripGrid& grid() const { return grid_; }
  std::size_t used() const { return used_; }

 private:
  static constexpr int kAlong = 3, kEntries = 4 * kAlong;
  struct Row {
    std::array<Eigen::Index, kEntries> index;
    std::array<double, kEntries> value;
  };
  Row row(double s, double v) const;
  Eigen::VectorXd row_of(const StripFunctional& functional) const;
  void add_prior(const StripRoughness& roughness, SymmetricBand* matrix) const;
  double log_prior_determinant(const StripRoughness& roughness) const;
  double bend(const StripRoughness& roughness, Eigen::Index node) const;
  Eigen::MatrixXd shape_precision(const StripRoughness& roughness) const;

  StripGrid grid_;
  const std::vector<StripPoint>& points_;
  Eigen::Index rows_ = 0, nodes_ = 0, per_row_ = 0;
  SymmetricBand normal_;
  Eigen::VectorXd right_;
  double squares_ = 0.0, sum_log_weights_ = 0.0;
  std::size_t used_ = 0;
  StripRoughness roughness_;
  double noise_ = 0.0;
  BandedLdlt factor_;
  Eigen::VectorXd solution_;
};

}  // namespace camber::detail
