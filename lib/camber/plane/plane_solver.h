#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "camber/core/status.h"
#include "camber/geometry/plane.h"
#include "camber/plane/noise_model.h"
#include "camber/plane/plane_kernels.h"

namespace camber {

// What fits of one plane and of many share: points in separate arrays relative to a pivot, robust
// normal equations inside a window of a plane, their solution and its covariance.

inline constexpr double kBiweight = 4.685;    ///< standard deviations; 95 % efficient, normal noise
inline constexpr double kInlierSigmas = 2.5;  ///< standard deviations
inline constexpr double kWeakTilt = 0.02;     ///< rad, standard deviation above which a fit is weak

/// A plane relative to the pivot: n . p + d = 0, |n| = 1.
struct PivotPlane {
  Eigen::Vector3d n = Eigen::Vector3d::UnitZ();
  double d = 0.0;
  plane_kernels::FloatPlane as_float() const;
  double distance(const Eigen::Vector3d& p) const { return n.dot(p) + d; }
};

/// Rectangle on a plane, relative to the pivot.
struct PlaneWindow {
  Eigen::Vector3d center = Eigen::Vector3d::Zero();
  Eigen::Vector3d a = Eigen::Vector3d::UnitX(), b = Eigen::Vector3d::UnitY();
  double half_u = 1e15, half_v = 1e15;  ///< m, beyond it nothing counts
  double ramp_u = 1.0, ramp_v = 1.0;    ///< m, over which the weight grows to 1
  plane_kernels::Window as_float() const;
};

/// Puts a window's axes and centre on a plane.
void align(const PivotPlane& plane, PlaneWindow* window);

/// Points relative to a pivot, padded with rows of weight 0 to a multiple of kLanes.
struct PointArrays {
  std::vector<float> x, y, z, w, sigma, floor2;
  std::vector<std::array<float, 6>> covariance;
  std::size_t size = 0;

  void resize(std::size_t n, bool with_sigma, bool with_covariance);
  Eigen::Vector3d point(std::size_t k) const { return {x[k], y[k], z[k]}; }
  /// Rows of another set, in a given order.
  void take(const PointArrays& from, const std::vector<std::uint32_t>& rows);
  /// Weights of all rows for a plane.
  void weigh(const NoiseModel& noise, const PivotPlane& plane);
};

/// Sums over all rows of a set, whose weights are up to date.
plane_kernels::Moments sum_moments(const PointArrays& points, const PivotPlane& plane,
                                   const PlaneWindow& window, double limit,
                                   plane_kernels::Loss loss, bool influence);

/// Solves the normal equations for (slope along a, slope along b, height) and applies them.
/// @param step  the largest of the three in metres at the points' root mean square distance.
/// False, with the plane as it was, where they are not positive definite.
bool solve_step(const plane_kernels::Moments& moments, const PlaneWindow& window, PivotPlane* plane,
                double* step);

/// A fitted plane with its uncertainty, relative to the pivot.
struct PlaneEstimate {
  UncertainPlane plane;
  double noise = std::numeric_limits<double>::quiet_NaN();      ///< m, of a point
  double condition = std::numeric_limits<double>::quiet_NaN();  ///< >= 1
  double points = 0.0;                                          ///< that carry the fit
  Status status = Status::kNotRun;
  std::string reason;
};

/// What noise along viewing rays that are not known does to a plane, however many points there are.
///
/// Rays from above part on their way: what noise carries towards the viewer, up and off the
/// surface, is crowded together, the rest is thinned out. So what lies at a place is on average
/// above the surface, by about the relative range noise (1 % is assumed) times the noise across it:
/// `rise`, known to a half of it. Along the way the points are on average off by what var(e) sin a
/// cos a changes, with e the error along a ray that meets the surface at the angle a. That tilts a
/// plane whose noise is uneven, as it is beyond a crease, where rays from before it meet the road
/// steeper or flatter. Standard deviation: 0.08 of the noise over the points' root mean square
/// distance, times the relative change of the variance, found on made clouds of chains of planes.
struct UnknownRays {
  double rise = 0.0;                    ///< m
  double slope_u = 0.0, slope_v = 0.0;  ///< rad, standard deviations along the window's axes
};

/// From the residuals' variance and how it changes along the axes of a window. Slopes are zero
/// without a window or with fewer than 200 points. @param points  weights up to date for the plane
UnknownRays unknown_rays(const PointArrays& points, const PivotPlane& plane,
                         const PlaneWindow& window);

/// Covariance of the M-estimator, condition and status. axis1 is the direction of largest spread.
/// @param full        kNewton sums at the plane over all points
/// @param influence   kNewton sums with psi^2 over all or a part of them
/// @param shared      m, standard deviation of an error that all points may share, and that may
/// vary
///                    over them as slowly as a plane's height does; the covariance holds it
/// @param rays        given where viewing rays are not known: the plane is lowered by the rise, and
///                    the covariance holds what is not known of it
PlaneEstimate estimate_covariance(const PivotPlane& plane, const PlaneWindow& window,
                                  const plane_kernels::Moments& full,
                                  const plane_kernels::Moments& influence,
                                  const Eigen::Vector3d& up, const std::optional<UnknownRays>& rays,
                                  double shared = 0.0);

/// One plane of several that may be the answer.
struct PlaneCandidate {
  PivotPlane plane;
  PlaneWindow window;
  NoiseModel noise;
  double gain = 0.0;     ///< of a search: how much below "nothing lies on it" its cost is
  double support = 0.0;  ///< points on it
};

/// Draws rows of a set by numbers that the rows bear, not by their place in it: a row more or less
/// changes few draws, where the k-th of the set would be another row from there on.
class KeyedDraws {
 public:
  KeyedDraws();
  void clear();
  void add(std::uint64_t key, std::uint32_t row);
  /// A row for 64 random bits; at least one row must have been added.
  std::uint32_t draw(std::uint64_t bits) const;

 private:
  static constexpr std::size_t kSlots = 256;
  static constexpr std::uint32_t kNone = 0xFFFFFFFFu;
  std::array<std::uint64_t, kSlots> key_;  // the least in each slot
  std::array<std::uint32_t, kSlots> row_;
};

/// Noise by neighbourhoods of points that lie in rows [first, second): in each the best of a few
/// minimal samples (least quantile of squares), then the residuals of a refit; the noise of the
/// cloud is a low quantile over neighbourhoods, so that those with kerbs, cars or creases do not
/// count. Sets model->scale for kSame; for kPower the law, or kIsotropic if it cannot be learnt.
/// @param keys  a number for each row by which rows are drawn (see KeyedDraws); empty: by their
/// place in the neighbourhood
/// @param least  m, the smallest deviation to answer, > 0
void learn_local_noise(const PointArrays& points,
                       const std::vector<std::pair<std::size_t, std::size_t>>& neighbourhoods,
                       const std::vector<std::uint64_t>& keys, const Eigen::Vector3d& up,
                       double max_tilt, double least, std::uint64_t seed, NoiseModel* model);

/// Refines a candidate on its points: reweighted, then by Newton's steps, to convergence. Points'
/// weights are those of the candidate's plane afterwards.
/// @param near  it has been refined on much the same points: by Newton's steps at once
void refine_candidate(PointArrays* points, const Eigen::Vector3d& up, PlaneCandidate* candidate,
                      bool near = false);

/// Refines a candidate, re-estimates its noise (unless `fixed_noise`), finds the part of the plane
/// that the points cover evenly, and refines inside it. Outside it and towards its edges points
/// count less: noise along viewing rays carries points out over an edge on one side only, and
/// beyond a crease the next plane begins. Both would tilt the fit. With fewer than 600 inliers the
/// window widens, and below 400 it is open.
/// @param again  the candidate has been refined so on a part of these points already: its window
/// and its noise are found again, the plane is left as it is
void refine_and_window(PointArrays* points, const Eigen::Vector3d& up, double least_noise,
                       bool fixed_noise, PlaneCandidate* candidate, bool again = false);

}  // namespace camber
