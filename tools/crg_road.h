#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <string>
#include <vector>

#include "camber/export/opencrg.h"

namespace camber::tools {

/// Whether a name is that of an OpenCRG file (.crg in any case).
bool is_crg(const std::filesystem::path& path);

/// Whether a name is that of an OpenDRIVE file (.xodr in any case).
bool is_xodr(const std::filesystem::path& path);

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
