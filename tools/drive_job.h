#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

#include "camber/drive/drive_scene.h"
#include "command.h"
#include "network_arguments.h"
#include "scene_input.h"

namespace camber::tools {

/// One drive, as the command line has it.
struct DriveArguments {
  SceneInputArguments input;
  NetworkArguments networks;
  std::string out, frames, film;
  bool no_masks = false, no_calibrate = false, no_pictures = false, overwrite = false,
       resume = false;
};

/// Runs a drive and writes its result. With `resume` a complete result of equal inputs stays as it
/// is. @throws UsageError, InputError, NoAnswerError, OutputError, InterruptedError.
DriveOutcome run_drive_job(const Command& command, const DriveArguments& arguments);

/// "out/drive: 220 frames, 141.2 m +- 1.3 %, 12345 cells of road, 3 tracks".
std::string describe_drive(const std::string& folder, const nlohmann::json& run);

}  // namespace camber::tools
