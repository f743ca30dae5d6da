#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "camber/cloud/coordinate_system.h"
#include "camber/cloud/road_cloud.h"
#include "camber/road/cloud_profile.h"
#include "camber/tiles/tile_job.h"

/// The join of kProfile: one profile out of the points near a line that tiles have left.
namespace camber {

/// Makes a line fit for TileJob: heights that are NaN become 0, since the way in plan counts.
/// @param name  of the line, begins the message
/// @throws NoAnswerError where it does not leave its first place
void check_tile_line(const std::string& name, std::vector<Eigen::Vector3d>* line);

/// The points near the line of all tiles, with their classes, m, in the order of the plan; sets the
/// job's options as profile_files() does.
/// @param crs   of the tiles, in place of the one that they state
/// @param find  what knows systems that files name by their codes
/// @throws as profile_files(); NoAnswerError where there are none
RoadCloud read_profile_points(const TilePlan& plan, const std::optional<CoordinateSystem>& crs,
                              const FindSystem& find, TileJob* job);

/// What is measured of them.
struct JoinedProfile {
  CloudProfile profile;
  CloudProfileOptions options;  ///< as used
  GroundBesideLine ground;
  bool metric = true;
};

/// profile_cloud() of the points that read_profile_points() gives; half width and ground are those
/// of the tiles.
/// @throws NoAnswerError; std::invalid_argument naming field, value and bound
JoinedProfile join_profile(const TilePlan& plan, const TileJob& job, const RoadCloud& cloud,
                           CloudProfileOptions options);

/// Writes profile.csv and profile.json into the job's folder.
/// @param along  name of the line; empty: none
/// @return       profile.json
nlohmann::json write_profile(const TilePlan& plan, const TileJob& job, const JoinedProfile& joined,
                             const std::string& along, std::uint64_t seed);

}  // namespace camber
