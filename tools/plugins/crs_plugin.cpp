// Coordinate systems by name: what calls PROJ.

#include <proj.h>

#include <string>

#include "camber/cloud/coordinate_system.h"
#include "crs_plugin.h"
#include "plugin.h"

CAMBER_EXPORT bool camber_find_crs(const char* definition, camber::CoordinateSystem* found,
                                   std::string* reason);
CAMBER_EXPORT bool camber_find_crs(const char* definition, camber::CoordinateSystem* found,
                                   std::string* reason) {
  std::string text = definition;
  if (text.find("+proj") != std::string::npos && text.find("+type=crs") == std::string::npos) {
    text += " +type=crs";
  }
  PJ_CONTEXT* const context = proj_context_create();
  proj_log_level(context, PJ_LOG_NONE);
  PJ* const system = proj_create(context, text.c_str());
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
