#pragma once

// Direct registration of one vehicle between two images.

#include <cstdint>
#include <optional>
#include <vector>

#include "camber/geometry/pinhole_camera.h"
#include "camber/geometry/se3.h"
#include "camber/motion/correspondences.h"
#include "camber/vehicle/detail/blurred_crop.h"
#include "camber/vehicle/vehicle_estimate.h"
#include "camber/vehicle/vehicle_noise.h"

namespace camber::internal {

/// How the picture of a vehicle moved from one image to another.
struct VehicleShift {
  Eigen::Vector3d anchor;        ///< a place on its surface, camera frame of the first image
  Eigen::Vector2d displacement;  ///< px, of the anchor's pixel, first image to second
  double log_depth_ratio = 0.0;  ///< of the anchor: log(depth in the second / in the first)
  /// Covariances of (displacement, log_depth_ratio): by the noise of the intensities and what the
  /// second image shows otherwise than it should (sampling, reflections); and by the same of the
  /// first image, an error that all registrations of one template have in common.
  Eigen::Matrix3d noise, shared;
  /// d(displacement, log_depth_ratio) / d(relative error of the body's depth), and that error's
  /// standard deviation: in common, too.
  Eigen::Vector3d by_depth;
  double depth_sigma = 0.0;
  double correlation = 0.0;  ///< of the intensities, registered
};

/// The pixels of one vehicle in one image, to be found again in others by their intensities.
///
/// Each pixel inside the outline of the vehicle's keypoints has the depth of their convex hull, so
/// that the three components of the vehicle's translation between two cameras, over its depth, are
/// left, beside a gain and an offset of the intensities: iteratively reweighted Gauss-Newton on two
/// levels of blur (Lucas and Kanade, "An Iterative Image Registration Technique", 1981). What the
/// keypoints of single images show of that motion to a pixel, the intensities show to a tenth.
class VehicleTemplate {
 public:
  /// @param vehicle  as it is in the image, with keypoints.
  /// @param nearer   vehicles that may hide it: their outlines are left out.
  /// @param vehicle_mask  of the image, one byte a pixel; or null. Where it shows no vehicle,
  ///                      the pixels are left out: something else may hide this one.
  /// @return nothing where too little of the vehicle is seen.
  static std::optional<VehicleTemplate> cut(
      const PinholeCamera& camera, const GrayImage& image, const VehicleEstimate& vehicle,
      const std::vector<const VehicleEstimate*>& nearer, const RegistrationNoise& noise = {},
      const std::vector<std::uint8_t>* vehicle_mask = nullptr);

  /// @param second_from_first  of points on the vehicle; the rotation is held, the translation is
  ///                           the start and should be right to a few pixels.
  /// @return nothing where the vehicle leaves the image or the intensities disagree.
  std::optional<VehicleShift> find_in(const GrayImage& second, const SE3& second_from_first) const;

 private:
  struct Pixel {
    Eigen::Vector3d ray;
    double inverse_depth;  // anchor's depth over its own
    double coarse, fine;   // intensities, blurred
  };
  struct Alignment;
  /// Intensities here and there with the gradient by the translation over the depth.
  /// @return false: part of the vehicle comes behind the camera.
  bool sample(const BlurredCrop& crop, bool fine, Alignment* alignment) const;
  /// One reweighted step on the samples; false: too little contrast or overlap.
  bool improve(double blur, Alignment* alignment) const;
  VehicleShift shift(const Alignment& alignment, const Eigen::Vector3d& y) const;

  PinholeCamera camera_;
  RegistrationNoise noise_;
  std::vector<Pixel> pixels_;
  Eigen::Vector2d anchor_ = Eigen::Vector2d::Zero();  // px
  double depth_ = 0.0;                                // m, of the anchor
  double extent_ = 0.0;                               // px, root mean square about the middle
  double step_ = 1.0;                                 // px, between pixels
  double coarse_ = 0.0;                               // px, blur of the first level
};

}  // namespace camber::internal
