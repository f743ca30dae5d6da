#pragma once

namespace camber::detail {

/// Where half of the metres of a straight piece of ground lie between its ends in the image, by
/// the inverse depths of the near and the far end: 0 is at the near one, 1 at the far one.
inline double metric_middle_share(double near, double far) {
  const double middle = 2.0 * near * far / (near + far);
  return (middle - near) / (far - near);
}

}  // namespace camber::detail
