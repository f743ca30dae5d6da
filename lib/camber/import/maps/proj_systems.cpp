#include "camber/import/maps/proj_systems.h"

#include <proj.h>

#include <cmath>
#include <memory>

#include "camber/core/errors.h"
#include "camber/core/lower_case.h"

namespace camber {
namespace {

/// A PROJ string names a coordinate system only if it states so.
std::string stated(const std::string& definition) {
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
    throw MachineError("PROJ finds no system: out of memory, or its database is missing");
  }
  return Object(make());
}

/// Why a system that PROJ has made of a text is not taken; empty: it is. PROJ also takes the first
/// one whose name is like the text.
std::string why_not(const PJ* system, const std::string& text) {
  if (proj_is_crs(system) == 0) return "it is no coordinate reference system";
  const char* const name = proj_get_name(system);
  const bool by_name = text.find_first_of(":[={") == std::string::npos;
  if (by_name && (name == nullptr || lower_case(name) != lower_case(text))) {
    return "PROJ knows no system of that name";
  }
  if (proj_get_type(system) == PJ_TYPE_VERTICAL_CRS) {
    return "it states heights alone, expected a horizontal or a compound system";
  }
  return {};
}

}  // namespace

bool find_coordinate_system(const std::string& definition, CoordinateSystem* found,
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
      *found = coordinate_system_from_wkt(wkt);
    else
      *reason = "PROJ has no text for it";
  }
  return reason->empty();
}

bool project_places(const std::string& definition, bool inverse,
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

bool find_proj_string(const std::string& definition, std::string* text) {
  const Context context = quiet_context();
  const std::string given = stated(definition);
  Object system = checked([&] { return proj_create(context.get(), given.c_str()); });
  if (system && proj_get_type(system.get()) == PJ_TYPE_COMPOUND_CRS) {
    system.reset(proj_crs_get_sub_crs(context.get(), system.get(), 0));
  }
  const char* const found =
      system ? proj_as_proj_string(context.get(), system.get(), PJ_PROJ_5, nullptr) : nullptr;
  if (found == nullptr) return false;
  *text = found;
  const std::string type = " +type=crs";
  const std::size_t at = text->find(type);
  if (at != std::string::npos) text->erase(at, type.size());
  return true;
}

namespace {

struct DestroyList {
  void operator()(PJ_OBJ_LIST* list) const { proj_list_destroy(list); }
};
struct DestroyFactory {
  void operator()(PJ_OPERATION_FACTORY_CONTEXT* factory) const {
    proj_operation_factory_context_destroy(factory);
  }
};

/// The horizontal part of a system, its axes in the order east, north; nothing where there is none.
Object horizontal(PJ_CONTEXT* context, const std::string& definition) {
  Object system = checked([&] { return proj_create(context, stated(definition).c_str()); });
  if (system && proj_get_type(system.get()) == PJ_TYPE_COMPOUND_CRS) {
    system.reset(proj_crs_get_sub_crs(context, system.get(), 0));
  }
  if (system) system.reset(proj_normalize_for_visualization(context, system.get()));
  return system;
}

/// The grids that an operation needs and that are not there.
std::string missing_grids(PJ_CONTEXT* context, const PJ* operation) {
  std::string names;
  for (int i = 0; i < proj_coordoperation_get_grid_used_count(context, operation); ++i) {
    const char* name = nullptr;
    int available = 0;
    proj_coordoperation_get_grid_used(context, operation, i, &name, nullptr, nullptr, nullptr,
                                      nullptr, nullptr, &available);
    if (available == 0 && name) names += (names.empty() ? "" : ", ") + std::string(name);
  }
  return names;
}

/// Why the operation that PROJ holds best is not taken; empty: it is.
std::string why_not_operation(PJ_CONTEXT* context, PJ* operation) {
  if (!operation) return "PROJ knows no way between them";
  if (proj_coordoperation_is_instantiable(context, operation) == 0) {
    const std::string grids = missing_grids(context, operation);
    return "the transformation needs " +
           (grids.empty() ? "what PROJ does not have" : "the grid " + grids) +
           ", which is not installed";
  }
  if (proj_coordoperation_has_ballpark_transformation(context, operation) != 0) {
    return "PROJ knows a rough way between their datums alone";
  }
  return {};
}

}  // namespace

bool transform_places(const std::string& from, const std::string& to,
                      std::vector<Eigen::Vector2d>* places, std::string* reason) {
  const Context context = quiet_context();
  const Object source = horizontal(context.get(), from), target = horizontal(context.get(), to);
  if (!source || !target) {
    *reason = std::string("PROJ does not know the ") + (source ? "cloud's" : "line's");
    return false;
  }
  if (places->empty() ||
      proj_is_equivalent_to(source.get(), target.get(), PJ_COMP_EQUIVALENT) != 0) {
    return true;
  }
  const std::unique_ptr<PJ_OPERATION_FACTORY_CONTEXT, DestroyFactory> factory(
      proj_create_operation_factory_context(context.get(), nullptr));
  proj_operation_factory_context_set_spatial_criterion(context.get(), factory.get(),
                                                       PROJ_SPATIAL_CRITERION_PARTIAL_INTERSECTION);
  // The best of all, also where its grid is not there: none is taken in its place unseen.
  proj_operation_factory_context_set_grid_availability_use(context.get(), factory.get(),
                                                           PROJ_GRID_AVAILABILITY_IGNORED);
  const std::unique_ptr<PJ_OBJ_LIST, DestroyList> list(
      proj_create_operations(context.get(), source.get(), target.get(), factory.get()));
  Object operation;
  if (list && proj_list_get_count(list.get()) > 0) {
    const Eigen::Vector2d& first = places->front();
    const int best = proj_get_suggested_operation(context.get(), list.get(), PJ_FWD,
                                                  proj_coord(first.x(), first.y(), 0.0, HUGE_VAL));
    operation.reset(proj_list_get(context.get(), list.get(), best < 0 ? 0 : best));
  }
  *reason = why_not_operation(context.get(), operation.get());
  if (!reason->empty()) return false;
  for (Eigen::Vector2d& place : *places) {
    const PJ_COORD there =
        proj_trans(operation.get(), PJ_FWD, proj_coord(place.x(), place.y(), 0.0, HUGE_VAL));
    if (!std::isfinite(there.xy.x) || !std::isfinite(there.xy.y)) {
      *reason = "a place of the line lies where the transformation is not defined";
      return false;
    }
    place = {there.xy.x, there.xy.y};
  }
  return true;
}

}  // namespace camber
