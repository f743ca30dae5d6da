#pragma once

#include <string>

#include "camber/import/formats/trajectory.h"

namespace camber {

/// Whether a text is SubRip's subtitles: a number, then a line with "-->" between two times.
bool are_subtitles(const std::string& text);

/// Positions that subtitles state, as drones and dash cameras write them: "[latitude: 48.1]
/// [longitude: 11.5] [rel_alt: 1.3 abs_alt: 132.8]", "GPS(11.5,48.1,15)" (longitude first), "N48.1
/// E11.5"; speeds in km/h, mph or m/s. Times are those of the subtitles. Of positions that several
/// in a row repeat the first is taken, then one a second.
GeoLog read_subtitle_log(const std::string& text);

}  // namespace camber
