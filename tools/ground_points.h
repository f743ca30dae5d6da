#pragma once

#include <optional>
#include <string>
#include <vector>

#include "camber/cloud/road_cloud.h"
#include "camber/road/cloud_profile.h"
#include "camber/road/segment_ground.h"

namespace camber::tools {

/// Indices of the points that are asked about: not those of a class that stays, nor those that a
/// survey has withdrawn (the flag withheld). None: all of them, as of clouds without classes.
std::optional<std::vector<int>> points_to_judge(const RoadCloud& cloud,
                                                const std::vector<int>& keep_classes);

/// m beside bounds in which points decide what is ground within them: the plan's reach where there
/// is one, else that of a cloud from the air.
double ground_margin(const GroundOptions& options);

/// A warning where ground was found in the smaller part of the area that has points; else empty.
std::string remark_on_ground(const GroundSegmentation& found);

/// The source of a name of --ground-from, as to_string() has them; kAuto for another name.
GroundSource ground_source_from(const std::string& name);

}  // namespace camber::tools
