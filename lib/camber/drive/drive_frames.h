#pragma once

#include <Eigen/Core>
#include <map>
#include <vector>

#include "camber/drive/trajectory.h"
#include "camber/drive/window_measurement.h"
#include "camber/geometry/plane.h"
#include "camber/scene/drive_document.h"
#include "camber/scene/scene.h"

namespace camber {

/// The road under one camera of a drive, camera frame, m.
struct EgoRoad {
  UncertainPlane plane;
  double scale_sigma = 0.0;  ///< relative, of the lengths in it
};
using EgoRoads = std::map<int, EgoRoad>;  ///< by frame id

/// That of each window under its reference; under the frames between them, by the trajectory, that
/// of the windows beside.
/// @param windows        in the order of their references.
/// @param scale_factors  by reference: by how much the smoothed scale is longer than the window's.
EgoRoads ego_roads(const std::vector<WindowMeasurement>& windows, const Trajectory& trajectory,
                   const std::map<int, double>& scale_factors);

/// Up in the world: gravity's where frames know it, else the mean of the road's normals.
/// @param by_gravity  whether it is gravity's.
Eigen::Vector3d drive_up(const Scene& scene, const Trajectory& trajectory,
                         const std::vector<WindowMeasurement>& windows, bool* by_gravity);

/// s, of every frame; empty where the scene does not know them.
std::vector<double> frame_times(const Scene& scene, const std::vector<int>& frame_ids);

/// The foot of every camera on the road under it, world. The height is the mounting's: what single
/// windows are off is no bump of the road.
std::vector<Eigen::Vector3d> camera_feet(const Trajectory& trajectory, const EgoRoads& roads,
                                         const DriveDocument& mounting);

/// What drive.json has: lengths, mounting, every frame.
/// @param scale_factors  as those of ego_roads().
DriveDocument drive_document(const Scene& scene, const Trajectory& trajectory,
                             const std::vector<WindowMeasurement>& windows,
                             const std::map<int, double>& scale_factors, const EgoRoads& roads,
                             const Eigen::Vector3d& up);

}  // namespace camber
