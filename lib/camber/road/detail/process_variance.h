#pragma once

#include <cmath>

namespace camber::detail {

/// m, over which a cloud's drift is alike along a road.
inline constexpr double kDriftLength = 20.0;

/// Variance of a weighted sum of the values of a process with the covariance
/// sigma_i sigma_j exp(-|s_i - s_j| / length), added station by station in their order.
class ProcessVariance {
 public:
  explicit ProcessVariance(double length) : length_(length) {}
  void add(double station, double weighted_sigma) {
    carried_ *= std::exp(-(station - last_) / length_);
    variance_ += weighted_sigma * (weighted_sigma + 2.0 * carried_);
    carried_ += weighted_sigma;
    last_ = station;
  }
  double variance() const { return variance_; }

 private:
  double length_, last_ = 0.0, carried_ = 0.0, variance_ = 0.0;
};

}  // namespace camber::detail
