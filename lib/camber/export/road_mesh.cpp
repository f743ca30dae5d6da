#include "camber/export/road_mesh.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "camber/core/errors.h"
#include "camber/core/threads.h"
#include "camber/core/version.h"
#include "camber/export/crg_strip.h"
#include "camber/export/detail/series.h"
#include "camber/scene/detail/gltf_file.h"

namespace camber {

using Eigen::Vector2d;
using Eigen::Vector3d;

namespace {

constexpr double kLeastSide = 0.25;  // m of road to either side
constexpr std::size_t kMostPoints = 50000000;
constexpr std::array<std::uint8_t, 3> kUnseen = {128, 128, 128};

/// Widths without gaps and jumps.
std::vector<double> side(std::vector<double> seen, double given, std::size_t half) {
  if (given > 0.0) return std::vector<double>(seen.size(), given);
  for (double& w : seen) w = w < kLeastSide ? std::nan("") : w;
  detail::bridge(&seen);
  seen = detail::smoothed(seen, half);
  for (double& w : seen) w = std::max(w, kLeastSide);
  return seen;
}

void add_normals(RoadMesh* mesh) {
  mesh->normals.assign(mesh->points.size(), Vector3d::Zero());
  for (const auto& t : mesh->triangles) {
    const Vector3d& a = mesh->points[t[0]];
    const Vector3d n = (mesh->points[t[1]] - a).cross(mesh->points[t[2]] - a);
    for (const std::uint32_t corner : t) mesh->normals[corner] += n;
  }
  for (Vector3d& n : mesh->normals) {
    n = n.norm() > 0.0 ? n.normalized() : Vector3d(Vector3d::UnitZ());
  }
}

/// Colours as fine as they are known, at most so many to a side.
void add_texture(const ColorSource& colors, double step, int num_threads, RoadMesh* mesh) {
  constexpr double kMostTexels = 8192.0;
  const std::size_t columns = mesh->columns, sections = mesh->points.size() / columns;
  const double most = (kMostTexels - 1.0) / static_cast<double>(std::max(columns, sections) - 1);
  const double wanted = colors.resolution() > 0.0 ? std::ceil(step / colors.resolution()) : 1.0;
  mesh->texels = static_cast<int>(std::floor(std::min({wanted, most, 16.0})));
  if (mesh->texels < 1) return;  // more points than a texture may have
  const auto m = static_cast<std::size_t>(mesh->texels);
  Image& out = mesh->texture;
  out.width = static_cast<int>((columns - 1) * m + 1);
  out.height = static_cast<int>((sections - 1) * m + 1);
  out.channels = 3;
  out.data.resize(3 * static_cast<std::size_t>(out.width) * static_cast<std::size_t>(out.height));
  parallel_for(static_cast<std::size_t>(out.height), num_threads, [&](std::size_t row) {
    const std::size_t i = std::min(row / m, sections - 2);
    const double b = static_cast<double>(row - i * m) / static_cast<double>(m);
    for (std::size_t column = 0; column < static_cast<std::size_t>(out.width); ++column) {
      const std::size_t j = std::min(column / m, columns - 2);
      const double a = static_cast<double>(column - j * m) / static_cast<double>(m);
      const std::array<std::size_t, 4> corners = {i * columns + j, i * columns + j + 1,
                                                  (i + 1) * columns + j, (i + 1) * columns + j + 1};
      const std::array<double, 4> weights = {(1 - a) * (1 - b), a * (1 - b), (1 - a) * b, a * b};
      Vector3d place = Vector3d::Zero(), between = Vector3d::Zero();
      for (std::size_t k = 0; k < 4; ++k) {
        place += weights[k] * mesh->points[corners[k]];
        const auto& c = mesh->colors[corners[k]];
        between += weights[k] * Vector3d(c[0], c[1], c[2]);
      }
      const auto seen = colors.at(place);
      std::uint8_t* texel = &out.data[3 * (row * static_cast<std::size_t>(out.width) + column)];
      for (int k = 0; k < 3; ++k) {
        texel[k] = seen ? (*seen)[static_cast<std::size_t>(k)]
                        : static_cast<std::uint8_t>(std::lround(between[k]));
      }
    }
  });
}

template <typename T>
void append(std::string* out, const T& value) {
  char bytes[sizeof(T)];
  std::memcpy(bytes, &value, sizeof value);
  out->append(bytes, sizeof bytes);
}

}  // namespace

void RoadMeshOptions::validate() const {
  const auto require = [](bool good, const char* field, double value, const char* bound) {
    if (!good) {
      throw std::invalid_argument(
          fmt::format("RoadMeshOptions::{} is {}, expected {}", field, value, bound));
    }
  };
  require(step == 0.0 || (step >= 0.001 && step <= 100.0), "step", step, "0 or 0.001 to 100 m");
  require(left >= 0.0 && left <= 1000.0, "left", left, "0 to 1000 m");
  require(right >= 0.0 && right <= 1000.0, "right", right, "0 to 1000 m");
  require(widest > 0.0 && widest <= 1000.0, "widest", widest, "> 0, at most 1000 m");
}

RoadMesh make_road_mesh(const HeightSource& ground, const SmoothLine& line,
                        const ColorSource* colors, const RoadMeshOptions& options) {
  options.validate();
  const double step = options.step > 0.0 ? options.step : grid_step(ground.resolution());
  const auto sections = static_cast<std::size_t>(line.length() / step + 1e-6) + 1;
  if (sections < 2) {
    throw NoAnswerError(fmt::format("the line is {:.3g} m long, expected at least one step of {} m",
                                    line.length(), step));
  }
  const SeenWidth width = seen_width(ground, line, step, options.widest, options.num_threads);
  const auto half = static_cast<std::size_t>(2.0 / step);
  const std::vector<double> left = side(width.left, options.left, half),
                            right = side(width.right, options.right, half);
  double widest = 0.0;
  for (std::size_t i = 0; i < sections; ++i) widest = std::max(widest, left[i] + right[i]);
  RoadMesh mesh;
  mesh.columns = static_cast<std::size_t>(std::ceil(widest / step)) + 1;
  const std::size_t columns = mesh.columns;
  if (sections > kMostPoints / columns) {
    throw NoAnswerError(
        fmt::format("{} x {} points are too many; larger steps give fewer", sections, columns));
  }
  mesh.points.resize(sections * columns);
  parallel_for(sections, options.num_threads, [&](std::size_t i) {
    const double s = static_cast<double>(i) * step, heading = line.heading(s);
    const Vector2d foot = line.position(s), aside(-std::sin(heading), std::cos(heading));
    for (std::size_t j = 0; j < columns; ++j) {
      const double share = static_cast<double>(j) / static_cast<double>(columns - 1);
      const Vector2d place = foot + (share * (left[i] + right[i]) - right[i]) * aside;
      const double z = ground.at({place.x(), place.y(), line.height(s)}).height;
      mesh.points[i * columns + j] = {place.x(), place.y(), z};
    }
  });
  if (std::all_of(mesh.points.begin(), mesh.points.end(),
                  [](const Vector3d& p) { return std::isnan(p.z()); })) {
    throw NoAnswerError("no ground is seen beside the line");
  }
  // Gaps across are bridged first, then sections without any ground.
  std::vector<char> empty(sections, 0);
  for (std::size_t i = 0; i < sections; ++i) {
    std::vector<double> z;
    for (std::size_t j = 0; j < columns; ++j) z.push_back(mesh.points[i * columns + j].z());
    empty[i] = std::all_of(z.begin(), z.end(), [](double h) { return std::isnan(h); });
    if (empty[i]) continue;
    detail::bridge(&z);
    for (std::size_t j = 0; j < columns; ++j) mesh.points[i * columns + j].z() = z[j];
  }
  for (std::size_t j = 0; j < columns; ++j) {
    std::vector<double> z;
    for (std::size_t i = 0; i < sections; ++i) z.push_back(mesh.points[i * columns + j].z());
    detail::bridge(&z);
    for (std::size_t i = 0; i < sections; ++i) mesh.points[i * columns + j].z() = z[i];
  }
  for (std::size_t i = 0; i + 1 < sections; ++i) {
    for (std::size_t j = 0; j + 1 < columns; ++j) {
      const auto a = static_cast<std::uint32_t>(i * columns + j);
      const auto b = static_cast<std::uint32_t>(a + columns);
      mesh.triangles.push_back({a, b, b + 1});
      mesh.triangles.push_back({a, b + 1, a + 1});
    }
  }
  add_normals(&mesh);
  if (colors != nullptr) {
    for (const Vector3d& point : mesh.points) {
      mesh.colors.push_back(colors->at(point).value_or(kUnseen));
    }
    add_texture(*colors, step, options.num_threads, &mesh);
  }
  return mesh;
}

std::string encode_ply(const RoadMesh& mesh) {
  std::string out = fmt::format(
      "ply\nformat binary_little_endian 1.0\ncomment Camber {}\nelement vertex {}\n"
      "property double x\nproperty double y\nproperty double z\n"
      "property float nx\nproperty float ny\nproperty float nz\n",
      kVersion, mesh.points.size());
  if (!mesh.colors.empty()) {
    out += "property uchar red\nproperty uchar green\nproperty uchar blue\n";
  }
  out += fmt::format("element face {}\nproperty list uchar int vertex_indices\nend_header\n",
                     mesh.triangles.size());
  for (std::size_t i = 0; i < mesh.points.size(); ++i) {
    for (int k = 0; k < 3; ++k) append(&out, mesh.points[i][k]);
    for (int k = 0; k < 3; ++k) append(&out, static_cast<float>(mesh.normals[i][k]));
    if (mesh.colors.empty()) continue;
    for (const std::uint8_t c : mesh.colors[i]) append(&out, c);
  }
  for (const auto& triangle : mesh.triangles) {
    append(&out, std::uint8_t{3});
    for (const std::uint32_t corner : triangle) append(&out, static_cast<std::int32_t>(corner));
  }
  return out;
}

std::string encode_obj(const RoadMesh& mesh) {
  std::string out = fmt::format("# Camber {}\no road\n", kVersion);
  for (std::size_t i = 0; i < mesh.points.size(); ++i) {
    const Vector3d& p = mesh.points[i];
    out += fmt::format("v {:.4f} {:.4f} {:.4f}", p.x(), p.y(), p.z());
    if (!mesh.colors.empty()) {
      const auto& c = mesh.colors[i];
      out += fmt::format(" {:.4f} {:.4f} {:.4f}", c[0] / 255.0, c[1] / 255.0, c[2] / 255.0);
    }
    out += '\n';
  }
  for (const Vector3d& n : mesh.normals) {
    out += fmt::format("vn {:.5f} {:.5f} {:.5f}\n", n.x(), n.y(), n.z());
  }
  for (const auto& t : mesh.triangles) {
    out += fmt::format("f {0}//{0} {1}//{1} {2}//{2}\n", t[0] + 1, t[1] + 1, t[2] + 1);
  }
  return out;
}

std::string encode_glb(const RoadMesh& mesh) {
  using nlohmann::json;
  detail::GltfFile file(mesh.points.front());
  const auto turned = [](const Vector3d& p) {
    return Eigen::Vector3f(Vector3d(-p.y(), p.z(), -p.x()).cast<float>());
  };
  std::vector<Eigen::Vector3f> points, normals;
  for (const Vector3d& point : mesh.points) points.push_back(turned(point - mesh.points.front()));
  for (const Vector3d& normal : mesh.normals) normals.push_back(turned(normal));
  json attributes;
  attributes["POSITION"] = file.positions(points);
  attributes["NORMAL"] = file.vectors(normals);
  const Image& texture = mesh.texture;
  const bool textured = !texture.data.empty();
  if (textured) {
    std::vector<Eigen::Vector2f> places;
    for (std::size_t i = 0; i < mesh.points.size(); ++i) {
      const auto column = static_cast<double>(i % mesh.columns),
                 row = static_cast<double>(i / mesh.columns);
      places.emplace_back(static_cast<float>((column * mesh.texels + 0.5) / texture.width),
                          static_cast<float>((row * mesh.texels + 0.5) / texture.height));
    }
    attributes["TEXCOORD_0"] = file.coordinates(places);
  } else if (!mesh.colors.empty()) {
    attributes["COLOR_0"] = file.colors(mesh.colors);
  }
  std::vector<std::uint32_t> corners;
  for (const auto& t : mesh.triangles) corners.insert(corners.end(), t.begin(), t.end());
  const int indices = file.indices(corners);
  json surface = {{"metallicFactor", 0.0}, {"roughnessFactor", 1.0}};
  if (textured) surface["baseColorTexture"] = {{"index", file.texture(texture)}};
  const int material =
      file.add("materials", {{"name", "road"}, {"pbrMetallicRoughness", std::move(surface)}});
  const int node = file.mesh_node(
      "road",
      json::array(
          {{{"attributes", std::move(attributes)}, {"indices", indices}, {"material", material}}}));
  return file.finish("road", {node});
}

}  // namespace camber
