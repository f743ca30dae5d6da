#pragma once

namespace camber {

/// How well a camera's intrinsics are known: standard deviations, finite and >= 0; 0: taken for
/// exact.
struct CameraSigma {
  double focal = 0.0;       ///< relative, of fx and fy together
  double principal = 0.0;   ///< px, of cx and of cy
  double distortion = 0.0;  ///< of the first radial coefficient (k1): r (1 + k1 r^2)

  bool exact() const { return focal == 0.0 && principal == 0.0 && distortion == 0.0; }
};

}  // namespace camber
