#include "camber/render/gltf.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <vector>

#include "camber/core/atomic_file.h"
#include "camber/render/color_map.h"
#include "camber/render/picture_space.h"
#include "camber/render/wireframe.h"
#include "camber/scene/detail/gltf_file.h"

namespace camber {
namespace {

using detail::GltfFile;
using nlohmann::json;

/// From the picture's right, ahead, up to glTF's x, y up, -z ahead.
Eigen::Vector3f to_gltf(const Eigen::Vector3d& x) {
  return {static_cast<float>(x.x()), static_cast<float>(x.z()), static_cast<float>(-x.y())};
}

int material(GltfFile& document, const Color& color, const std::string& name) {
  return document.material({color.red, color.green, color.blue}, color.alpha, name);
}

json primitive(int positions, int indices, int material, int mode) {
  return {{"attributes", {{"POSITION", positions}}},
          {"indices", indices},
          {"material", material},
          {"mode", mode}};
}

int box_lines(GltfFile& document, const OrientedBox& box, json* primitives, int material) {
  const auto corners = box.corners();
  std::vector<Eigen::Vector3f> points;
  for (int i = 0; i < 8; ++i) points.push_back(to_gltf(corners.col(i)));
  std::vector<std::uint32_t> lines;
  for (const auto& [a, b] : box_edges()) {
    lines.push_back(static_cast<std::uint32_t>(a));
    lines.push_back(static_cast<std::uint32_t>(b));
  }
  const int positions = document.positions(points);
  primitives->push_back(primitive(positions, document.indices(lines), material, GltfFile::kLines));
  return positions;
}

json facts(const PlacedVehicle& vehicle, const std::string& unit) {
  return {{"id", vehicle.number},
          {"id_in_frame", vehicle.id},
          {"status", to_string(vehicle.status)},
          {"range", vehicle.range},
          {"range_sigma", vehicle.range_sigma},
          {"length", vehicle.box.dimensions.length},
          {"width", vehicle.box.dimensions.width},
          {"height", vehicle.box.dimensions.height},
          {"unit", unit}};
}

/// Standard deviations beside the values; the distance is from the reference camera.
json facts(const PlanePatch& patch, const RoadSurface& surface, const std::string& unit) {
  constexpr double kDegrees = 180.0 / M_PI;
  const Eigen::Vector3d variances = patch.plane.covariance.diagonal().cwiseMax(0.0);
  const auto tilt = [&](double variance) {
    return kDegrees * std::hypot(std::sqrt(variance), surface.level_sigma);
  };
  json out = {{"id", patch.id},
              {"kind", to_string(patch.kind)},
              {"status", to_string(patch.status)},
              {"grade_deg", kDegrees * patch.grade},
              {"grade_sigma_deg", tilt(variances[1])},
              {"bank_deg", kDegrees * patch.bank},
              {"bank_sigma_deg", tilt(variances[0])},
              {"height_sigma", std::sqrt(variances[2])},
              {"points", patch.inliers},
              {"unit", unit}};
  if (surface.frame == "camera") out["range"] = patch.plane.centroid.norm();
  if (!patch.reason.empty()) out["reason"] = patch.reason;
  return out;
}

/// Triangles of a simple polygon that is nearly flat and seen from above: ears are cut off.
std::vector<std::uint32_t> triangulate(const std::vector<Eigen::Vector3d>& polygon) {
  std::vector<std::uint32_t> left, out;
  double area = 0.0;
  const std::size_t n = polygon.size();
  for (std::size_t i = 0; i < n; ++i) {
    const Eigen::Vector3d &a = polygon[i], &b = polygon[(i + 1) % n];
    area += a.x() * b.y() - b.x() * a.y();
    left.push_back(static_cast<std::uint32_t>(i));
  }
  const double sign = area < 0.0 ? -1.0 : 1.0;
  const auto turn = [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
    const Eigen::Vector3d u = polygon[b] - polygon[a], v = polygon[c] - polygon[a];
    return sign * (u.x() * v.y() - u.y() * v.x());
  };
  while (left.size() > 3) {
    bool cut = false;
    for (std::size_t i = 0; i < left.size() && !cut; ++i) {
      const std::uint32_t a = left[(i + left.size() - 1) % left.size()], b = left[i],
                          c = left[(i + 1) % left.size()];
      if (turn(a, b, c) <= 0.0) continue;
      const bool empty = std::none_of(left.begin(), left.end(), [&](std::uint32_t p) {
        return p != a && p != b && p != c && turn(a, b, p) >= 0.0 && turn(b, c, p) >= 0.0 &&
               turn(c, a, p) >= 0.0;
      });
      if (!empty) continue;
      out.insert(out.end(), {a, b, c});
      left.erase(left.begin() + static_cast<std::ptrdiff_t>(i));
      cut = true;
    }
    if (!cut) break;  // not simple: the rest becomes a fan
  }
  for (std::size_t i = 1; i + 1 < left.size(); ++i) {
    out.insert(out.end(), {left[0], left[i], left[i + 1]});
  }
  return out;
}

/// Every so many points that at most `most` remain (0: all).
int points_node(GltfFile& document, const PictureContent& content, const PictureSpace& space,
                const GltfOptions& options) {
  const std::size_t most = options.max_points;
  std::size_t stride = 1;
  if (most > 0) stride = (space.points.size() + most - 1) / most;
  std::vector<Eigen::Vector3f> points;
  std::vector<std::array<std::uint8_t, 3>> inks;
  std::vector<std::uint32_t> rows;  // of the cloud
  for (std::size_t i = 0; i < space.points.size(); i += stride) {
    points.push_back(to_gltf(space.points[i].cast<double>()));
    inks.push_back(space.colors[i]);
    rows.push_back(space.kept[i]);
  }
  json cloud = {{"attributes",
                 {{"POSITION", document.positions(points)}, {"COLOR_0", document.colors(inks)}}},
                {"material", material(document, {255, 255, 255, 1.0}, "points")},
                {"mode", GltfFile::kPoints}};
  if (options.point_facts && content.cloud) {
    const RoadCloud& from = *content.cloud;
    const auto add = [&](const char* name, const auto& values) {
      std::vector<float> picked;
      for (const std::uint32_t at : rows) picked.push_back(static_cast<float>(values[at]));
      cloud["attributes"][name] = document.scalars(picked);
    };
    if (!from.sigmas.empty()) add("_SIGMA", from.sigmas);
    const auto patches = from.labels.find("patch");
    if (patches != from.labels.end()) add("_PATCH", patches->second);
  }
  return document.mesh_node("road points", json::array({cloud}), {{"unit", space.unit}});
}

/// Corner i of a closed outline with the next.
std::vector<std::uint32_t> closed_outline(std::size_t corners) {
  const auto count = static_cast<std::uint32_t>(corners);
  std::vector<std::uint32_t> lines;
  for (std::uint32_t i = 0; i < count; ++i) {
    lines.push_back(i);
    lines.push_back((i + 1) % count);
  }
  return lines;
}

int patches_node(GltfFile& document, const RoadSurface* surface, const PictureSpace& space) {
  std::vector<int> nodes;
  std::array<int, 3> panes{-1, -1, -1}, rims{-1, -1, -1};  // materials, made when first used
  for (const PlacedPatch& patch : space.patches) {
    std::vector<Eigen::Vector3f> points;
    for (const Eigen::Vector3d& corner : patch.boundary) points.push_back(to_gltf(corner));
    const auto k = static_cast<std::size_t>(patch.kind);
    if (panes[k] < 0) {
      const std::string name = std::string(to_string(patch.kind)) + " patch";
      panes[k] = material(document, patch_color(patch.kind).with_alpha(0.25), name);
      rims[k] = material(document, patch_color(patch.kind), name + " outline");
    }
    const int positions = document.positions(points);
    json primitives = json::array();
    primitives.push_back(primitive(positions, document.indices(triangulate(patch.boundary)),
                                   panes[k], GltfFile::kTriangles));
    primitives.push_back(primitive(positions,
                                   document.indices(closed_outline(patch.boundary.size())), rims[k],
                                   GltfFile::kLines));
    nodes.push_back(document.mesh_node("patch " + std::to_string(patch.id), primitives,
                                       facts(*surface->find(patch.id), *surface, space.unit)));
  }
  return document.group("patches", nodes);
}

/// The body's faces and its wireframe.
void wireframe_primitives(GltfFile& document, const PlacedVehicle& vehicle, const Color& color,
                          json* primitives) {
  std::vector<Eigen::Vector3f> points;
  for (const Eigen::Vector3d& x : vehicle.keypoints) points.push_back(to_gltf(x));
  std::vector<std::uint32_t> faces, lines;
  for (const auto& t : wireframe_triangles()) {
    for (const int corner : t) faces.push_back(static_cast<std::uint32_t>(corner));
  }
  for (const auto& [a, b] : wireframe_edges()) {
    lines.push_back(static_cast<std::uint32_t>(a));
    lines.push_back(static_cast<std::uint32_t>(b));
  }
  const int positions = document.positions(points);
  primitives->push_back(primitive(positions, document.indices(faces),
                                  material(document, color.with_alpha(0.6), vehicle.name + " body"),
                                  GltfFile::kTriangles));
  primitives->push_back(primitive(
      positions, document.indices(lines),
      material(document, darker(color, 0.5), vehicle.name + " wireframe"), GltfFile::kLines));
}

int vehicles_node(GltfFile& document, const PictureSpace& space) {
  std::vector<int> nodes;
  for (const PlacedVehicle& vehicle : space.vehicles) {
    const Color color = vehicle_color(vehicle);
    json primitives = json::array();
    if (vehicle.wireframe) wireframe_primitives(document, vehicle, color, &primitives);
    box_lines(document, vehicle.box, &primitives,
              material(document, darker(color, 0.7), vehicle.name + " box"));
    nodes.push_back(document.mesh_node(vehicle.name, primitives, facts(vehicle, space.unit)));
  }
  return document.group("vehicles", nodes);
}

int truth_node(GltfFile& document, const PictureSpace& space) {
  std::vector<int> nodes;
  const int red = material(document, kTruthRed, "truth");
  for (const PlacedVehicle& vehicle : space.truth) {
    json primitives = json::array();
    box_lines(document, vehicle.box, &primitives, red);
    nodes.push_back(document.mesh_node("true vehicle " + std::to_string(vehicle.id), primitives,
                                       facts(vehicle, space.unit)));
  }
  return document.group("truth", nodes);
}

/// A mesh of lines alone.
int lines_node(GltfFile& document, const std::string& name,
               const std::vector<Eigen::Vector3f>& points, const std::vector<std::uint32_t>& lines,
               int material) {
  return document.mesh_node(
      name, json::array({primitive(document.positions(points), document.indices(lines), material,
                                   GltfFile::kLines)}));
}

/// The camera's pyramid in each pose, where `camera` is known, and the path between the poses.
std::vector<int> camera_nodes(GltfFile& document, const PictureSpace& space,
                              const PinholeCamera* camera) {
  std::vector<int> nodes;
  const int ink = material(document, kInk, "camera");
  const double depth =
      std::clamp(0.015 * std::max(space.ahead.span(), space.right.span()), 0.3, 20.0);
  std::vector<Eigen::Vector3f> path;
  std::vector<std::uint32_t> path_lines;
  for (std::size_t i = 0; i < space.cameras.size(); ++i) {
    path.push_back(to_gltf(space.cameras[i].translation()));
    if (i > 0) {
      path_lines.push_back(static_cast<std::uint32_t>(i - 1));
      path_lines.push_back(static_cast<std::uint32_t>(i));
    }
    if (!camera) continue;
    std::vector<Eigen::Vector3f> points = {path.back()};
    for (const Eigen::Vector3d& corner : frustum_corners(*camera, depth)) {
      points.push_back(to_gltf(space.cameras[i] * corner));
    }
    nodes.push_back(lines_node(document, "camera " + std::to_string(space.camera_ids[i]), points,
                               {0, 1, 0, 2, 0, 3, 0, 4, 1, 2, 2, 3, 3, 4, 4, 1}, ink));
  }
  if (!path_lines.empty()) nodes.push_back(lines_node(document, "path", path, path_lines, ink));
  return nodes;
}

}  // namespace

void GltfOptions::validate() const {
  if (max_points > 100000000) {
    throw std::invalid_argument("glTF option max_points: found " + std::to_string(max_points) +
                                ", expected at most 100000000");
  }
}

std::string encode_glb(const PictureContent& content, const GltfOptions& options) {
  options.validate();
  const PictureSpace space = make_picture_space(content, options.show_truth, options.color);
  GltfFile document(space.picture_from_reference.inverse().translation());
  std::vector<int> top;
  if (!space.points.empty()) top.push_back(points_node(document, content, space, options));
  if (!space.patches.empty()) top.push_back(patches_node(document, content.surface, space));
  if (!space.vehicles.empty()) top.push_back(vehicles_node(document, space));
  if (!space.truth.empty()) top.push_back(truth_node(document, space));
  if (!space.cameras.empty()) {
    const std::vector<int> nodes = camera_nodes(document, space, content.camera);
    if (!nodes.empty()) top.push_back(document.group("cameras", nodes));
  }
  return document.finish(content.title, top);
}

void write_glb(const PictureContent& content, const std::filesystem::path& path,
               const GltfOptions& options) {
  write_file_atomically(path, encode_glb(content, options));
}

}  // namespace camber
