#pragma once

// Likelihood of a detection box, which holds what the image shows of the vehicle: each of its sides
// is made by the body's outermost point, or, where the body reaches beyond the image, by the
// border.

#include <array>

#include "camber/vehicle/detail/body.h"
#include "camber/vehicle/detail/normal_equations.h"
#include "camber/vehicle/vehicle_noise.h"

namespace camber::internal {

class BoxLikelihood {
 public:
  /// @param num_views  of the same vehicle: the body's own outline is off the prior's points by the
  ///                   same in all of them, and counts once.
  BoxLikelihood(const PinholeCamera& camera, const Box2& box, const BoxNoise& noise, int num_views);

  /// A side of the box and the point of the body that makes it.
  struct Side {
    int point = 0;
    int axis = 0;           ///< 0: u, 1: v
    double residual = 0.0;  ///< of the point's pixel along the axis, px
    /// 1 / px^2, with its robust weight; 0: the image's border makes the side
    double information = 0.0;
    double squared = 0.0;  ///< residual in standard deviations, squared
  };
  using Sides = std::array<Side, 4>;  ///< left, right, upper, lower
  Sides sides(const BodyView& at) const;

  /// Where the image's border cuts the box, px; infinite at sides that it does not cut.
  Box2 cuts() const;

  /// Adds its minus log density, optionally with its normal equations. @return minus log density
  double add(const BodyView& at, NormalEquations* equations) const;

 private:
  struct Edge {
    int axis;     // 0: u, 1: v
    double sign;  // the body's largest sign * pixel coordinate makes this edge
    double pixel;
    double sigma;             // px
    double border;            // px, of the image there
    bool at_border = false;   // cut by the image, wherever within some px the detector has the side
    bool may_be_cut = false;  // near enough that the body may reach beyond the image
  };
  std::array<Edge, 4> edges_;
  double gate_squared_;
};

/// The body's box in the image; all of it must be in front of the camera.
Box2 outline(const BodyView& at);

}  // namespace camber::internal
