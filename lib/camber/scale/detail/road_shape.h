#pragma once

#include <Eigen/Core>

namespace camber::detail {

/// Parameters of a road as one camera sees it, in this order.
enum RoadShapeParameter {
  kTiltAlong,        ///< rad, of the tangent plane below the camera, about the axis to the right
  kTiltAcross,       ///< rad, about the axis ahead
  kLogHeight,        ///< of the camera above that plane, log m
  kCurvature,        ///< 1/m, vertical, at the camera; > 0: a sag
  kCurvatureChange,  ///< 1/m^2, over the distance ahead
  kTwist,            ///< 1/m, change of the cross slope over the distance ahead
  kCrossCurvature,   ///< 1/m, across the view; > 0: the sides rise
  kRoadShapeParameters
};
using RoadShapeVector = Eigen::Matrix<double, kRoadShapeParameters, 1>;
using RoadShapeMatrix = Eigen::Matrix<double, kRoadShapeParameters, kRoadShapeParameters>;

/// A smooth road ahead of a camera: a plane below it, bent along the view and twisted.
class RoadShape {
 public:
  /// @param up  rough up direction in the camera frame, of which the tilts are counted.
  RoadShape(const Eigen::Vector3d& up, const RoadShapeVector& parameters);

  const RoadShapeVector& parameters() const { return parameters_; }
  Eigen::Vector3d normal() const { return normal_; }
  double height() const { return height_; }
  Eigen::Vector3d ahead() const { return ahead_; }
  Eigen::Vector3d right() const { return right_; }

  /// Depth along the optical axis at which a ray (z = 1) first meets the road, m; NaN: it does not
  /// within 200 m.
  double depth(const Eigen::Vector3d& ray) const;
  /// The point there, camera frame; NaN where there is none.
  Eigen::Vector3d point(const Eigen::Vector3d& ray) const { return depth(ray) * ray; }

 private:
  RoadShapeVector parameters_;
  Eigen::Vector3d normal_, ahead_, right_;
  double height_;
};

}  // namespace camber::detail
