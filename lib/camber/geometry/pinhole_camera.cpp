#include "camber/geometry/pinhole_camera.h"

#include <cmath>
#include <sstream>
#include <stdexcept>

namespace camber {
namespace {

void require(bool good, const char* field, double value, const char* expected) {
  if (good) return;
  std::ostringstream message;
  message << field << " = " << value << ", expected " << expected;
  throw std::invalid_argument(message.str());
}

}  // namespace

Eigen::Matrix3d PinholeCamera::matrix() const {
  Eigen::Matrix3d k;
  k << fx, 0, cx, 0, fy, cy, 0, 0, 1;
  return k;
}

void PinholeCamera::validate() const {
  require(width > 0, "width", width, "a positive number of pixels");
  require(height > 0, "height", height, "a positive number of pixels");
  require(std::isfinite(fx) && fx > 0, "fx", fx, "a positive number of pixels");
  require(std::isfinite(fy) && fy > 0, "fy", fy, "a positive number of pixels");
  require(std::isfinite(cx), "cx", cx, "a finite number of pixels");
  require(std::isfinite(cy), "cy", cy, "a finite number of pixels");
}

}  // namespace camber
