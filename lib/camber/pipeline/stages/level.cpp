#include "camber/pipeline/stages/level.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace camber::stages {
namespace {

constexpr double kDegrees = 180.0 / M_PI;
constexpr double kMostSigmas = 4.0;

struct MeasuredUp {
  int frame = 0;
  Eigen::Vector3d up;  ///< reference camera
  double sigma = 0.0;  ///< rad
};

double angle_between_units(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return std::atan2(a.cross(b).norm(), a.dot(b));
}

}  // namespace

void level_by_gravity(const Scene& scene, RunDocument* run, RoadSurface* surface) {
  std::vector<MeasuredUp> measured;
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  double variance = 0.0;
  for (const RunDocument::CameraPose& camera : run->cameras) {
    const SceneFrame* frame = scene.find_frame(camera.id);
    if (!frame || !frame->up) continue;
    measured.push_back(
        {camera.id, camera.reference_from_camera.rotation() * *frame->up, frame->up_sigma});
    sum += measured.back().up / (frame->up_sigma * frame->up_sigma);
    variance += frame->up_sigma * frame->up_sigma;
  }
  if (measured.empty() || !(sum.norm() > 0.0)) return;
  const Eigen::Vector3d up = sum.normalized();
  for (const MeasuredUp& m : measured) {
    const double off = angle_between_units(m.up, up);
    if (off <= kMostSigmas * m.sigma) continue;
    run->warnings.push_back(
        {"gravity_contradicted",
         fmt::format("gravity of frame {} is {:.2f} degrees off the mean of the {} frames that "
                     "know it, beyond {:g} standard deviations of {:.2f}: grades are against the "
                     "camera's level",
                     m.frame, off * kDegrees, measured.size(), kMostSigmas, m.sigma * kDegrees)});
    return;
  }
  surface->up = up;
  surface->level = RoadSurface::Level::kGravity;
  surface->level_sigma = std::sqrt(variance / static_cast<double>(measured.size()));
  for (PlanePatch& patch : surface->patches) {
    patch.grade = std::asin(std::clamp(patch.plane.axis1.dot(up), -1.0, 1.0));
    patch.bank = std::asin(std::clamp(patch.plane.axis2.dot(up), -1.0, 1.0));
  }
}

}  // namespace camber::stages
