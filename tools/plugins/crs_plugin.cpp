// Coordinate systems by name: what calls PROJ.

#include <proj.h>

#include <cmath>
#include <string>

#include "camber/cloud/coordinate_system.h"
#include "camber/core/errors.h"
#include "crs_plugin.h"
#include "plugin.h"

namespace {

/// A PROJ string names a coordinate system only if it states so.
std::string stated(const char* definition) {
  std::string text = definition;
  if (text.find("+proj") != std::string::npos && text.find("+type=crs") == std::string::npos) {
    text += " +type=crs";
  }
  return text;
}

/// Without memory PROJ knows nothing, as it does without its database, and gives no reason.
/// @throws MachineError if it does not even know WGS 84.
void check_proj() {
  PJ_CONTEXT* const context = proj_context_create();
  proj_log_level(context, PJ_LOG_NONE);
  PJ* const known = proj_create(context, "EPSG:4326");
  const bool works = known != nullptr;
  proj_destroy(known);
  proj_context_destroy(context);
  if (!works) {
    throw camber::MachineError("PROJ finds no system: out of memory, or its database is missing");
  }
}

/// What `make` gives; where that is nothing, PROJ is checked and `make` called once more.
template <typename Make>
PJ* checked(const Make& make) {
  PJ* const made = make();
  if (made != nullptr) return made;
  check_proj();
  return make();
}

}  // namespace

CAMBER_EXPORT bool camber_find_crs(const char* definition, camber::CoordinateSystem* found,
                                   std::string* reason);
CAMBER_EXPORT bool camber_find_crs(const char* definition, camber::CoordinateSystem* found,
                                   std::string* reason) {
  const std::string text = stated(definition);
  PJ_CONTEXT* const context = proj_context_create();
  proj_log_level(context, PJ_LOG_NONE);
  PJ* const system = checked([&] { return proj_create(context, text.c_str()); });
  const bool good = system != nullptr && proj_is_crs(system) != 0;
  if (good) {
    // The version of the text that LAS asks for; systems that it cannot express get the newer one.
    const char* const options[] = {"MULTILINE=NO", nullptr};
    const char* wkt = proj_as_wkt(context, system, PJ_WKT1_GDAL, options);
    if (wkt == nullptr) wkt = proj_as_wkt(context, system, PJ_WKT2_2019, options);
    if (wkt != nullptr)
      *found = camber::coordinate_system_from_wkt(wkt);
    else
      *reason = "PROJ has no text for it";
  } else {
    *reason = system != nullptr ? "it is no coordinate reference system" : "PROJ does not know it";
  }
  proj_destroy(system);
  proj_context_destroy(context);
  return reason->empty();
}

CAMBER_EXPORT bool camber_project(const char* definition, bool inverse,
                                  std::vector<Eigen::Vector2d>* places, std::string* reason);
CAMBER_EXPORT bool camber_project(const char* definition, bool inverse,
                                  std::vector<Eigen::Vector2d>* places, std::string* reason) {
  PJ_CONTEXT* const context = proj_context_create();
  proj_log_level(context, PJ_LOG_NONE);
  const std::string text = stated(definition);
  PJ* const given =
      checked([&] { return proj_create_crs_to_crs(context, "EPSG:4326", text.c_str(), nullptr); });
  PJ* const ordered = given ? proj_normalize_for_visualization(context, given) : nullptr;
  if (ordered == nullptr) *reason = "PROJ knows no way to it from WGS 84";
  for (Eigen::Vector2d& place : *places) {
    if (ordered == nullptr) break;
    const PJ_COORD to = proj_trans(ordered, inverse ? PJ_INV : PJ_FWD,
                                   proj_coord(place.x(), place.y(), 0.0, HUGE_VAL));
    place = {to.xy.x, to.xy.y};
    if (!place.allFinite() || std::abs(place.x()) == HUGE_VAL) {
      *reason = "a place lies where it is not defined";
      break;
    }
  }
  proj_destroy(ordered);
  proj_destroy(given);
  proj_context_destroy(context);
  return reason->empty();
}
