#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <string>
#include <vector>

#include "camber/cloud/road_cloud.h"
#include "camber/export/opencrg.h"

namespace camber::tools {

/// Whether a name is that of an OpenCRG file (.crg in any case).
bool is_crg(const std::filesystem::path& path);

/// Whether a name is that of an OpenDRIVE file (.xodr in any case).
bool is_xodr(const std::filesystem::path& path);

/// Whether a place has a height that the file does not hold: unknown there, it comes of modifiers.
/// @param road, stored  with the file's modifiers, and without
bool is_filled(const CrgRoad& road, const CrgRoad& stored, const Eigen::Vector2d& uv);

/// Heights of a road every quarter of a metre or closer along and across, where its file has them,
/// as points of ground (x, y, z of the file, m).
RoadCloud crg_points(const CrgRoad& road, const CrgRoad& stored);

/// The reference line, every metre, and its end.
std::vector<Eigen::Vector3d> crg_line(const CrgRoad& road);

/// Places on an OpenCRG road, as a file lists them.
struct CrgPlaces {
  bool by_uv = true;  ///< u and v; else x and y
  std::vector<Eigen::Vector2d> places;
};

/// A text file with columns u, v or x, y (also u_m ...; others are passed over), divided by commas,
/// semicolons or blanks. Without a line of names two columns are u and v, three or more x, y, z.
/// @throws InputError.
CrgPlaces read_crg_places(const std::string& path);

}  // namespace camber::tools
