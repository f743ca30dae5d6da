#pragma once

#include <string>
#include <vector>

#include "camber/scene/results.h"

namespace camber {

/// One thing that a run found or did not find, for a person.
struct Finding {
  std::string text;       ///< sentences
  bool complete = false;  ///< found, and every status is ok
};

/// The road, the scale, the vehicles: what was found, what a status other than ok means, and which
/// option would give what was not found.
/// @param surface, vehicles  may be nullptr: nothing is stated of them.
std::vector<Finding> findings(const RunDocument& run, const RoadSurface* surface,
                              const VehicleDocument* vehicles);

}  // namespace camber
