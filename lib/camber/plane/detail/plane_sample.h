#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <utility>
#include <vector>

#include "camber/plane/plane_solver.h"

namespace camber::detail {

/// The points of a cloud as plain arrays, m: every `stride`-th element of x, y and z is a point's.
struct PointColumns {
  const float *x = nullptr, *y = nullptr, *z = nullptr;
  std::size_t stride = 1;
  const float* sigma = nullptr;                      ///< m, a number a point; may be nullptr
  const std::array<float, 6>* covariance = nullptr;  ///< m^2, one a point; may be nullptr
  std::size_t size = 0;
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();  ///< added to all points
};

inline constexpr std::size_t kPlaneSample = 8192;  ///< points on which a plane is searched

/// A part of a cloud on which a plane is searched and refined, relative to a pivot.
struct PlaneSample {
  std::array<float, 3> pivot{0, 0, 0};  ///< m, without the cloud's origin
  double spread = 0.0;                  ///< m, 90 % of the points lie within it of the pivot
  double least_noise = 0.0;             ///< m, what float coordinates resolve
  std::size_t usable = 0;               ///< points of the subset
  PointArrays subset;                   ///< in the order of the input
  PointArrays ordered;                  ///< part of it, in order of neighbourhood
  PointArrays scored;                   ///< every other of that
  std::vector<std::pair<std::size_t, std::size_t>> leaves;  ///< neighbourhoods, rows of `ordered`
  double copies = 1.0;                                      ///< see take_copies()
};

/// Draws the subset, one point from each of equal slices of the input (all of a small cloud), and
/// fills all but `ordered`, `scored` and `leaves`. False with fewer than three usable points.
/// Same seed, same subset.
bool choose_subset(const PointColumns& source, std::uint64_t seed, PlaneSample* sample);

/// Fills `ordered`, `scored` and `leaves` from the subset. @param up  of unit length
void order_by_neighbourhood(const Eigen::Vector3d& up, PlaneSample* sample);

}  // namespace camber::detail
