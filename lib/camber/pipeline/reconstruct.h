#pragma once

#include <string>
#include <vector>

#include "camber/cloud/road_cloud.h"
#include "camber/core/progress.h"
#include "camber/scene/results.h"
#include "camber/scene/scene.h"

namespace camber {

struct ReconstructOptions {
  std::string method = "joint";   ///< "joint", "coplanar" or "flat"
  std::uint64_t seed = 0;
  int num_threads = 0;            ///< <= 0: see resolve_num_threads
  void validate() const;          ///< throws std::invalid_argument
};

/// Everything that a run finds, in the reference camera's frame.
struct Reconstruction {
  std::vector<int> frame_ids;
  int reference_frame = 0;
  RoadCloud cloud;                ///< road points; labels["patch"]; colours; sigmas
  RoadSurface surface;
  VehicleDocument vehicles;
  RunDocument run;
};

/// The main job: a few frames of one moving camera to a metric road surface with vehicles on it.
/// Truth in the scene is not read.
/// @param frame_ids  at least two ids of the scene, ascending.
/// @throws NoAnswerError for a standing camera, a pure rotation, too little texture or road;
///         InputError for missing, damaged or mismatching images.
Reconstruction reconstruct(const Scene& scene, const std::vector<int>& frame_ids,
                           const ReconstructOptions& options, const Progress& progress = {});

}  // namespace camber
