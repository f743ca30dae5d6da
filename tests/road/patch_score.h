#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "plane/road_scene_maker.h"

namespace camber::test {

/// How well planes and labels match the true planes of a made scene.
struct PatchScore {
  int found = 0;               ///< true planes that a patch covers with an IoU of more than 0.5
  double mean_overlap = 0.0;   ///< IoU of each true plane's best patch, over all true planes
  double least_overlap = 1.0;  ///< the worst of them
  double mean_angle = 0.0;     ///< rad, between normals, over those found
  double worst_angle = 0.0;    ///< rad
  double mean_height = 0.0;    ///< m, of the patch at the middle of the true plane's points
  double worst_height = 0.0;   ///< m
  std::vector<int> best;       ///< for each true plane the index of its best patch, -1: none
};

/// @param labels  index into `planes` for each point of the scene, -1: none
inline PatchScore score_patches(const RoadScene& scene, const std::vector<Plane>& planes,
                                const std::vector<int>& labels) {
  const std::size_t truths = scene.planes.size(), patches = planes.size();
  std::vector<double> both(truths * patches), truth(truths), estimate(patches);
  std::vector<Eigen::Vector3d> middle(truths, Eigen::Vector3d::Zero());
  for (std::size_t i = 0; i < scene.truth.size(); ++i) {
    const int a = scene.truth[i], b = labels[i];
    const auto ua = static_cast<std::size_t>(a), ub = static_cast<std::size_t>(b);
    if (a >= 0) {
      truth[ua] += 1.0;
      middle[ua] += scene.cloud.points[i].cast<double>();
    }
    if (b >= 0) estimate[ub] += 1.0;
    if (a >= 0 && b >= 0) both[ua * patches + ub] += 1.0;
  }
  PatchScore out;
  out.best.assign(truths, -1);
  for (std::size_t a = 0; a < truths; ++a) {
    double best = 0.0;
    for (std::size_t b = 0; b < patches; ++b) {
      const double shared = both[a * patches + b];
      const double overlap = shared / std::max(truth[a] + estimate[b] - shared, 1.0);
      if (overlap > best) {
        best = overlap;
        out.best[a] = static_cast<int>(b);
      }
    }
    out.mean_overlap += best / static_cast<double>(truths);
    out.least_overlap = std::min(out.least_overlap, best);
    if (best <= 0.5) continue;
    ++out.found;
    const Plane& plane = planes[static_cast<std::size_t>(out.best[a])];
    const double angle = angle_between(plane.normal, scene.planes[a].normal);
    const double height =
        std::abs(plane.signed_distance(scene.planes[a].foot(middle[a] / truth[a])));
    out.mean_angle += angle;
    out.worst_angle = std::max(out.worst_angle, angle);
    out.mean_height += height;
    out.worst_height = std::max(out.worst_height, height);
  }
  out.mean_angle /= std::max(out.found, 1);
  out.mean_height /= std::max(out.found, 1);
  return out;
}

}  // namespace camber::test
