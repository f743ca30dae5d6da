#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "camber/cloud/road_cloud.h"
#include "camber/drive/run_drive.h"
#include "camber/road/road_surface.h"
#include "camber/scene/results.h"

namespace camber {

/// The road of a drive in the form of a result of reconstruct(), which every command that works on
/// a road takes: the world of the drive (the first frame's camera) is the reference.
struct DriveSurface {
  RoadSurface surface;           ///< frame "camera", patches of the strip
  std::vector<double> stations;  ///< m, s of the patches' middles, by index into surface.patches
  /// The strip's cells, by s and lateral, with "patch": sigmas are those of the heights.
  RoadCloud cloud;
  RunDocument run;  ///< cameras, scale, the place on the map where the frames have positions
};

/// @param scene_path  of the manifest, for run.json.
DriveSurface drive_surface(const Scene& scene, const DriveResult& result,
                           const std::filesystem::path& scene_path, std::uint64_t seed);

/// Writes road.ply, surface.json and run.json into a folder. @throws OutputError.
void write_drive_surface(const DriveSurface& road, const std::filesystem::path& folder);

}  // namespace camber
