// Coordinate systems by name: what calls PROJ.

#include <proj.h>

#include <cmath>
#include <memory>
#include <string>

#include "camber/cloud/coordinate_system.h"
#include "camber/core/errors.h"
#include "camber/core/lower_case.h"
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

struct Destroy {
  void operator()(PJ_CONTEXT* context) const { proj_context_destroy(context); }
  void operator()(PJ* object) const { proj_destroy(object); }
};
using Context = std::unique_ptr<PJ_CONTEXT, Destroy>;
using Object = std::unique_ptr<PJ, Destroy>;

/// Writes nothing: a missing database is written of at any level.
Context quiet_context() {
  Context context(proj_context_create());
  proj_log_func(context.get(), nullptr, [](void*, int, const char*) {});
  return context;
}

/// What `make` gives. Without memory PROJ knows nothing, as it does without its database, and gives
/// no reason: where that is nothing, PROJ is asked for WGS 84 and `make` called once more.
/// @throws MachineError if PROJ does not know that either.
template <typename Make>
Object checked(const Make& make) {
  if (PJ* const made = make()) return Object(made);
  const Context context = quiet_context();
  if (!Object(proj_create(context.get(), "EPSG:4326"))) {
    throw camber::MachineError("PROJ finds no system: out of memory, or its database is missing");
  }
  return Object(make());
}

/// Why a system that PROJ has made of a text is not taken; empty: it is. PROJ also takes the first
/// one whose name is like the text.
std::string why_not(const PJ* system, const std::string& text) {
  if (proj_is_crs(system) == 0) return "it is no coordinate reference system";
  const char* const name = proj_get_name(system);
  const bool by_name = text.find_first_of(":[={") == std::string::npos;
  if (by_name && (name == nullptr || camber::lower_case(name) != camber::lower_case(text))) {
    return "PROJ knows no system of that name";
  }
  if (proj_get_type(system) == PJ_TYPE_VERTICAL_CRS) {
    return "it states heights alone, expected a horizontal or a compound system";
  }
  return {};
}

}  // namespace

CAMBER_EXPORT bool camber_find_crs(const char* definition, camber::CoordinateSystem* found,
                                   std::string* reason);
CAMBER_EXPORT bool camber_find_crs(const char* definition, camber::CoordinateSystem* found,
                                   std::string* reason) {
  const std::string text = stated(definition);
  const Context context = quiet_context();
  const Object system = checked([&] { return proj_create(context.get(), text.c_str()); });
  *reason = system != nullptr ? why_not(system.get(), text) : "PROJ does not know it";
  if (reason->empty()) {
    // The version of the text that LAS asks for; systems that it cannot express get the newer one.
    const char* const options[] = {"MULTILINE=NO", nullptr};
    const char* wkt = proj_as_wkt(context.get(), system.get(), PJ_WKT1_GDAL, options);
    if (wkt == nullptr) wkt = proj_as_wkt(context.get(), system.get(), PJ_WKT2_2019, options);
    if (wkt != nullptr)
      *found = camber::coordinate_system_from_wkt(wkt);
    else
      *reason = "PROJ has no text for it";
  }
  return reason->empty();
}

CAMBER_EXPORT bool camber_project(const char* definition, bool inverse,
                                  std::vector<Eigen::Vector2d>* places, std::string* reason);
CAMBER_EXPORT bool camber_project(const char* definition, bool inverse,
                                  std::vector<Eigen::Vector2d>* places, std::string* reason) {
  const Context context = quiet_context();
  const std::string text = stated(definition);
  const Object given = checked(
      [&] { return proj_create_crs_to_crs(context.get(), "EPSG:4326", text.c_str(), nullptr); });
  const Object ordered(given ? proj_normalize_for_visualization(context.get(), given.get())
                             : nullptr);
  if (ordered == nullptr) *reason = "PROJ knows no way to it from WGS 84";
  for (Eigen::Vector2d& place : *places) {
    if (ordered == nullptr) break;
    const PJ_COORD to = proj_trans(ordered.get(), inverse ? PJ_INV : PJ_FWD,
                                   proj_coord(place.x(), place.y(), 0.0, HUGE_VAL));
    place = {to.xy.x, to.xy.y};
    if (!place.allFinite() || std::abs(place.x()) == HUGE_VAL) {
      *reason = "a place lies where it is not defined";
      break;
    }
  }
  return reason->empty();
}
