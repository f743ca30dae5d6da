#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <string>
#include <vector>

#include "camber/core/status.h"
#include "camber/geometry/pinhole_camera.h"
#include "camber/geometry/plane.h"
#include "camber/scale/lane_marking_detection.h"
#include "camber/scale/painted_strokes.h"
#include "camber/scale/scale_noise.h"

namespace camber {

/// What one image's markings are looked at with. Standard deviations of the road's shape before.
struct MarkedRoadOptions {
  Eigen::Vector3d up{0.0, -1.0, 0.0};  ///< rough up direction, camera frame: gravity where known
  double tilt_along = 0.10;            ///< rad, the road below the camera against `up`, > 0
  double tilt_across = 0.05;           ///< rad, > 0
  double height = 1.65;                ///< m, of the camera above the road, > 0
  double log_height = 0.35;            ///< of its logarithm, > 0
  double curvature = 0.006;            ///< 1/m, vertical, > 0
  double curvature_change = 4e-4;      ///< 1/m^2, over the distance ahead, > 0
  double twist = 2e-3;                 ///< 1/m, change of the cross slope, > 0
  double cross_curvature = 5e-3;       ///< 1/m, across the view: crowns of 1 to 2 %, > 0
  /// rad, by which a real road's slope is off the smooth shape from place to place, >= 0 (even
  /// numbers of single_image_markings: 0.0145 over 30 m).
  double slope_off_shape = 0.0145;
  /// m, the camera's height where it is known; 0: it is not. It takes no part but where several
  /// roads explain the markings about as well: then that of the likeliest height is taken.
  double known_height = 0.0;
  double known_height_sigma = 0.01;  ///< m, > 0
  ScaleNoise noise;
  int num_threads = 0;    ///< <= 0: see resolve_num_threads
  void validate() const;  ///< throws std::invalid_argument
};

enum class MarkingKind { kDash, kCrossing };
std::string to_string(MarkingKind kind);  ///< "dash", "crossing"

/// One marking of known size in the image.
struct SeenMarking {
  MarkingKind kind = MarkingKind::kDash;
  Eigen::Vector2d pixel{0, 0};     ///< of its middle on the ground
  Eigen::Vector2d near_end{0, 0};  ///< px, the middle of its near end
  Eigen::Vector2d far_end{0, 0};   ///< px
  double length = 0.0;             ///< m, along the road
  int strokes = 1;                 ///< stripes of a crossing
  bool beside = false;             ///< another marking is seen side by side, or it is a crossing
};

/// The road ahead as the markings of one image alone show it, in metres: no height of the camera is
/// used but as a rough prior.
struct MarkedRoad {
  static constexpr int kShape = 7;  ///< parameters, see detail/road_shape.h
  Status status = Status::kNotRun;  ///< kOk, or kFailed with a reason: what is missing
  std::string reason;
  std::vector<SeenMarking> markings;  ///< that take part, nearest first; no lines
  std::vector<std::size_t> strokes;   ///< indices of those that take part, of lines too
  int dashes = 0, crossings = 0, lines = 0;
  double nearest = 0.0, farthest = 0.0;  ///< m, depths of what takes part
  double slope_off_shape = 0.0;          ///< rad, see the options
  double misfit = 0.0;                   ///< mean square of the residuals, variances
  /// Half squared standard deviations by which what is measured fits better than chance, and the
  /// same of the best other road, that differs by more than its sigmas: the covariance holds it
  /// too, by its share.
  double evidence = 0.0, evidence_of_other = 0.0;
  /// The road's shape: parameters and their covariance, without the paint's common size error.
  Eigen::Matrix<double, kShape, 1> shape = Eigen::Matrix<double, kShape, 1>::Zero();
  Eigen::Matrix<double, kShape, kShape> covariance = Eigen::Matrix<double, kShape, kShape>::Zero();
  Eigen::Vector3d up{0.0, -1.0, 0.0};  ///< that the shape is counted from

  /// Inverse depth (1/m) of the ground at a pixel; NaN where the ray meets none.
  double inverse_depth(const PinholeCamera& camera, const Eigen::Vector2d& pixel) const;
  /// d(inverse depth) / d(shape).
  Eigen::Matrix<double, 1, kShape> by_shape(const PinholeCamera& camera,
                                            const Eigen::Vector2d& pixel) const;
  /// The tangent plane below the camera, with d(tilt, tilt, height) / d(shape). Its covariance also
  /// has what the road from there to the nearest marking may be off the shape.
  UncertainPlane ego(Eigen::Matrix<double, 3, kShape>* by_shape = nullptr) const;
};

/// Finds the road from markings of known size in one image: strokes are found without any ground;
/// over a grid of planes those whose lengths, widths and distances fit the sizes are looked for,
/// and the shape is solved from the best of them on by least squares with Cauchy weights. The road
/// may bend and twist within the priors of the options.
/// @param strokes  of detect_painted_strokes().
MarkedRoad find_marked_road(const PinholeCamera& camera, const std::vector<PaintedStroke>& strokes,
                            const LaneMarkingSizes& sizes, const MarkedRoadOptions& options);

}  // namespace camber
