#pragma once

#include <filesystem>

#include "camber/import/import_own.h"

namespace camber {

/// Gives the frames of a film what was recorded with it, as far as the options have no file of it:
/// positions (where options.gnss has a projection), speeds, gravity. It is the track of GoPro's
/// metadata in the film, else the log beside it under the same stem: .gpx, .nmea or .srt. Out of
/// step, damaged or empty telemetry is left out; out.telemetry says what was found and what was
/// done.
///
/// Track and subtitles are on the film's clock. A log has the world's: it is joined by the time at
/// which the film says it was made, where all frames then lie within the log, and that time is good
/// to a second or so: what it does to places and speeds is in their standard deviations.
/// @param out  whose scene has frames with times since the film's first frame.
/// @param upright  the images are the camera's, not turned as the film asks.
void put_film_telemetry(const std::filesystem::path& film, bool upright,
                        const OwnDataOptions& options, OwnImport& out);

}  // namespace camber
