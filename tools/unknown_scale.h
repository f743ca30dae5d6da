#pragma once

#include <fmt/format.h>

#include <optional>
#include <string>

#include "camber/cloud/coordinate_system.h"
#include "camber/core/progress.h"

namespace camber::tools {

/// Warns that the lengths of a file's cloud or surface are up to scale; not of one that its
/// coordinate system, of degrees for instance, takes out of metres: that has its own warning.
inline void warn_of_unknown_scale(const std::string& path, bool metric,
                                  const std::optional<CoordinateSystem>& crs, const LogSink& warn) {
  if (metric || !warn || (crs && !crs->metric())) return;
  warn(path + ": its lengths are in units of unknown size (up to scale), not metres");
}

/// A length in millimetres, or in units with as many digits where it is up to scale.
inline std::string small_length(double length, bool metric, int decimals) {
  return metric ? fmt::format("{:.{}f} mm", 1e3 * length, decimals)
                : fmt::format("{:.{}f} units", length, decimals + 3);
}

}  // namespace camber::tools
