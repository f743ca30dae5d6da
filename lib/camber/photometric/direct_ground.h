#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "camber/core/status.h"
#include "camber/geometry/pinhole_camera.h"
#include "camber/geometry/se3.h"
#include "camber/motion/correspondences.h"
#include "camber/motion/motion.h"
#include "camber/photometric/intensity_noise.h"
#include "camber/road/ground_field.h"

namespace camber {

/// One image of a run.
struct DirectImage {
  const GrayImage* image = nullptr;
  /// One byte a pixel, row-major: non-zero where something stands or moves; null: nowhere.
  const std::vector<std::uint8_t>* ignored = nullptr;
};

struct DirectOptions {
  int steps = 2;          ///< linearisations, the first on blurred images, >= 1
  double held_out = 0.2;  ///< share of the pixels that only judge, [0, 0.5]
  IntensityNoise noise;
  int num_threads = 0;    ///< <= 0: see resolve_num_threads
  void validate() const;  ///< throws std::invalid_argument
};

/// Costs of the pixels that take no part in the fit: min(r^2, 9), r in standard deviations.
struct HeldOutPixels {
  struct Pixel {
    float u, v, cost;
  };
  std::vector<std::vector<Pixel>> images;  ///< one list for every image but the reference
  std::vector<double> noise;  ///< robust standard deviation of a residual, in local contrasts
};

/// Two judgements of the same held-out pixels, in the units of the first, by cells of the image.
class DirectEvidence {
 public:
  DirectEvidence() = default;
  DirectEvidence(int width, int height, const HeldOutPixels& before, const HeldOutPixels& after);

  struct Costs {
    double pixels = 0.0, before = 0.0, after = 0.0;  ///< count; mean costs
  };
  /// Over the cells that a box of the image touches, px.
  Costs within(const Eigen::Vector2d& least, const Eigen::Vector2d& greatest) const;

 private:
  int columns_ = 0, rows_ = 0;
  std::vector<Costs> cells_;  // sums
};

struct DirectResult {
  Status status = Status::kNotRun;  ///< kFailed: see reason; the field is as it was
  std::string reason;
  std::vector<SE3> frame_from_reference;
  Eigen::MatrixXd covariance;  ///< as MotionEstimate::covariance, with what the ground adds
  /// Mahalanobis distance by which the motion moved, over the square root of its parameters.
  double motion_change = 0.0;
  /// What the pixels measure of the ground, one entry a pixel and image, at the refined motion.
  GroundObservations observations;
  /// One byte a pixel of the reference: where the images contradict the ground (moving shadows,
  /// reflections, things that stand there).
  std::vector<std::uint8_t> contradicted;
};

/// Refines the ground and the camera's motion on the intensities of all images at once (direct
/// alignment; Irani and Anandan, "About Direct Methods", 1999, for plane plus parallax).
///
/// A change of the inverse depth at a pixel of the reference moves where it is seen in another
/// image; there the intensities, local mean and contrast taken out over a window, must agree with
/// the reference's. To first order each pixel is one observation of the inverse depth, with the
/// camera's motion as shared parameters, so that the ground's smoothness, its robust losses and its
/// covariance are those of GroundField. The motion is anchored by the covariance with which it
/// comes: what the points off the road know. Left out are pixels that something covers in either
/// image and neighbourhoods that contradict the ground altogether: edges of moving shadows.
class DirectGround {
 public:
  /// @param ground  one byte a pixel of the reference: non-zero where ground is seen.
  /// @param top     first row of interest, px.
  /// @throws std::invalid_argument for sizes that disagree. The images must outlive this.
  DirectGround(const PinholeCamera& camera, const std::vector<DirectImage>& images,
               std::size_t reference, const std::vector<std::uint8_t>& ground, int top,
               const DirectOptions& options);
  ~DirectGround();

  /// Refines `field` in place, and the motion. Units: those of `motion`.
  DirectResult refine(const MotionEstimate& motion, GroundField& field) const;

  /// How well the held-out pixels agree with a ground and a motion.
  HeldOutPixels judge(const std::vector<SE3>& frame_from_reference, const GroundField& field) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace camber
