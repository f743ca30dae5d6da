#include "camber/motion/path_curvature.h"

#include <Eigen/Geometry>
#include <cmath>

namespace camber {

double path_curvature(const std::vector<PlaceOnPath>& path, const PathNoise& noise) {
  double information = 1.0 / (noise.curvature * noise.curvature), moment = 0.0;
  const auto add = [&](double by_curvature, double value, double sigma) {
    information += by_curvature * by_curvature / (sigma * sigma);
    moment += by_curvature * value / (sigma * sigma);
  };
  for (const PlaceOnPath& p : path) {
    add(0.5 * p.ahead * p.ahead, p.right, noise.place);
    if (p.turn) add(p.ahead, *p.turn, noise.turn);
  }
  return moment / information;
}

std::vector<PlaceOnPath> path_places(const MotionEstimate& motion, std::size_t reference,
                                     double metres_per_baseline) {
  const Eigen::Vector3d travel = travel_direction(motion, reference);
  // The optical axes in plan: roads are nearly level in the camera's frame.
  const Eigen::Vector3d right = travel.cross(Eigen::Vector3d(0, -1, 0)).normalized();
  std::vector<PlaceOnPath> out;
  for (std::size_t k = 0; k < motion.frame_from_reference.size(); ++k) {
    if (k == reference) continue;
    const SE3 pose = motion.frame_from_reference[k].inverse();
    const Eigen::Vector3d place = metres_per_baseline * pose.translation();
    const Eigen::Vector3d axis = pose.rotation() * Eigen::Vector3d::UnitZ();
    out.push_back({travel.dot(place), right.dot(place), std::atan2(axis.x(), axis.z())});
  }
  return out;
}

}  // namespace camber
