#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

#include "camber/geometry/plane.h"
#include "camber/plane/noise_model.h"
#include "camber/plane/plane_kernels.h"

namespace camber {

// What fits of one plane and of many share: points in separate arrays relative to a pivot, robust
// normal equations inside a window of a plane, and their solution.

inline constexpr double kBiweight = 4.685;    ///< standard deviations; 95 % efficient, normal noise
inline constexpr double kInlierSigmas = 2.5;  ///< standard deviations

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

/// One plane of several that may be the answer.
struct PlaneCandidate {
  PivotPlane plane;
  PlaneWindow window;
  NoiseModel noise;
  double gain = 0.0;     ///< of a search: how much below "nothing lies on it" its cost is
  double support = 0.0;  ///< points on it
};

/// Refines a candidate on its points: reweighted, then by Newton's steps, to convergence. Points'
/// weights are those of the candidate's plane afterwards.
/// @param near  it has been refined on much the same points: by Newton's steps at once
void refine_candidate(PointArrays* points, const Eigen::Vector3d& up, PlaneCandidate* candidate,
                      bool near = false);

}  // namespace camber
