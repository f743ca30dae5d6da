#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <utility>
#include <vector>

namespace camber {

/// How the noise of points shows across a plane.
enum class NoiseKind {
  kSame,       ///< one standard deviation for all: `scale`
  kIsotropic,  ///< scale * sigma of the point
  kPower,      ///< scale * sigma ^ exponent, learnt from the cloud
  kRays,       ///< scale * sigma along the ray from the viewpoint, hit at the plane's grazing angle
  kCovariance,  ///< scale^2 n' C n with the point's covariance C
};

/// Least share of a ray's sigma that shows across a plane, however grazing the ray is: noise across
/// the ray and the plane's own roughness do not vanish with the angle.
inline constexpr double kGrazingFloor = 0.02;

/// Whether a point has a sigma that weighs it: above 0 and finite.
bool any_usable_sigma(const std::vector<float>& sigmas);

/// Turns what is known about each point into the variance along a plane's normal. Coordinates and
/// planes are relative to a pivot of the caller's.
struct NoiseModel {
  NoiseKind kind = NoiseKind::kSame;
  double scale = 1.0;
  double exponent = 1.0;
  double least = 0.0;  ///< m, smallest standard deviation along a normal, >= 0
  Eigen::Vector3d viewpoint = Eigen::Vector3d::Zero();
  std::vector<float> table;  ///< kPower: weights by the sigma's leading bits; see tabulate()
  std::uint32_t first = 0;

  /// Prepares kPower for sigmas between low and high, each > 0; others take the nearer end.
  void tabulate(double low, double high);

  /// Multiplies every standard deviation.
  void rescale(double factor);

  /// Sets w[i] to 1 / variance along the plane's normal for every i with w[i] > 0; 0 where the
  /// point's sigma or covariance is not usable.
  void weigh(const Eigen::Vector3d& normal, double offset, std::size_t n, const float* x,
             const float* y, const float* z, const float* sigma,
             const std::array<float, 6>* covariance, float* w) const;

 private:
  void weigh_without_least(const Eigen::Vector3d& normal, double offset, std::size_t n,
                           const float* x, const float* y, const float* z, const float* sigma,
                           const std::array<float, 6>* covariance, float* w) const;
};

/// The value below which `share` of the values lie; reorders them. @param values not empty.
double quantile(std::vector<float>& values, double share);

/// Standard deviation of the normal part of n residuals over an even background within `reach`
/// (expectation maximisation on a histogram). Returns `start` for fewer than 20 within reach.
double core_deviation(const float* residuals, std::size_t n, double start, double reach);

/// Learns a power law "deviation = scale * sigma ^ exponent" from pairs (sigma, |residual|).
/// Residuals above 8 * typical are left out. False, with the model as it was, if there are too few.
bool learn_power_law(std::vector<std::pair<float, float>>& pairs, double typical, double least,
                     NoiseModel* model);

}  // namespace camber
