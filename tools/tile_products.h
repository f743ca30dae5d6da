#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

#include "camber/core/stopwatch.h"
#include "camber/road/cloud_profile.h"
#include "camber/tiles/tile_job.h"
#include "command.h"
#include "line_input.h"

namespace camber::tools {

/// Fills what the rasters of tiles need of the command line: coordinate system, unit of heights,
/// GDAL. @param crs  as --crs has it; empty: as the tiles state it
/// @throws MachineError where the program was built without GDAL; UsageError, NoAnswerError
void prepare_rasters(const TilePlan& plan, const std::string& crs, TileJob* job);

/// Writes the mosaic of joined rasters as one Cloud Optimized GeoTIFF.
void write_mosaic(const TilePlan& plan, const TileJob& job, const std::string& out);

/// The line of tiles' profiles.
struct TileLine {
  std::string file;
  LineArguments reading;
  std::string crs;  ///< of the tiles, as --crs has it; empty: as they state it
};

/// Reads it for a plan, m. @throws UsageError where none is given; InputError, NoAnswerError
std::vector<Eigen::Vector3d> read_tile_line(const TilePlan& plan, const TileLine& line,
                                            const LogSink& warn);

/// Joins the points near the line that tiles have left: profile.csv and profile.json in the job's
/// folder. @return what is printed of it
nlohmann::json join_profile(const Command& command, const TilePlan& plan, TileJob job,
                            const TileLine& line, CloudProfileOptions options, Timings* timings);

}  // namespace camber::tools
