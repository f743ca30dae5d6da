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
#include "camber/export/detail/series.h"
#include "camber/export/crg_strip.h"
#include "camber/image/image_io.h"
#include "camber/image/srgb.h"

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
  const Vector3d origin = mesh.points.front() + Vector3d::Zero();  // -0 becomes 0
  const auto turned = [](const Vector3d& p) { return Vector3d(-p.y(), p.z(), -p.x()); };
  std::string data;
  Eigen::Vector3f low = Eigen::Vector3f::Constant(std::numeric_limits<float>::infinity());
  Eigen::Vector3f high = -low;
  for (const Vector3d& point : mesh.points) {
    const Eigen::Vector3f p = turned(point - origin).cast<float>();
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
    for (int k = 0; k < 3; ++k) append(&data, p[k]);
  }
  const std::size_t normals_at = data.size();
  for (const Vector3d& normal : mesh.normals) {
    const Eigen::Vector3f n = turned(normal).cast<float>();
    for (int k = 0; k < 3; ++k) append(&data, n[k]);
  }
  const std::size_t colors_at = data.size();
  const Image& texture = mesh.texture;
  const bool textured = !texture.data.empty();
  if (textured) {
    for (std::size_t i = 0; i < mesh.points.size(); ++i) {
      const auto column = static_cast<double>(i % mesh.columns),
                 row = static_cast<double>(i / mesh.columns);
      append(&data, static_cast<float>((column * mesh.texels + 0.5) / texture.width));
      append(&data, static_cast<float>((row * mesh.texels + 0.5) / texture.height));
    }
  } else {
    for (const auto& c : mesh.colors) {  // of files sRGB, of glTF's vertices linear
      for (const std::uint8_t value : {c[0], c[1], c[2], std::uint8_t{255}}) {
        append(&data, static_cast<std::uint16_t>(std::lround(65535.0 * linear_from_srgb(value))));
      }
    }
  }
  const std::size_t indices_at = data.size();
  for (const auto& triangle : mesh.triangles) {
    for (const std::uint32_t corner : triangle) append(&data, corner);
  }
  const std::size_t n = mesh.points.size();
  json views = json::array(), accessors = json::array(), attributes;
  const auto add = [&](std::size_t at, std::size_t size, int target, json accessor) {
    accessor["bufferView"] = views.size();
    views.push_back({{"buffer", 0}, {"byteOffset", at}, {"byteLength", size}, {"target", target}});
    accessors.push_back(std::move(accessor));
    return accessors.size() - 1;
  };
  constexpr int kArray = 34962, kIndices = 34963, kFloat = 5126, kHalfWord = 5123, kWord = 5125;
  attributes["POSITION"] = add(0, normals_at, kArray,
                               {{"componentType", kFloat},
                                {"count", n},
                                {"type", "VEC3"},
                                {"min", {low.x(), low.y(), low.z()}},
                                {"max", {high.x(), high.y(), high.z()}}});
  attributes["NORMAL"] = add(normals_at, colors_at - normals_at, kArray,
                             {{"componentType", kFloat}, {"count", n}, {"type", "VEC3"}});
  if (textured) {
    attributes["TEXCOORD_0"] = add(colors_at, indices_at - colors_at, kArray,
                                   {{"componentType", kFloat}, {"count", n}, {"type", "VEC2"}});
  } else if (!mesh.colors.empty()) {
    attributes["COLOR_0"] =
        add(colors_at, indices_at - colors_at, kArray,
            {{"componentType", kHalfWord}, {"normalized", true}, {"count", n}, {"type", "VEC4"}});
  }
  const std::size_t indices =
      add(indices_at, data.size() - indices_at, kIndices,
          {{"componentType", kWord}, {"count", 3 * mesh.triangles.size()}, {"type", "SCALAR"}});
  json surface = {{"metallicFactor", 0.0}, {"roughnessFactor", 1.0}};
  if (textured) {
    const std::string png = encode_png(texture);
    surface["baseColorTexture"] = {{"index", 0}};
    views.push_back({{"buffer", 0}, {"byteOffset", data.size()}, {"byteLength", png.size()}});
    data += png;
  }
  json document = {
      {"asset",
       {{"version", "2.0"},
        {"generator", std::string("Camber ") + kVersion},
        {"extras", {{"origin", {origin.x(), origin.y(), origin.z()}}}}}},
      {"scene", 0},
      {"scenes", {{{"nodes", {0}}}}},
      {"nodes", {{{"name", "road"}, {"mesh", 0}}}},
      {"materials", {{{"name", "road"}, {"pbrMetallicRoughness", surface}}}},
      {"meshes",
       {{{"name", "road"},
         {"primitives", {{{"attributes", attributes}, {"indices", indices}, {"material", 0}}}}}}},
      {"buffers", {{{"byteLength", data.size()}}}},
      {"bufferViews", views},
      {"accessors", accessors}};
  if (textured) {
    constexpr int kLinear = 9729, kMipmaps = 9987, kClamped = 33071;
    document["images"] = {{{"bufferView", views.size() - 1}, {"mimeType", "image/png"}}};
    document["samplers"] = {{{"magFilter", kLinear},
                             {"minFilter", kMipmaps},
                             {"wrapS", kClamped},
                             {"wrapT", kClamped}}};
    document["textures"] = {{{"source", 0}, {"sampler", 0}}};
  }
  std::string text = document.dump();
  text.append((4 - text.size() % 4) % 4, ' ');
  data.append((4 - data.size() % 4) % 4, '\0');
  std::string out;
  append(&out, std::uint32_t{0x46546c67});  // "glTF"
  append(&out, std::uint32_t{2});
  append(&out, static_cast<std::uint32_t>(28 + text.size() + data.size()));
  append(&out, static_cast<std::uint32_t>(text.size()));
  append(&out, std::uint32_t{0x4e4f534a});  // "JSON"
  out += text;
  append(&out, static_cast<std::uint32_t>(data.size()));
  append(&out, std::uint32_t{0x004e4942});  // "BIN"
  return out + data;
}

}  // namespace camber
