#pragma once

#include <string>
#include <vector>

#include "camber/geometry/pinhole_camera.h"

namespace camber {

enum class LensModel {
  kNone,
  kBrown,    ///< k1 k2 p1 p2 [k3 [k4 k5 k6]]: radial (a ratio from k4 on) and tangential
  kFisheye,  ///< k1 k2 k3 k4: equidistant, theta (1 + k1 theta^2 + ... + k4 theta^8)
};

/// How the image files of a scene differ from its pinhole camera, in OpenCV's models.
struct LensDistortion {
  LensModel model = LensModel::kNone;
  std::vector<double> coefficients;  ///< in OpenCV's order
  PinholeCamera raw;                 ///< size and intrinsics of the image files

  /// Throws std::invalid_argument naming the first unusable field: not finite, or another number of
  /// coefficients than the model's (brown: 4, 5 or 8; fisheye: 4).
  void validate() const;
};

/// "none", "brown" or "fisheye".
std::string to_string(LensModel model);

}  // namespace camber
