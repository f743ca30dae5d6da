#pragma once

#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "camber/drive/drive_surface.h"
#include "camber/drive/run_drive.h"

namespace camber {

/// tracks.json.
nlohmann::json to_json(const DriveTracks& tracks);

/// Writes a drive's files beside its log: drive.json, trajectory.tum, poses.txt, vehicles.json,
/// tracks.json, tracks.csv, strip/index.json and a strip/NNNNNN.ply for each stretch, surface/.
/// Each appears whole. run.json, which marks it complete, is the caller's to write.
/// @throws OutputError.
void write_drive(const DriveResult& result, const DriveSurface& road, const RoadStripOptions& strip,
                 const std::filesystem::path& folder);

}  // namespace camber
