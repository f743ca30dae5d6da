#include "line_input.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <limits>

#include "camber/cloud/cloud_io.h"
#include "camber/core/errors.h"
#include "camber/core/lower_case.h"
#include "camber/import/formats/landxml.h"
#include "crs.h"
#include "gdal_functions.h"
#include "plugins/crs_plugin.h"
#include "plugins/plugin.h"
#include "road_arguments.h"

namespace fs = std::filesystem;

namespace camber::tools {
namespace {

/// A line as its file has it.
struct GivenLine {
  std::string name;
  std::vector<Eigen::Vector3d> points;
};
struct GivenLines {
  std::vector<GivenLine> lines;
  std::string crs;      ///< empty: not stated
  double metres = 0.0;  ///< of a unit of length; 0: the coordinate system's
};

enum class LineFormat { kPoints, kVector, kLandXml };

LineFormat format_of(const std::string& path) {
  const std::string kind = lower_case(fs::path(path).extension().string());
  if (kind == ".geojson" || kind == ".json" || kind == ".gpkg" || kind == ".shp" ||
      kind == ".dxf") {
    return LineFormat::kVector;
  }
  return kind == ".xml" || kind == ".landxml" ? LineFormat::kLandXml : LineFormat::kPoints;
}

GivenLines read_vector(const std::string& path) {
  if (!fs::exists(path)) throw InputError(path, "cannot be read, expected a file of lines");
  VectorLines found = gdal_functions().read_lines(path);
  GivenLines out;
  out.crs = found.crs;
  for (VectorLine& line : found.lines) {
    out.lines.push_back({line.name.empty() ? line.layer : line.name, std::move(line.points)});
  }
  return out;
}

GivenLines read_alignments(const std::string& path) {
  LandXmlFile found = read_landxml(path);
  GivenLines out;
  out.crs = found.crs;
  out.metres = found.metres;
  for (LandXmlAlignment& alignment : found.alignments) {
    out.lines.push_back({alignment.name, std::move(alignment.points)});
  }
  return out;
}

/// The line that is meant.
GivenLine choose(const std::string& path, const std::string& wanted, GivenLines* given) {
  std::vector<GivenLine>& lines = given->lines;
  std::vector<std::size_t> found;
  for (std::size_t i = 0; i < lines.size(); ++i) {
    if (wanted.empty() || lines[i].name == wanted) found.push_back(i);
  }
  if (found.empty() && wanted.find_first_not_of("0123456789") == std::string::npos &&
      wanted.size() < 8) {
    const auto number = static_cast<std::size_t>(std::stoul(wanted));
    if (number >= 1 && number <= lines.size()) found.push_back(number - 1);
  }
  if (found.size() == 1) return std::move(lines[found.front()]);
  std::string names;
  constexpr std::size_t kNamed = 8;
  for (std::size_t i = 0; i < std::min(kNamed, lines.size()); ++i) {
    names += fmt::format("{}{} '{}'", i > 0 ? ", " : "", i + 1, lines[i].name.substr(0, 60));
  }
  if (lines.size() > kNamed) names += fmt::format(" and {} more", lines.size() - kNamed);
  if (wanted.empty()) {
    throw InputError(path, fmt::format("found {} lines ({}), expected one, or --alignment with the "
                                       "name or the number of one",
                                       lines.size(), names));
  }
  throw UsageError(
      fmt::format("--alignment: found '{}', which {} of the lines of {} ({}), expected "
                  "the name or the number of one",
                  wanted, found.empty() ? "is none" : "are several", path, names));
}

std::string name_of(const CoordinateSystem& system) {
  const std::string text = describe(system);
  return text.empty() ? std::string("the stated one") : text;
}

/// Places of one system to another's. @throws InputError naming both.
void transform(const std::string& path, const CoordinateSystem& from, const CoordinateSystem& to,
               std::vector<Eigen::Vector3d>* points) {
  static const auto call = reinterpret_cast<Transform>(plugin_symbol("crs", "camber_transform"));
  std::vector<Eigen::Vector2d> places;
  for (const Eigen::Vector3d& point : *points) places.emplace_back(point.head<2>());
  const std::vector<Eigen::Vector2d> before = places;
  std::string reason;
  if (!call(definition_of(from).c_str(), definition_of(to).c_str(), &places, &reason)) {
    throw InputError(path, fmt::format("cannot be transformed from its coordinate system ({}) to "
                                       "the cloud's ({}): {}",
                                       name_of(from), name_of(to), reason));
  }
  const bool moved = before != places;
  for (std::size_t i = 0; i < places.size(); ++i) {
    (*points)[i].head<2>() = places[i];
    if (moved) (*points)[i].z() = std::numeric_limits<double>::quiet_NaN();
  }
}

}  // namespace

void add_line_arguments(App& app, LineArguments& arguments) {
  app.add_option("--line-crs", arguments.crs,
                 "coordinate system of the line of a cloud, in place of the one that its file "
                 "states: as of --crs. Where it is another than the cloud's, places are "
                 "transformed by PROJ, heights are left out");
  app.add_option("--alignment", arguments.alignment,
                 "which of several lines of the file of --along: a name, or a number from 1");
}

std::vector<Eigen::Vector3d> read_along(const std::string& path, const LineArguments& arguments,
                                        const std::optional<CoordinateSystem>& cloud_system,
                                        const LogSink& warn) {
  const LineFormat format = format_of(path);
  if (format == LineFormat::kPoints && !arguments.alignment.empty()) {
    throw UsageError(
        "--alignment: found a file of points, expected one of lines (GeoJSON, "
        "GeoPackage, Shapefile, DXF, LandXML)");
  }
  if (format == LineFormat::kPoints && arguments.crs.empty()) {
    return read_line(path, cloud_system);
  }
  GivenLines given;
  if (format == LineFormat::kPoints) {
    // As the numbers stand.
    const RoadCloud cloud = read_cloud(path);
    GivenLine line;
    for (const Eigen::Vector3f& p : cloud.points) {
      line.points.push_back(cloud.origin + p.cast<double>());
    }
    given.lines.push_back(std::move(line));
  } else {
    given = format == LineFormat::kVector ? read_vector(path) : read_alignments(path);
  }
  std::vector<Eigen::Vector3d> points = choose(path, arguments.alignment, &given).points;
  std::optional<CoordinateSystem> system;
  if (!arguments.crs.empty()) {
    system = crs_from_option(arguments.crs);
  } else if (!given.crs.empty()) {
    system = crs_from_definition(given.crs, path);
  }
  const bool cloud_known = cloud_system && cloud_system->stated();
  if (system && !cloud_known) {
    if (system->kind == CoordinateSystem::Kind::kGeographic) {
      throw InputError(path, fmt::format("found longitudes and latitudes ({}), but the cloud "
                                         "states no coordinate system, expected --crs with it",
                                         name_of(*system)));
    }
    if (warn) {
      warn(
          fmt::format("{}: the cloud states no coordinate system; the line's ({}) is taken to be "
                      "its own",
                      path, name_of(*system)));
    }
  }
  double metres = given.metres;
  if (system && cloud_known) {
    transform(path, *system, *cloud_system, &points);
    metres = 0.0;
  }
  if (!(metres > 0.0)) {
    const bool lengths =
        cloud_known && cloud_system->horizontal.known() && !cloud_system->horizontal.angle;
    metres = lengths ? cloud_system->horizontal.metres : 1.0;
  }
  for (Eigen::Vector3d& point : points) point *= metres;
  if (points.size() < 2) throw NoAnswerError(path + ": a line needs at least two points");
  return points;
}

}  // namespace camber::tools
