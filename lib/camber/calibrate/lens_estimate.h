#pragma once

#include <vector>

#include "camber/calibrate/drive_lens.h"
#include "camber/calibrate/window_bundle.h"

namespace camber {

/// What is known of a vehicle's or a dash camera before its drive is seen: independent normal
/// distributions.
struct LensPrior {
  DriveLens mean;
  DriveLens::Vector sigma;  ///< of DriveLens::parameters(), > 0
};

/// How far a lens is off a prior, in its standard deviations.
DriveLens::Vector prior_error(const LensPrior& prior, const DriveLens& lens);

/// Cars and dash cameras: a horizontal field of view of 35 to 130 degrees within two standard
/// deviations of the focal length's logarithm, the principal point 2.5 % of the width about the
/// middle, k1 = 0 +- 0.2, k2 = 0 +- 0.03, the optical axis straight on within 5 degrees.
/// @throws std::invalid_argument for a size that is not positive.
LensPrior lens_prior_of_cars(int width, int height);

struct LensEstimateOptions {
  double loss_width = 2.0;    ///< standard deviations, BundleLoss
  double trim = 4.0;          ///< standard deviations: tracks with a larger error are left out, > 0
  double least_sigma = 0.15;  ///< px, of a tracked coordinate: far points alone show less, > 0
  int rounds = 3;             ///< of noise, trimming and adjustment after the first, >= 0
  /// Tracked pixels err alike over neighbouring points and frames: the covariance is that of
  /// independent errors times this at least, >= 1.
  double correlation = 4.0;
  // What all windows have in common, as a lens that is not quite radial or features that are
  // followed with a bias: standard deviations. KITTI's rectified drives 03 and 0095: -1.7 and
  // -2.6 % with 0.2 and 1.4 % by the windows; 5 and 12 px of 1242 with 1 and 3 px.
  double focal_floor = 0.012;      ///< relative, >= 0
  double principal_floor = 0.008;  ///< of the width, >= 0
  double distortion_floor = 0.01;  ///< of k1, >= 0
  int num_threads = 0;             ///< <= 0: see resolve_num_threads
};

/// The lens by the epipolar geometry of all windows together.
struct LensEstimate {
  DriveLens lens;
  DriveLens::Matrix covariance = DriveLens::Matrix::Zero();  ///< of parameters(), with the prior
  double pixel_sigma = 0.0;                                  ///< px, of a coordinate
  double inflation = 1.0;  ///< of the covariance over that of independent errors
  std::size_t points = 0, observations = 0;
  double cost = 0.0;  ///< of the loss with the prior's
  double sigma(int parameter) const;
};

/// Joint bundle adjustment of all windows with one lens (self-calibration: Hartley and Zisserman,
/// Multiple View Geometry, 2nd ed., 19.1 and 19.3), Levenberg and Marquardt, with the prior. What
/// the windows know is divided by how much more their scores spread than their curvature lets
/// expect (White, "Maximum likelihood estimation of misspecified models", Econometrica 1982), and
/// by how much the answer contradicts the prior.
/// @param windows  changed: their poses and points; points that move on their own are left out.
/// @throws std::invalid_argument without windows.
LensEstimate estimate_lens(const DriveLens& start, const LensPrior& prior,
                           const LensEstimateOptions& options, std::vector<WindowBundle>* windows);

}  // namespace camber
