#include "crs.h"

#include <fmt/format.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "camber/cloud/stream_filters.h"
#include "camber/cloud/units.h"
#include "camber/core/errors.h"
#include "camber/core/read_file.h"
#include "camber/export/opendrive.h"
#include "camber/import/map_projection.h"
#include "options.h"
#include "plugins/crs_plugin.h"
#include "plugins/plugin.h"

namespace camber::tools {
namespace {

bool project(const std::string& crs, bool inverse, std::vector<Eigen::Vector2d>* places,
             std::string* reason) {
  static const auto call = reinterpret_cast<Project>(plugin_symbol("crs", "camber_project"));
  return call(crs.c_str(), inverse, places, reason);
}

/// "US survey foot (0.30480061 m)"
std::string with_length(const CoordinateUnit& unit) {
  return fmt::format("{} ({:.8g} m)", unit.name, unit.metres);
}

}  // namespace

bool look_up_crs(const std::string& definition, CoordinateSystem* found, std::string* reason) {
  static const auto find = reinterpret_cast<FindCrs>(plugin_symbol("crs", "camber_find_crs"));
  return find(definition.c_str(), found, reason);
}

CoordinateSystem crs_from_option(const std::string& definition) {
  constexpr std::size_t kMost = 1 << 16;  // bytes of a file
  std::string text = definition;
  std::error_code error;
  if (std::filesystem::is_regular_file(definition, error)) {
    std::ifstream in(definition, std::ios::binary);
    text.resize(kMost);
    in.read(text.data(), static_cast<std::streamsize>(text.size()));
    text.resize(static_cast<std::size_t>(in.gcount()));
    while (!text.empty() && static_cast<unsigned char>(text.back()) <= ' ') text.pop_back();
  }
  CoordinateSystem system;
  std::string reason;
  if (!system_of_definition(text, look_up_crs, &system, &reason)) {
    throw UsageError(fmt::format(
        "--crs: found '{}', expected EPSG:n, well-known text, a PROJ string or a file with one "
        "of them: {}",
        definition.substr(0, 80), reason));
  }
  return system;
}

CoordinateSystem crs_from_definition(const std::string& definition, const std::string& where) {
  CoordinateSystem system;
  std::string reason;
  if (!system_of_definition(definition, look_up_crs, &system, &reason)) {
    throw UsageError(
        fmt::format("{}: found '{}', expected EPSG:n, well-known text or a PROJ string: {}", where,
                    printable(definition, 80), reason));
  }
  return system;
}

std::string proj_string_of_definition(const std::string& definition) {
  if (definition.empty()) return {};
  static const auto call = reinterpret_cast<ProjString>(plugin_symbol("crs", "camber_proj_string"));
  std::string text;
  return call(definition.c_str(), &text) ? text : proj_string_of(definition);
}

std::string map_crs_from_option(const std::string& definition) {
  CoordinateSystem system = crs_from_option(definition);
  complete_crs(&system);
  if (system.kind != CoordinateSystem::Kind::kProjected || !system.metric()) {
    throw UsageError(fmt::format("--crs: found '{}' ({}), expected a projected system in metres",
                                 definition.substr(0, 80), describe(system)));
  }
  return definition_of(system);
}

std::vector<MapPlace> project_to_map(const std::string& crs, const std::vector<GeoPoint>& points) {
  return map_places(crs, points, "--crs", project);
}

std::vector<GeoPoint> places_on_earth(const std::string& crs,
                                      const std::vector<Eigen::Vector2d>& places) {
  std::vector<Eigen::Vector2d> turned = places;
  std::string reason;
  if (!project(crs, true, &turned, &reason)) {
    throw NoAnswerError(fmt::format("places on the map '{}' cannot be taken to the earth: {}",
                                    crs.substr(0, 80), reason));
  }
  std::vector<GeoPoint> out(places.size());
  for (std::size_t i = 0; i < out.size(); ++i) {
    out[i].longitude = turned[i].x();
    out[i].latitude = turned[i].y();
  }
  return out;
}

void complete_crs(CoordinateSystem* system) { complete_system(system, look_up_crs); }

std::unique_ptr<PointSource> with_complete_crs(std::unique_ptr<PointSource> source,
                                               const std::string& out,
                                               const WriteOptions& options) {
  const std::optional<CloudFormat> format =
      options.format ? options.format : format_from_extension(out);
  const PointStreamHeader& header = source->header();
  if (!is_las(format) || !header.crs || header.records) return source;
  CoordinateSystem crs = *source->header().crs;
  complete_crs(&crs);
  return with_crs(std::move(source), crs);
}

std::string wkt_of_codes(const CoordinateSystem& system) {
  if (system.epsg == 0) return {};
  const auto same = [](const CoordinateUnit& stated, const CoordinateUnit& other) {
    if (!stated.known()) return true;
    return stated.angle == other.angle &&
           (stated.angle || std::abs(stated.metres - other.metres) < 1e-9 * other.metres);
  };
  CoordinateSystem found;
  std::string reason;
  const std::string code = "EPSG:" + std::to_string(system.epsg);
  const bool compound =
      system.vertical_epsg > 0 &&
      look_up_crs(code + "+" + std::to_string(system.vertical_epsg), &found, &reason) &&
      same(system.horizontal, found.horizontal) && same(system.vertical, found.vertical);
  if (compound) return found.wkt;
  reason.clear();
  const bool known =
      look_up_crs(code, &found, &reason) && same(system.horizontal, found.horizontal);
  return known ? found.wkt : std::string();
}

void use_metres(const std::string& path, CloudFile* file, const LogSink& warn) {
  use_metres(path, &file->cloud, &file->report, warn);
}

void use_metres(const std::string& path, RoadCloud* cloud, ReadReport* report,
                const LogSink& warn) {
  if (!report->crs) return;
  CoordinateSystem& crs = *report->crs;
  complete_crs(&crs);
  if (crs.metric()) return;
  if (crs.horizontal.angle) {
    cloud->metric = false;
    if (warn) warn(path + ": " + unit_remark(crs));
    return;
  }
  to_metres(cloud, crs);
  if (!warn) return;
  const bool same = crs.horizontal.name == crs.vertical.name;
  warn(
      fmt::format("{}: the coordinates are in units of {}{}; they were converted to metres, in "
                  "which thresholds and results are",
                  path, with_length(crs.horizontal),
                  same ? "" : ", the heights of " + with_length(crs.vertical)));
}

double in_units_of_file(const std::string& path, const ReadOptions& options, double metres) {
  constexpr double kDegree = 111320.0;  // m, on the equator
  const PointStreamHeader header = open_point_source(path, options)->header();
  if (!header.crs) return metres;
  CoordinateSystem crs = *header.crs;
  complete_crs(&crs);
  return crs.horizontal.angle ? metres / kDegree : metres / crs.horizontal.metres;
}

PlanBounds bounds_in_metres(const PlanBounds& bounds,
                            const std::optional<CoordinateSystem>& system) {
  if (!system) return bounds;
  CoordinateSystem crs = *system;
  complete_crs(&crs);
  const double metre = crs.horizontal.angle ? 1.0 : crs.horizontal.metres;
  return {bounds.x0 * metre, bounds.y0 * metre, bounds.x1 * metre, bounds.y1 * metre};
}

void require_inside(const std::string& path, const CloudFile& file, const PlanBounds& bounds) {
  const PlanBounds wanted = bounds_in_metres(bounds, file.report.crs);
  for (const Eigen::Vector3f& p : file.cloud.points) {
    const Eigen::Vector3d x = file.cloud.origin + p.cast<double>();
    if (wanted.contains(x.x(), x.y())) return;
  }
  throw NoAnswerError(path + ": no point lies within --bounds");
}

std::optional<CoordinateSystem> crs_in_use(const std::string& path, const ReadReport& report,
                                           const LogSink& warn) {
  if (!report.crs || report.crs->metric() || report.crs->horizontal.angle) return report.crs;
  if (warn) {
    warn(path + ": the coordinate system is left out: its unit is not the metre, in which the " +
         "output is");
  }
  return std::nullopt;
}

std::string unit_remark(const CoordinateSystem& system) {
  if (system.metric()) return {};
  if (system.horizontal.angle) {
    return fmt::format(
        "the coordinates are longitude and latitude in units of {}, not metres: "
        "distances and slopes mean nothing; project the cloud first, or state its "
        "system with --crs",
        system.horizontal.name);
  }
  const bool same = system.horizontal.name == system.vertical.name;
  return fmt::format("the coordinates are in units of {}{}", with_length(system.horizontal),
                     same ? "" : ", the heights of " + with_length(system.vertical));
}

}  // namespace camber::tools
