#include "camber/scale/detail/road_shape.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

namespace camber::detail {

RoadShape::RoadShape(const Eigen::Vector3d& up, const RoadShapeVector& parameters)
    : parameters_(parameters), height_(std::exp(parameters[kLogHeight])) {
  const Eigen::Vector3d ahead = (Eigen::Vector3d::UnitZ() - up.z() * up).normalized();
  const Eigen::Vector3d right = ahead.cross(up);
  normal_ = (up + parameters[kTiltAlong] * ahead + parameters[kTiltAcross] * right).normalized();
  ahead_ = (ahead - ahead.dot(normal_) * normal_).normalized();
  right_ = ahead_.cross(normal_);
}

double RoadShape::depth(const Eigen::Vector3d& ray) const {
  constexpr double kFarthest = 200.0, kNone = std::numeric_limits<double>::quiet_NaN();
  const double down = normal_.dot(ray), along = ahead_.dot(ray), across = right_.dot(ray);
  const double bend = 0.5 * parameters_[kCurvature] * along * along +
                      parameters_[kTwist] * along * across +
                      0.5 * parameters_[kCrossCurvature] * across * across;
  const double change = parameters_[kCurvatureChange] * along * along * along / 6.0;
  // Height of the ray over the road at depth t: height + down t - bend t^2 - change t^3.
  double t = down < -0.01 ? std::min(-height_ / down, kFarthest) : 0.3 * kFarthest;
  for (int iteration = 0; iteration < 20; ++iteration) {
    const double value = height_ + t * (down - t * (bend + t * change));
    const double slope = down - t * (2.0 * bend + 3.0 * t * change);
    if (std::abs(value) < 1e-9 * height_) {
      return slope < 0 && t < kFarthest ? t : kNone;
    }
    // From a place where the ray rises over the road the first meeting lies nearer.
    const double next = slope < -1e-4 ? t - value / slope : 0.5 * t;
    t = std::clamp(next, 0.4 * t, std::min(2.0 * t, 1.5 * kFarthest));
  }
  return kNone;
}

}  // namespace camber::detail
