#pragma once

#include <cstddef>
#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "camber/road/cloud_profile.h"

namespace camber {

/// What a profile of points is of.
struct ProfiledPoints {
  std::string file, along;
  std::string ground_from;  ///< as it was asked for
  std::string level = "gravity";
  bool metric = true;
  const GroundBesideLine* ground = nullptr;
};

/// Stations that have an answer.
std::size_t answered_stations(const CloudProfile& profile);

/// A line a station, below the names of the columns.
std::string sections_csv(const CloudProfile& profile, bool metric, bool crown);

/// The same as one object, with options, but for timings.
nlohmann::json sections_json(const CloudProfile& profile, const CloudProfileOptions& options,
                             const ProfiledPoints& of, std::uint64_t seed);

}  // namespace camber
