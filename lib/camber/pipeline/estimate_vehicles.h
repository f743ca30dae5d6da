#pragma once

#include <string>
#include <vector>

#include "camber/core/progress.h"
#include "camber/pipeline/stages/paper_vehicles.h"
#include "camber/pipeline/stages/vehicles.h"
#include "camber/scene/results.h"
#include "camber/scene/scene.h"

namespace camber {

struct EstimateVehiclesOptions {
  stages::VehicleOptions vehicles;
  Preset preset = Preset::kDefault;
  stages::PaperVehicleOptions paper;  ///< of preset kPaper
  /// The road of a run, in place of the scene's planes, and its cameras, in place of the scene's
  /// poses; not owned, both or neither.
  const RoadSurface* surface = nullptr;
  const std::vector<RunDocument::CameraPose>* cameras = nullptr;
  void validate() const;  ///< throws std::invalid_argument
};

/// Vehicles alone, from a scene's detections, keypoints and planes; images and truth are not read.
/// Without a camera height in the scene a usual one with a wide prior is taken, and the document
/// names itself not metric.
/// With a run's surface every vehicle stands on the patch that its box's bottom ray meets; a frame
/// that the run did not see keeps the scene's planes. Planes that were conditioned on the run's
/// vehicles are taken as they were before: the vehicles are about to enter again.
/// @param frame_ids  ids of the scene; @throws std::invalid_argument for another id.
VehicleDocument estimate_vehicles(const Scene& scene, const std::vector<int>& frame_ids,
                                  const EstimateVehiclesOptions& options,
                                  const Progress& progress = {});

/// A sentence for each class of the frames' detections that the prior does not know: such vehicles
/// get the sizes and shapes of its first class.
/// @param prior  nullptr: the shipped one.
std::vector<std::string> unknown_classes(const std::vector<SceneFrame>& frames,
                                         const VehiclePrior* prior);

}  // namespace camber
