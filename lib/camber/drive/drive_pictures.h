#pragma once

#include <filesystem>
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "camber/core/progress.h"
#include "camber/drive/drive_surface.h"
#include "camber/drive/run_drive.h"
#include "camber/render/drive_content.h"

namespace camber {

/// What pictures of a drive show; refers to `result` and `road`.
DriveContent drive_content(const Scene& scene, const DriveResult& result, const DriveSurface& road);

struct DriveFilmOptions {
  std::filesystem::path film;    ///< .mp4 or .avi
  std::filesystem::path pieces;  ///< folder of the pieces while it is made
  int frames_a_piece = 100;      ///< > 0
  int most_pictures = 100;       ///< for the report, of frames evenly chosen, > 0
};

/// Draws every frame of a drive into a film that plays as fast as the drive went. The film is
/// written in pieces; those that are in the folder of pieces from an interrupted run of the same
/// drive are kept. They are joined at the end without being encoded again, and go.
/// @return overlays for the report as bytes of JPEG files, by index into drive->frames.
/// @throws InterruptedError: whole pieces stay; OutputError; MachineError without an encoder.
std::map<int, std::string> write_drive_film(const Scene& scene, const DriveContent& content,
                                            const DriveFilmOptions& options,
                                            const Progress& progress = {});

/// Frames a second at which a film of these frames passes as the drive did; 10 where no times are
/// known.
double film_rate(const DriveDocument& drive);

/// Writes plots/map.png, plots/profile.png and report.html into the folder. @throws OutputError.
/// @param run   run.json as it will be.
/// @param film  name of the film for the report's link; empty: none.
void write_drive_report(const DriveContent& content, const nlohmann::json& run,
                        std::map<int, std::string> pictures, const std::string& film,
                        const std::filesystem::path& folder);

}  // namespace camber
