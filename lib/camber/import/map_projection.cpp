#include "camber/import/map_projection.h"

#include <fmt/format.h>

#include <cmath>

#include "camber/core/errors.h"

namespace camber {
namespace {

/// A run keeps its metres, which those of a map such as the web's Mercator are not.
/// @param degree  what a degree of latitude is on the map, m. @throws UsageError
void require_true_lengths(const std::string& name, const std::string& crs, double latitude,
                          double degree) {
  constexpr double kMost = 0.02;
  // Of the meridian of WGS 84.
  const double twice = 2.0 * latitude * M_PI / 180.0;
  const double scale = degree / (111132.954 - 559.822 * std::cos(twice));
  if (std::abs(scale - 1.0) <= kMost) return;
  throw UsageError(
      fmt::format("{}: a metre of ground is {:.3g} m on the map of '{}', expected a system with "
                  "true lengths there, as UTM's zone has",
                  name, scale, crs.substr(0, 80)));
}

}  // namespace

std::vector<MapPlace> map_places(const std::string& crs, const std::vector<GeoPoint>& points,
                                 const std::string& name, const ProjectPlaces& project) {
  constexpr double kStep = 1e-5;  // degrees; a metre
  std::vector<Eigen::Vector2d> places;
  for (const GeoPoint& p : points) {
    places.emplace_back(p.longitude, p.latitude);
    places.emplace_back(p.longitude, p.latitude + (p.latitude > 0.0 ? -kStep : kStep));
  }
  std::string reason;
  if (!project(crs, false, &places, &reason)) {
    throw UsageError(fmt::format("{}: positions cannot be taken to '{}': {}", name, crs, reason));
  }
  if (!points.empty()) {
    require_true_lengths(name, crs, points[0].latitude, (places[0] - places[1]).norm() / kStep);
  }
  std::vector<MapPlace> out;
  for (std::size_t i = 0; i < points.size(); ++i) {
    MapPlace place;
    place.east = places[2 * i].x();
    place.north = places[2 * i].y();
    const Eigen::Vector2d north =
        (places[2 * i] - places[2 * i + 1]) * (points[i].latitude > 0.0 ? 1.0 : -1.0);
    place.convergence = std::atan2(-north.x(), north.y());
    out.push_back(place);
  }
  return out;
}

}  // namespace camber
