#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "camber/export/height_source.h"
#include "camber/export/smooth_line.h"
#include "camber/image/image.h"

namespace camber {

/// The road as one surface without holes: a grid of `columns` places across at each section of the
/// line, as wide as ground is seen there; gaps are bridged along the road.
struct RoadMesh {
  std::vector<Eigen::Vector3d> points;   ///< m, plan frame; section by section, right to left
  std::vector<Eigen::Vector3d> normals;  ///< unit, up
  std::vector<std::array<std::uint8_t, 3>> colors;      ///< or empty
  std::vector<std::array<std::uint32_t, 3>> triangles;  ///< counterclockwise seen from above
  std::size_t columns = 0;
  /// Colours between the points, RGB: rows along the line from its start, columns right to left;
  /// the point of section i and column j is the middle of texel (j, i) * texels. Or empty.
  Image texture;
  int texels = 1;  ///< a step of the grid
};

struct RoadMeshOptions {
  double step = 0.0;               ///< m, along and about so much across; 0: from the data
  double left = 0.0, right = 0.0;  ///< m to either side, >= 0; 0: as far as is seen
  double widest = 12.0;            ///< m, limit of what is seen
  int num_threads = 0;

  void validate() const;  ///< throws std::invalid_argument naming field, value and bound
};

/// @param colors  or nullptr. @throws NoAnswerError where nothing is seen beside the line.
RoadMesh make_road_mesh(const HeightSource& ground, const SmoothLine& line,
                        const ColorSource* colors, const RoadMeshOptions& options);

/// Binary PLY with double coordinates, normals and colours.
std::string encode_ply(const RoadMesh& mesh);
/// Wavefront OBJ with normals; colours behind the coordinates, as many programs read them.
std::string encode_obj(const RoadMesh& mesh);
/// Binary glTF 2.0, with the texture as PNG in place of the points' colours: y up, -z along the
/// plan frame's x; coordinates relative to the first point, which `asset.extras.origin` holds in
/// the plan frame.
std::string encode_glb(const RoadMesh& mesh);

}  // namespace camber
