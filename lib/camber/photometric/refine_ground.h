#pragma once

#include <cstdint>
#include <vector>

#include "camber/geometry/pinhole_camera.h"
#include "camber/geometry/se3.h"
#include "camber/motion/correspondences.h"
#include "camber/road/ground_field.h"

namespace camber {

struct RefineGroundOptions {
  struct Level {
    double blur_px;      ///< smoothing, coarse levels first
    int step;            ///< pixels between the samples
    int iterations;
  };
  std::vector<Level> levels = {{2.5, 3, 4}, {1.2, 2, 4}};
  double window_px = 9.0;       ///< high pass, standard deviation
  double min_shift_px = 0.05;   ///< parallax per relative depth below which a pixel says nothing
  double match_sigma_px = 0.25; ///< error of resampling and blur on strong edges, >= 0
  int num_threads = 0;
  void validate() const;        ///< throws std::invalid_argument
};

struct RefineGroundReport {
  double residual_before = 0.0;  ///< robust standard deviation of the grey residuals, finest level
  double residual_after = 0.0;
  long samples = 0;              ///< pixel and image pairs of the last iteration
};

/// Refines the ground field on the grey values of all images at once (direct alignment): each
/// ground pixel of the reference image is carried into every other image by the field and the
/// motion, and the field is moved until the grey values agree.
/// Gauss-Newton, coarse to fine, Cauchy loss (Irani, Anandan, "About Direct Methods", 1999; plane
/// plus parallax: Sawhney, CVPR 1994).
/// @param ground   one byte a pixel of the reference image: non-zero where the road is seen.
/// @param blocked  for each image one byte a pixel, non-zero where something stands on the road
///                 there (vehicles); an empty vector: nothing does.
/// @param frame_from_reference  poses as in MotionEstimate.
/// @return what changed; the linearised observations of the last step stay in `field`.
RefineGroundReport refine_ground(const PinholeCamera& camera, const std::vector<GrayImage>& images,
                                 int reference, const std::vector<std::uint8_t>& ground,
                                 const std::vector<std::vector<std::uint8_t>>& blocked,
                                 const std::vector<SE3>& frame_from_reference, GroundField& field,
                                 const RefineGroundOptions& options);

}  // namespace camber
