#pragma once

#include <Eigen/Core>
#include <array>
#include <utility>
#include <vector>

#include "camber/vehicle/vehicle_estimate.h"

namespace camber {

/// Edges of the 36-keypoint wireframe: the closed loop 2-3-...-17-2 on each side, then the cross
/// bars i to i + 18 for i = 10 ... 17. 40 pairs of keypoint rows.
const std::vector<std::pair<int, int>>& wireframe_edges();

/// Triangles that close the wireframe to a body (both sides, hull, underside): rows of keypoints.
const std::vector<std::array<int, 3>>& wireframe_triangles();

/// The 12 edges of a box by OrientedBox::corners().
const std::array<std::pair<int, int>, 12>& box_edges();

/// Whether the estimate carries a wireframe: all keypoints finite and near its box.
bool has_wireframe(const VehicleEstimate& vehicle);

/// Whether a vehicle can be drawn in 3D: an answer was given and its box is finite.
bool has_box(const VehicleEstimate& vehicle);

/// Bodies that hide what lies behind them from the origin of their frame (a camera's centre).
class Occluders {
 public:
  /// The body of one vehicle, frame of the camera, m.
  void add(const std::array<Eigen::Vector3d, kNumKeypoints>& keypoints);

  /// Whether a body lies between the origin and a point, more than `tolerance` m before it.
  bool hides(const Eigen::Vector3d& point, double tolerance) const;

 private:
  struct Body {
    Eigen::Vector3d center = Eigen::Vector3d::Zero();
    double radius = 0.0;
    std::vector<std::array<Eigen::Vector3d, 3>> triangles;
  };
  std::vector<Body> bodies_;
};

}  // namespace camber
