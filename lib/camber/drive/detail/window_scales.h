#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "camber/drive/trajectory.h"
#include "camber/drive/window_measurement.h"

namespace camber::detail {

/// A window with the places of its frames in the trajectory.
struct Measurement {
  const WindowMeasurement* window = nullptr;
  bool votes = false;  // on the scale of the drive
  double alike = 1.0;  // windows whose error is this one's, each by its correlation; itself 1
  std::vector<std::size_t> at;  // of its frames
  std::size_t reference = 0;    // index into the window's frames
  Eigen::MatrixXd covariance;   // of its relative poses, baselines

  std::size_t place() const { return at[reference]; }
};

/// Weight of a residual under Student's distribution against a normal one.
/// @param squared  sum over `dimension` of squared normalised residuals.
double student_weight(double squared, double dimension, double freedom);

/// Windows that have a motion, in their order, with whether they vote. One whose poses or
/// covariance are no numbers, or whose translations are no baselines, has none.
/// @param ids  every frame of the drive, ascending; those of the windows among them.
std::vector<Measurement> measurements_of(const std::vector<int>& ids,
                                         const std::vector<WindowMeasurement>& windows,
                                         const TrajectoryNoise& noise);

/// Relative: what the windows that vote share of the scale, the median of what each states. What
/// contradicts the camera in a few windows alone is not shared.
double common_sigma(const std::vector<Measurement>& measured);

/// Logarithms of the scales of all windows by their own, where they vote, and by the lengths that
/// neighbours share: where the smoother starts.
std::vector<double> start_scales(const std::vector<Measurement>& measured,
                                 const TrajectoryNoise& noise);

}  // namespace camber::detail
