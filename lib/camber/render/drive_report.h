#pragma once

#include <filesystem>
#include <map>
#include <string>

#include "camber/render/drive_content.h"
#include "camber/scene/json_value.h"

namespace camber {

/// What the report of a drive shows.
struct DriveReport {
  DriveContent content;
  JsonValue run = JsonValue::object();  ///< run.json
  std::map<int, std::string> pictures;  ///< bytes of JPEG files by index into drive->frames
  std::string film;                     ///< file beside the page; empty: none
};

/// One self-contained HTML page of a drive: what it is, a map, profiles with bands, a slider over
/// the frames that plots and tables lead to, tables of windows, weak frames and vehicles' tracks.
/// Nothing is loaded from elsewhere; without scripts all but the slider is there. What an
/// interruption changes, times and the command, is left to run.json. Same input, same bytes.
std::string make_drive_report(const DriveReport& report);

}  // namespace camber
