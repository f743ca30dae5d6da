#include "plan_area.h"

#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "camber/cloud/cloud_io.h"
#include "camber/core/errors.h"
#include "camber/core/lower_case.h"
#include "camber/core/read_file.h"

using nlohmann::json;

namespace camber::tools {
namespace {

constexpr std::size_t kMostCorners = 1000000;

/// Polygons of a document of GeoJSON (RFC 7946).
class GeoJsonReader {
 public:
  explicit GeoJsonReader(std::string path) : path_(std::move(path)) {}

  PlanRings read() {
    const json document = json::parse(read_whole_file(path_), nullptr, false);
    if (document.is_discarded()) throw InputError(path_, "found damaged JSON, expected GeoJSON");
    take(document, "$", 0);
    return std::move(rings_);
  }

 private:
  [[noreturn]] void fail(const std::string& at, const std::string& reason) const {
    throw InputError(path_, at, reason);
  }

  void take(const json& object, const std::string& at, int depth) {
    constexpr int kMostNested = 16;
    if (depth > kMostNested) fail(at, "found objects nested deeper than 16");
    const std::string type =
        object.is_object() && object.contains("type") && object["type"].is_string()
            ? object["type"].get<std::string>()
            : "";
    const auto list = [&](const char* key) -> const json& {
      if (!object.contains(key) || !object[key].is_array()) {
        fail(at, fmt::format("found no list '{}', expected one", key));
      }
      return object[key];
    };
    if (type == "FeatureCollection" || type == "GeometryCollection") {
      const char* const key = type[0] == 'F' ? "features" : "geometries";
      for (std::size_t i = 0; i < list(key).size(); ++i) {
        take(list(key)[i], fmt::format("{}.{}[{}]", at, key, i), depth + 1);
      }
    } else if (type == "Feature") {
      if (object.contains("geometry") && !object["geometry"].is_null()) {
        take(object["geometry"], at + ".geometry", depth + 1);
      }
    } else if (type == "Polygon") {
      take_rings(list("coordinates"), at + ".coordinates");
    } else if (type == "MultiPolygon") {
      const json& polygons = list("coordinates");
      for (std::size_t i = 0; i < polygons.size(); ++i) {
        take_rings(polygons[i], fmt::format("{}.coordinates[{}]", at, i));
      }
    } else if (type.empty()) {
      fail(at, "found no type, expected a Feature, Polygon or MultiPolygon");
    }
  }

  void take_rings(const json& rings, const std::string& at) {
    if (!rings.is_array()) fail(at, "found no list, expected rings");
    for (std::size_t r = 0; r < rings.size(); ++r) {
      const std::string ring_at = fmt::format("{}[{}]", at, r);
      if (!rings[r].is_array()) fail(ring_at, "found no list, expected corners");
      std::vector<Eigen::Vector2d> ring;
      for (const json& corner : rings[r]) {
        if (!corner.is_array() || corner.size() < 2 || !corner[0].is_number() ||
            !corner[1].is_number()) {
          fail(ring_at, "found a corner that is none, expected [x, y]");
        }
        ring.emplace_back(corner[0].get<double>(), corner[1].get<double>());
        if (++corners_ > kMostCorners) fail(ring_at, "found more than a million corners");
      }
      rings_.push_back(std::move(ring));
    }
  }

  std::string path_;
  PlanRings rings_;
  std::size_t corners_ = 0;
};

PlanRings read_ring(const std::string& path) {
  const RoadCloud cloud = read_cloud(path);
  std::vector<Eigen::Vector2d> ring;
  for (const Eigen::Vector3f& p : cloud.points) {
    const Eigen::Vector3d x = cloud.origin + p.cast<double>();
    ring.push_back(x.head<2>());
  }
  return {ring};
}

}  // namespace

PlanRings read_plan_area(const std::string& path, const std::optional<CoordinateSystem>& cloud) {
  const std::string extension = lower_case(std::filesystem::path(path).extension().string());
  PlanRings rings = extension == ".json" || extension == ".geojson" ? GeoJsonReader(path).read()
                                                                    : read_ring(path);
  bool degrees = true;
  std::size_t corners = 0;
  for (const std::vector<Eigen::Vector2d>& ring : rings) {
    for (const Eigen::Vector2d& corner : ring) {
      if (!corner.allFinite()) {
        throw InputError(path, "found a corner that is not finite, expected numbers");
      }
      degrees = degrees && std::abs(corner.x()) <= 180.0 && std::abs(corner.y()) <= 90.0;
      ++corners;
    }
    if (ring.size() < 3) {
      throw InputError(
          path, fmt::format("found a ring of {} corners, expected three at least", ring.size()));
    }
  }
  if (corners == 0) throw InputError(path, "found no polygon, expected one");
  if (degrees && cloud && cloud->kind == CoordinateSystem::Kind::kProjected) {
    throw InputError(path, fmt::format("found longitudes and latitudes, expected a polygon in the "
                                       "cloud's coordinates ({})",
                                       describe(*cloud)));
  }
  return rings;
}

}  // namespace camber::tools
