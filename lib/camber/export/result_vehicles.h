#pragma once

#include <filesystem>
#include <vector>

#include "camber/export/opendrive.h"
#include "camber/export/plan_frame.h"

namespace camber {

/// The vehicles of a result as things on the road. Of reconstruct: those that its reference camera
/// saw. Of a drive: its parked tracks, each once, wherever along the drive it was seen; moving ones
/// have no one place.
struct ResultVehicles {
  std::vector<RoadsideVehicle> vehicles;
  std::size_t moving = 0;  ///< tracks of a drive that are left out
};

/// @param folder  of the result: vehicles.json and run.json of reconstruct, tracks.json of a drive.
/// @throws InputError "file: JSON path: found, expected".
ResultVehicles result_vehicles(const std::filesystem::path& folder, const PlanFrame& frame);

}  // namespace camber
