#pragma once

namespace camber {

/// Errors of compared intensities. Behind each value: its unit, where it comes from, and what
/// measures it again:
///   [heights]  bench_main_job steep3 steep5: heights and their stated intervals
///   assumed    no measurement is known; its effect is held by the benchmark above
struct IntensityNoise {
  /// Information of neighbouring pixels is divided by this, >= 1; 1 and 2 were worse from five
  /// frames (docs/notes/scale-and-ego-plane.md). [heights]
  double correlation = 4.0;
  /// Factor on the variances that the pixels alone would leave of the motion, >= 1: errors that
  /// whole stretches of road share. [heights]
  double inflation = 4.0;
  /// px, error of a pixel along its gradient beside the noise of the intensities, >= 0; assumed.
  double misregistration_px = 0.2;
  /// px, misalignment that the refinement may still mend and that leaves no pixel out; assumed.
  double mended_px = 0.5;
  /// Intensity: a window's contrast below this is not blown up; assumed.
  double least_contrast = 2.0;
};

}  // namespace camber
