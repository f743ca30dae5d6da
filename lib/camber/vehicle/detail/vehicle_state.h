#pragma once

// Unknowns of one vehicle in one or more views, and their places among the parameters.

#include <array>
#include <vector>

#include "camber/geometry/se3.h"
#include "camber/vehicle/detail/body.h"
#include "camber/vehicle/detail/normal_equations.h"

namespace camber::internal {

/// Hypotheses on a vehicle that is seen in several views.
enum class Motion { kMoving, kParked };

struct VehicleState {
  std::vector<ViewPose> poses;               ///< one a view
  Form form;                                 ///< one for all views
  double log_scale = 0.0;                    ///< of the cameras' baselines
  ShapeErrors errors = ShapeErrors::Zero();  ///< from two views on; of one they are integrated out
  Motion motion = Motion::kMoving;
};

/// Parameters: a pose for each view, size, coefficients, log scale.
struct ParameterLayout {
  int num_views = 1;
  int num_coefficients = 0;
  int pose(int view) const { return kPoseParameters * view; }
  int size() const { return kPoseParameters * num_views; }
  int shape() const { return size() + kSizeParameters; }
  int scale() const { return shape() + num_coefficients; }
  int total() const { return scale() + 1; }
  int num_form() const { return kSizeParameters + num_coefficients; }
};

/// When and from where a view was taken.
struct ViewCamera {
  SE3 world_from_camera;  ///< m
  double time_s = 0.0;
  double sigma_turn = 0.0;   ///< rad, of world_from_camera against the other views'
  double sigma_shift = 0.0;  ///< m, likewise
};

}  // namespace camber::internal
