#pragma once

namespace camber {

/// The script of a drive's report: the slider over the frames, and what leads from the map, the
/// plots and the frames' numbers to a frame.
extern const char* const kDriveReportScript;

}  // namespace camber
