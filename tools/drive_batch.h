#pragma once

#include <string>
#include <vector>

#include "command.h"
#include "drive_job.h"

namespace camber::tools {

/// The scenes of a command line and of a list, a line each.
/// @throws InputError for a list that cannot be read; UsageError where there is no scene.
std::vector<std::string> scenes_of(const std::vector<std::string>& given, const std::string& list);

/// Runs several drives one after another, each into a folder of its name in `arguments.out`, and
/// writes summary.csv and run.json there. A drive that gives no answer or cannot be read is a row
/// with its reason; the others go on.
/// @return 0, or 1 where a drive has no result. @throws InterruptedError, OutputError, UsageError.
int run_drive_batch(const Command& command, const DriveArguments& arguments,
                    const std::vector<std::string>& scenes, bool json);

}  // namespace camber::tools
