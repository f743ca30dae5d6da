#pragma once

#include <Eigen/Core>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "camber/cloud/cloud_io.h"
#include "camber/cloud/point_stream.h"
#include "camber/core/progress.h"
#include "camber/import/import_own.h"

namespace camber::tools {

/// The coordinate system that --crs names: EPSG:n, well-known text, a PROJ string, or a file that
/// holds one of them. Text is read without PROJ. @throws UsageError for what is none.
CoordinateSystem crs_from_option(const std::string& definition);

/// The same of a definition alone, which names no file. @param where  begins the message.
CoordinateSystem crs_from_definition(const std::string& definition, const std::string& where);

/// What PROJ knows of a definition: a FindSystem.
bool look_up_crs(const std::string& definition, CoordinateSystem* found, std::string* reason);

/// A system as a PROJ string, which simulators read of OpenDRIVE; as it is given where PROJ has
/// none for it.
std::string proj_string_of_definition(const std::string& definition);

/// The definition of the map that --crs names. @throws UsageError for what is no projected system
/// in metres.
std::string map_crs_from_option(const std::string& definition);

/// PROJ's projection, for import_own.h.
std::vector<MapPlace> project_to_map(const std::string& crs, const std::vector<GeoPoint>& points);

/// Latitudes and longitudes of places on a map (east, north). @throws NoAnswerError where PROJ
/// does not know the map.
std::vector<GeoPoint> places_on_earth(const std::string& crs,
                                      const std::vector<Eigen::Vector2d>& places);

/// Looks a system up whose file names its code but no unit; others stay as they are. One that PROJ
/// does not know stays, too.
void complete_crs(CoordinateSystem* system);

/// The source of a file to write; for LAS, which has other keys for projected systems, with its
/// coordinate system looked up as by complete_crs().
std::unique_ptr<PointSource> with_complete_crs(std::unique_ptr<PointSource> source,
                                               const std::string& out, const WriteOptions& options);

/// PROJ's well-known text of a system that is known by its codes; empty where it knows none, or
/// where the units are others.
std::string wkt_of_codes(const CoordinateSystem& system);

/// Takes a cloud for a command that computes in metres: coordinates in other lengths are converted,
/// with a warning; of degrees there is a warning alone, and unknown units count as metres.
void use_metres(const std::string& path, CloudFile* file, const LogSink& warn);

/// The same of a cloud and the report of its reading, which leaves a cloud in metres as it is.
void use_metres(const std::string& path, RoadCloud* cloud, ReadReport* report, const LogSink& warn);

/// A length in metres in the units of a file's x and y; of degrees as on the equator.
double in_units_of_file(const std::string& path, const ReadOptions& options, double metres);

/// Bounds in metres of a cloud that use_metres() took. @param system  of the file
PlanBounds bounds_in_metres(const PlanBounds& bounds,
                            const std::optional<CoordinateSystem>& system);

/// Throws a NoAnswerError where no point of a cloud that use_metres() took lies within bounds of
/// its file.
void require_inside(const std::string& path, const CloudFile& file, const PlanBounds& bounds);

/// The system that a cloud's coordinates are in after use_metres(), with a warning where it was
/// left out because they were converted.
std::optional<CoordinateSystem> crs_in_use(const std::string& path, const ReadReport& report,
                                           const LogSink& warn);

/// Warning for a system that is not in metres when it leaves the coordinates as they
/// are; empty for metres.
std::string unit_remark(const CoordinateSystem& system);

}  // namespace camber::tools
