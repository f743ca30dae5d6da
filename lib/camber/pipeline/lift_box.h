#pragma once

#include <optional>

#include "camber/pipeline/kitti_boxes.h"
#include "camber/road/road_surface.h"

namespace camber {

/// Noise of the measurements that lift_box() joins. Where no source is named a value is assumed.
struct LiftOptions {
  /// Standard deviation of the detector's distance, as a share of it, in (0, 10]. Monocular
  /// detectors are off by 5 to 15 % (assumed).
  double depth_sigma = 0.08;
  /// Standard deviation of the detector's 3D height, as a share of it, > 0. It is joined with the
  /// size prior of the class (shape_prior.h) unless the two contradict each other.
  double size_sigma = 0.05;
  double pixel_sigma = 1.5;  ///< px, of the row of the 3D box's centre, >= 0
  /// Standard deviation of the upper and the lower side of the 2D box: px, > 0, and a share of the
  /// box's height, >= 0; as BoxNoise (vehicle_noise.h), which was measured on rendered scenes.
  double box_pixel_sigma = 1.0;
  double box_share = 0.025;
  /// m, of the 3D box's bottom off the ground it stands on, >= 0: KITTI's label boxes are upright
  /// and reach 0.04 to 0.11 m below the estimated road (tracking 0009, nearer than 25 m).
  double height_sigma = 0.08;
  /// m, added to the surface's height where it is extrapolated, >= 0: kerbs and verges.
  double step_sigma = 0.10;
  /// rad, > 0: a road's slope against the camera's level. A patch of unknown tilt gives its
  /// vehicles none.
  double tilt_sigma = 0.15;
  double reach = 5.0;  ///< m, beyond a patch's boundary, to which it is extrapolated, >= 0
  /// Standard deviations, > 0, beyond which two sources contradict each other.
  double gate = 3.0;
  /// Ratio of width to height of the 2D box against the projected 3D box's, in (0, 1): beyond
  /// 1 + tolerance or its inverse (and its sides' noise) the box is cut by the image or by what
  /// stands before it.
  double aspect_tolerance = 0.2;
  void validate() const;  ///< throws std::invalid_argument
};

/// The surface by the ground alone: planes that hold what a vehicle on them measured, without it.
/// That vehicle's box would count twice.
RoadSurface surface_without_vehicles(RoadSurface surface);

/// Estimates the distance of a yaw-only 3D box along the ray of its centre, and puts it on the road
/// below it. The distance's logarithm, the row of the centre and the logarithm of the height are
/// joined from the detector's distance and row, the sides of its 2D box (pinhole: distance by
/// height, with the prior on the height) and the surface's height with its standard deviation,
/// each one against the others before it is used: a 2D box or a surface that contradicts is left
/// out and named in `reason`. On the surface the box takes the patch's pitch and roll; rotation_y
/// and the sizes stay as they are.
/// @param surface  metric, by surface_without_vehicles().
/// @param camera_from_reference  takes the surface's frame to the row's camera; none: the surface
///                 does not know this frame, and the 2D box alone corrects the distance.
/// @param camera  of the images; labels are in camera 0: x_in_camera = x_in_camera0 + its offset,
///                m.
LiftedBox lift_box(const KittiLabel& label, const RoadSurface& surface,
                   const std::optional<SE3>& camera_from_reference,
                   const KittiCalibration::Camera& camera, const LiftOptions& options);

}  // namespace camber
