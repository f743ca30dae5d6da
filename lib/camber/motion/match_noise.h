#pragma once

namespace camber {

/// Errors of matched pixels and of the motion that they give. Behind each value: its unit, where it
/// comes from, and what measures it again:
///   [heights]  bench_main_job steep3 steep5: share of heights inside their stated intervals
///   [random]   tests/benchmarks/trust.py: scales and directions on random scenes
///   assumed    no measurement is known; its effect is held by the two above
struct MatchNoise {
  double intensity = 0.6;         ///< intensity, of a window's mean [heights]
  double least_texture = 0.05;    ///< (intensity / px)^2, added to a window's; assumed
  double round_trip_share = 0.5;  ///< of a match's round-trip error that is an error of its own
  double cauchy_px = 0.3;      ///< px, half width of the loss of epipolar errors, at least; assumed
  double least_turn = 0.0125;  ///< rad, of a camera whose turn may show its focal length [random]
  /// The errors of a smooth flow are shared by neighbours: the motion's covariance is that of
  /// independent matches times this, >= 1. [random]
  double correlation = 16.0;
  /// Share of inliers below which the flow may have lost the image motion as a whole, and by how
  /// much more features have to agree with another motion, of all features. [random]
  double trusted_inliers = 0.9, feature_gain = 0.01;
};

}  // namespace camber
