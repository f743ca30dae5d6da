#pragma once

#include <Eigen/Core>
#include <vector>

namespace camber {

/// m, standard deviation of points across a line that is smooth otherwise, by their distances from
/// quintics through the three neighbours on either side, robustly; 0 for fewer than 20 points.
double line_scatter(const std::vector<Eigen::Vector3d>& points);

/// A smooth curve in the plan along given points: a natural cubic smoothing spline over their
/// chord length, as stiff as `tolerance` allows (Green and Silverman, "Nonparametric Regression and
/// Generalized Linear Models", 1994, section 2.3), with its arc length; z follows the points
/// linearly.
class SmoothLine {
 public:
  /// @param points     at least two different places; those closer than 1 mm to the last are
  /// skipped, as are those whose x or y is not finite; z may be NaN where it is not known
  /// @param tolerance  m that the curve may pass a point by, >= 0
  /// @param before, after  m to go on straight at either end
  /// @throws std::invalid_argument for fewer than two different places, and for more than
  /// 100 km, which only a damaged file has.
  SmoothLine(const std::vector<Eigen::Vector3d>& points, double tolerance, double before = 0.0,
             double after = 0.0);

  double length() const { return arc_.back(); }  ///< m in plan
  Eigen::Vector2d position(double s) const;
  double heading(double s) const;                  ///< rad
  double curvature(double s) const;                ///< 1/m, positive to the left
  double height(double s) const;                   ///< m, of the points, or as set
  double deviation() const { return deviation_; }  ///< m, greatest distance of a point

  /// Heights in place of the points', linear between stations and level beyond them.
  /// @param stations  m, ascending, at least one
  void set_heights(std::vector<double> stations, std::vector<double> heights);

 private:
  struct Place {
    std::size_t piece = 0;
    double t = 0.0;  ///< m of chord from the piece's start
  };
  Place place(double s) const;
  Eigen::Vector2d at(const Place& place, int derivative) const;

  std::vector<double> knots_;                    ///< chord length
  std::vector<Eigen::Vector2d> values_, bends_;  ///< at the knots, and second derivatives there
  std::vector<double> height_stations_, heights_;
  std::vector<double> arc_, arc_knot_;  ///< arc length against chord length, finely
  double deviation_ = 0.0;
};

}  // namespace camber
