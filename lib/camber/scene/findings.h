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

/// One thing that is missing, weak or not used, and why.
struct Shortcoming {
  std::string what;    ///< "scale", "patch 3, 5", "vehicle id 2 of frame 7"
  std::string status;  ///< "weak", "not_observable", "failed", "not used"; empty: a warning
  std::string reason;  ///< as the run gives it; may be empty
  std::string remedy;  ///< options that would change it; may be empty
};

/// All that is not ok in a run, things of the same status and reason together; empty: complete.
/// @param surface, vehicles  may be nullptr: nothing is stated of them.
std::vector<Shortcoming> shortcomings(const RunDocument& run, const RoadSurface* surface,
                                      const VehicleDocument* vehicles);

/// The road, the scale, the vehicles: what was found, what a status other than ok means, and which
/// option would give what was not found.
/// @param surface, vehicles  may be nullptr: nothing is stated of them.
std::vector<Finding> findings(const RunDocument& run, const RoadSurface* surface,
                              const VehicleDocument* vehicles);

/// How well lengths are known and what that hangs on, one sentence for a headline: "distances known
/// to 9 %, since the field of view is known to 5 degrees only (70)".
std::string scale_sentence(const RunDocument& run);

}  // namespace camber
