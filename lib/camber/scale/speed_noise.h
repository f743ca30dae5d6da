#pragma once

#include <vector>

namespace camber {

/// A speed with the standard deviation that is stated of it.
struct TimedSpeed {
  double time_s = 0.0;
  double speed = 0.0;  ///< m/s
  double sigma = 0.0;  ///< m/s, > 0
};

/// Parts of the stated variances.
struct SpeedNoise {
  double independent = 0.5;  ///< differs from sample to sample; above 1 where they scatter more
  double common = 0.5;       ///< shared by all samples: a wheel's size, a clock
};

/// How much of the stated variance is independent from sample to sample, by the scatter of the
/// speeds about a smooth drive: a vehicle's acceleration changes little in a tenth of a second. The
/// rest is common, which a smooth curve does not show. Posterior mean over the part and over how
/// rough the drive is; with few samples about a half each.
/// The likelihood is a Kalman filter's of speed and acceleration, the latter a random walk
/// (Harvey, "Forecasting, Structural Time Series Models and the Kalman Filter", 1989, section 3.4).
/// @param samples  at ascending times. @throws std::invalid_argument for others, or a sigma of 0.
SpeedNoise speed_noise(const std::vector<TimedSpeed>& samples);

}  // namespace camber
