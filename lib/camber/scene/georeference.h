#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "camber/core/status.h"
#include "camber/geometry/se3.h"
#include "camber/road/road_surface.h"
#include "camber/scene/results.h"
#include "camber/scene/scene.h"

namespace camber {

/// WGS 84 / UTM, "EPSG:32632": the zone of a place in degrees, those of Norway and Svalbard, too.
std::string utm_crs(double latitude, double longitude);

/// Where a run lies on the map.
struct GeoReference {
  /// kFailed: `reason` is why there is none; kWeak: the heading is known to no better than 2
  /// degrees; kNotRun: the frames have no positions.
  Status status = Status::kNotRun;
  std::string reason;
  std::string crs;         ///< EPSG:n or a definition that PROJ reads; projected, metres
  SE3 map_from_reference;  ///< m; x east, y north, z up
  double position_sigma = std::numeric_limits<double>::quiet_NaN();  ///< m, east and north each
  double height_sigma = std::numeric_limits<double>::quiet_NaN();    ///< m; NaN: no heights
  double heading_sigma = std::numeric_limits<double>::quiet_NaN();   ///< rad
  double residual_rms = std::numeric_limits<double>::quiet_NaN();    ///< m, in plan
  int positions = 0;
  RoadSurface::Level level = RoadSurface::Level::kCamera;  ///< what stands for gravity

  bool known() const { return status == Status::kOk || status == Status::kWeak; }
};

/// Least squares for the heading and the shift that take the cameras of a metric run, levelled by
/// surface.up, to their positions; headings are measurements, too. The scale is the run's. Errors
/// of positions are taken as independent for the heading, and as common to all for the shift: both
/// on the safe side. Refused (kFailed): an unknown scale, a heading known to no better than 10
/// degrees, positions more than 4 standard deviations off.
GeoReference fit_georeference(const Scene& scene, const RunDocument& run,
                              const RoadSurface& surface);

/// Fits, and writes the key "georeference" of run.json, and a warning where it fails. Does nothing
/// for a scene without positions.
void put_georeference(const Scene& scene, const RoadSurface& surface, RunDocument* run);

/// That of a run.json; none where it has none or the fit failed.
/// @param file  of messages. @throws InputError "file: JSON path: found, expected".
std::optional<GeoReference> georeference_of(const RunDocument& run,
                                            const std::filesystem::path& file);

}  // namespace camber
