#include "camber/scene/detail/gltf_file.h"

#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

#include "camber/core/version.h"
#include "camber/image/image_io.h"
#include "camber/image/srgb.h"

namespace camber::detail {
namespace {

using nlohmann::json;

// Numbers of the glTF 2.0 specification.
constexpr int kFloat = 5126, kUnsignedInt = 5125, kUnsignedShort = 5123;
constexpr int kNoTarget = 0, kArrayBuffer = 34962, kElementArrayBuffer = 34963;
constexpr int kLinear = 9729, kLinearMipmaps = 9987, kClampToEdge = 33071;
constexpr std::array<const char*, 8> kLists = {"nodes",       "meshes", "materials", "accessors",
                                               "bufferViews", "images", "samplers",  "textures"};

template <int N>
std::vector<float> flat(const std::vector<Eigen::Matrix<float, N, 1>>& values) {
  std::vector<float> out;
  out.reserve(N * values.size());
  for (const auto& value : values) out.insert(out.end(), value.data(), value.data() + N);
  return out;
}

}  // namespace

GltfFile::GltfFile(const Eigen::Vector3d& origin) {
  const Eigen::Vector3d place = origin + Eigen::Vector3d::Zero();  // -0 becomes 0
  root_["asset"] = {{"version", "2.0"},
                    {"generator", std::string("Camber ") + kVersion},
                    {"extras", {{"origin", {place.x(), place.y(), place.z()}}}}};
  root_["scene"] = 0;
  for (const char* list : kLists) root_[list] = json::array();
}

int GltfFile::material(const std::array<std::uint8_t, 3>& color, double alpha,
                       const std::string& name) {
  root_["extensionsUsed"] = json::array({"KHR_materials_unlit"});
  json m = {{"name", name},
            {"pbrMetallicRoughness",
             {{"baseColorFactor",
               {linear_from_srgb(color[0]), linear_from_srgb(color[1]), linear_from_srgb(color[2]),
                alpha}},
              {"metallicFactor", 0.0},
              {"roughnessFactor", 1.0}}},
            {"doubleSided", true},
            {"extensions", {{"KHR_materials_unlit", json::object()}}}};
  if (alpha < 1.0) m["alphaMode"] = "BLEND";
  return add("materials", std::move(m));
}

int GltfFile::positions(const std::vector<Eigen::Vector3f>& points) {
  Eigen::Vector3f low = Eigen::Vector3f::Constant(std::numeric_limits<float>::max());
  Eigen::Vector3f high = -low;
  for (const Eigen::Vector3f& p : points) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  return accessor(flat(points).data(), points.size(), 3, kArrayBuffer,
                  {{"componentType", kFloat},
                   {"type", "VEC3"},
                   {"min", {low.x(), low.y(), low.z()}},
                   {"max", {high.x(), high.y(), high.z()}}});
}

int GltfFile::vectors(const std::vector<Eigen::Vector3f>& values) {
  return accessor(flat(values).data(), values.size(), 3, kArrayBuffer,
                  {{"componentType", kFloat}, {"type", "VEC3"}});
}

int GltfFile::coordinates(const std::vector<Eigen::Vector2f>& values) {
  return accessor(flat(values).data(), values.size(), 2, kArrayBuffer,
                  {{"componentType", kFloat}, {"type", "VEC2"}});
}

int GltfFile::scalars(const std::vector<float>& values) {
  return accessor(values.data(), values.size(), 1, kArrayBuffer,
                  {{"componentType", kFloat}, {"type", "SCALAR"}});
}

int GltfFile::colors(const std::vector<std::array<std::uint8_t, 3>>& inks) {
  constexpr std::uint16_t kOpaque = 65535;
  std::array<std::uint16_t, 256> linear;
  for (std::size_t i = 0; i < linear.size(); ++i) {
    linear[i] = static_cast<std::uint16_t>(
        std::lround(kOpaque * linear_from_srgb(static_cast<std::uint8_t>(i))));
  }
  std::vector<std::uint16_t> values;
  values.reserve(4 * inks.size());
  for (const auto& ink : inks) {
    values.insert(values.end(), {linear[ink[0]], linear[ink[1]], linear[ink[2]], kOpaque});
  }
  return accessor(values.data(), inks.size(), 4, kArrayBuffer,
                  {{"componentType", kUnsignedShort}, {"normalized", true}, {"type", "VEC4"}});
}

int GltfFile::indices(const std::vector<std::uint32_t>& values) {
  return accessor(values.data(), values.size(), 1, kElementArrayBuffer,
                  {{"componentType", kUnsignedInt}, {"type", "SCALAR"}});
}

int GltfFile::texture(const Image& image) {
  const std::string png = encode_png(image);
  const int view = buffer_view(png.data(), png.size(), kNoTarget);
  const int source = add("images", {{"bufferView", view}, {"mimeType", "image/png"}});
  const int sampler = add("samplers", {{"magFilter", kLinear},
                                       {"minFilter", kLinearMipmaps},
                                       {"wrapS", kClampToEdge},
                                       {"wrapT", kClampToEdge}});
  return add("textures", {{"source", source}, {"sampler", sampler}});
}

int GltfFile::add(const char* list, json value) {
  root_[list].push_back(std::move(value));
  return static_cast<int>(root_[list].size()) - 1;
}

int GltfFile::mesh_node(const std::string& name, json primitives, json extras) {
  const int mesh = add("meshes", {{"name", name}, {"primitives", std::move(primitives)}});
  json node = {{"name", name}, {"mesh", mesh}};
  if (!extras.empty()) node["extras"] = std::move(extras);
  return add("nodes", std::move(node));
}

int GltfFile::group(const std::string& name, const std::vector<int>& children) {
  return add("nodes", {{"name", name}, {"children", children}});
}

std::string GltfFile::finish(const std::string& name, const std::vector<int>& nodes) {
  root_["scenes"] = json::array({{{"name", name.empty() ? "scene" : name}, {"nodes", nodes}}});
  root_["buffers"] = json::array({{{"byteLength", binary_.size()}}});
  for (const char* list : kLists) {
    if (root_[list].empty()) root_.erase(list);  // the specification allows no empty ones
  }
  std::string text = root_.dump(-1, ' ', false, json::error_handler_t::replace);
  text.append((4 - text.size() % 4) % 4, ' ');
  std::string out;
  const auto put = [&](std::uint32_t value) {
    for (int i = 0; i < 4; ++i) out.push_back(static_cast<char>(value >> (8 * i) & 255));
  };
  const std::size_t length = 12 + 8 + text.size() + 8 + binary_.size();
  if (length > std::numeric_limits<std::uint32_t>::max()) {
    throw std::invalid_argument("a glTF file holds at most 4 GiB: thin the points");
  }
  out += "glTF";
  put(2);
  put(static_cast<std::uint32_t>(length));
  put(static_cast<std::uint32_t>(text.size()));
  out += "JSON";
  out += text;
  put(static_cast<std::uint32_t>(binary_.size()));
  out.append("BIN\0", 4);
  out += binary_;
  return out;
}

template <typename T>
int GltfFile::accessor(const T* values, std::size_t count, std::size_t components, int target,
                       json description) {
  description["bufferView"] = buffer_view(values, count * components * sizeof(T), target);
  description["count"] = count;
  return add("accessors", std::move(description));
}

int GltfFile::buffer_view(const void* data, std::size_t bytes, int target) {
  json view = {{"buffer", 0}, {"byteOffset", binary_.size()}, {"byteLength", bytes}};
  if (target != kNoTarget) view["target"] = target;
  binary_.append(static_cast<const char*>(data), bytes);
  binary_.append((4 - binary_.size() % 4) % 4, '\0');
  return add("bufferViews", std::move(view));
}

}  // namespace camber::detail
