#pragma once

#include <cstddef>
#include <filesystem>
#include <string>

#include "camber/render/pictures.h"

namespace camber {

struct GltfOptions {
  std::size_t max_points = 0;  ///< evenly thinned to at most so many; 0: all
  PointColor color;
  bool show_truth = true;
  /// Points also carry `_SIGMA` (standard deviation along the ray) and `_PATCH` (id, -1 none), as
  /// far as the cloud has them.
  bool point_facts = false;

  void validate() const;  ///< throws std::invalid_argument
};

/// A reconstruction as binary glTF 2.0: metres, y up, -z ahead, origin as in the pictures. Named
/// nodes: "road points", "patches" / "patch N", "vehicles" / "car N" (body, wireframe and box;
/// facts in `extras`), "truth" / "true car N", "cameras" / "camera N" and "path". Where the origin
/// is in the input's coordinates is in `asset.extras.origin`. Stray points are left out as in the
/// pictures. Same input, same bytes.
/// @throws NoAnswerError if there is nothing finite to show.
std::string encode_glb(const PictureContent& content, const GltfOptions& options = {});

/// Writes it, atomically. @throws OutputError also.
void write_glb(const PictureContent& content, const std::filesystem::path& path,
               const GltfOptions& options = {});

}  // namespace camber
