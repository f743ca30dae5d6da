#pragma once

#include <cstdint>
#include <functional>
#include <limits>
#include <map>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

namespace camber {

/// What the numbers along an axis count.
struct CoordinateUnit {
  std::string name;     ///< "metre", "US survey foot", "degree", ...; empty: not known
  double metres = 1.0;  ///< one unit in metres; of an angle and of an unknown unit 1
  bool angle = false;
  int epsg = 0;  ///< its code; 0: none here

  bool known() const { return !name.empty(); }
  bool metre() const { return !angle && metres == 1.0; }
};

/// The value of one GeoTIFF key: a number, numbers, or text.
using GeoKeyValue = std::variant<int, std::vector<double>, std::string>;

/// The coordinate system of a survey cloud, as far as its file states it.
struct CoordinateSystem {
  enum class Kind { kUnknown, kProjected, kGeographic, kGeocentric, kLocal };
  Kind kind = Kind::kUnknown;
  std::string name;           ///< "WGS 84 / UTM zone 17N"; empty: not known
  int epsg = 0;               ///< code of the horizontal (or the only) part; 0: not known
  int vertical_epsg = 0;      ///< code of the vertical part; 0: not known
  CoordinateUnit horizontal;  ///< of x and y
  CoordinateUnit vertical;    ///< of z; where it is not stated, that of x and y, or metres
  bool vertical_stated = false;
  std::string wkt;                          ///< well-known text; empty where there is none
  std::map<int, GeoKeyValue> geotiff_keys;  ///< by the key's number
  bool given = false;                       ///< by the user, in place of what the file states
  bool wkt_bit = false;                     ///< of a LAS header: the text counts

  bool stated() const { return kind != Kind::kUnknown || !wkt.empty() || !geotiff_keys.empty(); }
  /// Whether all three axes are in metres; unknown units count as metres.
  bool metric() const { return horizontal.metre() && vertical.metre(); }
};

/// "unknown", "projected", "geographic", "geocentric", "local".
const char* to_string(CoordinateSystem::Kind kind);

/// The unit with an EPSG code (9001 metre, 9002 foot, 9003 US survey foot, 9102 degree, ...); one
/// that is not known() for other codes.
CoordinateUnit unit_from_epsg(int code);

/// The unit with a name as coordinate systems have it, in any spelling ("Foot_US", "metre", "m",
/// "ft"); one that is not known() for others.
CoordinateUnit unit_from_name(std::string_view name);

/// A unit of so many metres, with its name if it has one.
CoordinateUnit unit_from_metres(double metres);

/// A system by its code: kind, name and unit of the systems of longitude and latitude in common use
/// and of UTM on WGS 84, of others the code alone.
CoordinateSystem coordinate_system_from_epsg(int code);

/// Kind, names, codes and units out of well-known text, version 1 (OGC 01-009) or 2 (ISO 19162).
/// Nothing else is interpreted. Text that is not well formed gives kind kUnknown.
CoordinateSystem coordinate_system_from_wkt(std::string_view wkt);

/// The same from GeoTIFF keys (OGC 19-008). A system that is named by its code alone, without a
/// unit, has a unit that is not known() unless coordinate_system_from_epsg() knows it. Such a code
/// goes before the model type, which some programs write wrong.
CoordinateSystem coordinate_system_from_geotiff(std::map<int, GeoKeyValue> keys);

/// The keys of a GeoKeyDirectoryTag with its two arrays of parameters, little-endian. Entries that
/// reach beyond an array are left out.
std::map<int, GeoKeyValue> read_geotiff_keys(std::string_view directory, std::string_view doubles,
                                             std::string_view text);

/// Short name of a key, "ProjectedCSType" (3072); its number for those that have none here.
std::string geotiff_key_name(int key);

/// What knows systems by their definitions, as find_coordinate_system() does by PROJ.
using FindSystem = std::function<bool(const std::string& definition, CoordinateSystem* found,
                                      std::string* reason)>;

/// Looks a system up whose file names its code but no unit; others stay as they are. One that is
/// not found stays, too.
void complete_system(CoordinateSystem* system, const FindSystem& find);

/// A system out of well-known text alone, else by `find`.
/// @return false and a reason where there is none.
bool system_of_definition(const std::string& definition, const FindSystem& find,
                          CoordinateSystem* system, std::string* reason);

/// Code or text that PROJ reads.
std::string definition_of(const CoordinateSystem& system);

/// The same of a raster with heights: compound systems as EPSG:n+m where they are known by codes.
std::string definition_for_raster(const CoordinateSystem& system);

/// The unit of heights as bands of a raster state it.
std::string height_unit_of(const CoordinateSystem& system);

/// One line for people: name, code and units.
std::string describe(const CoordinateSystem& system);

}  // namespace camber
