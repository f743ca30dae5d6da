#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "camber/image/image.h"

namespace camber::detail {

/// A binary glTF 2.0 file (GLB) as it is put together: numbers go into its one buffer, everything
/// else into its JSON. Functions return the index of what they add.
class GltfFile {
 public:
  enum Mode { kPoints = 0, kLines = 1, kTriangles = 4 };  ///< of a primitive

  /// @param origin  of the file, in the input's coordinates: `asset.extras.origin`.
  explicit GltfFile(const Eigen::Vector3d& origin);

  /// A colour that no light changes. Colours of files and screens are sRGB, those of glTF's factors
  /// and vertices are linear.
  int material(const std::array<std::uint8_t, 3>& color, double alpha, const std::string& name);

  int positions(const std::vector<Eigen::Vector3f>& points);  ///< with their bounds
  int vectors(const std::vector<Eigen::Vector3f>& values);    ///< normals
  int coordinates(const std::vector<Eigen::Vector2f>& values);
  int scalars(const std::vector<float>& values);
  int colors(const std::vector<std::array<std::uint8_t, 3>>& inks);
  int indices(const std::vector<std::uint32_t>& values);
  int texture(const Image& image);  ///< as PNG, not repeated

  /// @param list  "materials", "nodes", ...: of the file's lists.
  int add(const char* list, nlohmann::json value);
  int mesh_node(const std::string& name, nlohmann::json primitives, nlohmann::json extras = {});
  int group(const std::string& name, const std::vector<int>& children);

  /// The bytes. @param nodes  at the top of the scene.
  /// @throws std::invalid_argument for more than 4 GiB.
  std::string finish(const std::string& name, const std::vector<int>& nodes);

 private:
  template <typename T>
  int accessor(const T* values, std::size_t count, std::size_t components, int target,
               nlohmann::json description);
  int buffer_view(const void* data, std::size_t bytes, int target);

  nlohmann::json root_;
  std::string binary_;
};

}  // namespace camber::detail
