#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "camber/cloud/road_cloud.h"

namespace camber::test {

/// Hills with houses, hedges, ponds that nothing comes back from, and reflections below, on a map;
/// each point has its number as `id`, and some a class that stays.
/// @param side     m
/// @param density  points a square metre
RoadCloud made_survey(double side, double density);

/// The points for which x (of the cloud, without its origin) is in [from, to).
RoadCloud strip_of(const RoadCloud& cloud, double from, double to);

/// The classes of all points of files, by their ids; an id that stands in several files has those
/// of all of them.
std::map<int, std::vector<int>> classes_by_id(const std::vector<std::filesystem::path>& files);

/// Every file below a folder with its content.
std::map<std::string, std::string> files_below(const std::filesystem::path& folder);

}  // namespace camber::test
