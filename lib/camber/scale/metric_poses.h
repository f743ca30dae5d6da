#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <string>
#include <vector>

#include "camber/geometry/se3.h"
#include "camber/motion/motion.h"
#include "camber/road/road_posterior.h"
#include "camber/scale/camera_uncertainty.h"

namespace camber {

/// Poses of one window's cameras in metres, with the errors that windows of the same camera share
/// kept apart: those of the windows' own parts are independent, and a drive's sigma must not shrink
/// by the others.
///
/// Rows of covariances: (rotation vector applied on the left, rad; translation, m) of every image's
/// pose but the reference's, in order, and last the logarithm of the metres per baseline.
struct MetricPoses {
  std::vector<SE3> frame_from_reference;  ///< one an image, m
  double log_scale = 0.0;                 ///< logarithm of the metres per baseline
  Eigen::MatrixXd own;                    ///< of the window's own errors
  /// "camera_height" (its mounting), "size_population" (of the vehicles), "focal_length",
  /// "principal_x", "principal_y", "distortion": what everything is off by one standard deviation
  /// of it. Independent of each other.
  std::vector<CommonError> common;

  /// Of own and common errors together.
  Eigen::MatrixXd covariance() const;
};

struct MetricPoseNoise {
  /// rad, of each rotation beside what the matches leave open: neighbouring flow bends by as much
  /// (bench_metric_poses, drives of even seeds), >= 0.
  double rotation = 4e-5;
};

/// The poses of a motion with the metres of its road. Road and motion share the errors of the
/// motion, and where the road was conditioned (RoadPosterior::conditioned) the motion is, too: what
/// gives the metres over a road also measures how the camera moved along it.
/// @param reference  image whose camera is the world.
/// @param road       whose shared parameters are the motion's, else std::invalid_argument.
/// @param camera     what is not known of it, see CameraUncertainty.
MetricPoses metric_poses(const MotionEstimate& motion, std::size_t reference,
                         const RoadPosterior& road, const CameraUncertainty& camera = {},
                         const MetricPoseNoise& noise = {});

}  // namespace camber
