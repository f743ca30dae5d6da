#pragma once

#include <filesystem>
#include <string>

#include "camber/image/image_io.h"

namespace camber {

struct SurfaceMapOptions {
  int width = 1600, height = 900;  ///< pixels, 64 to 8192
  std::string title;               ///< heading, one line; may be empty

  void validate() const;  ///< throws std::invalid_argument naming field, value and bound
};

/// The whole of a surface in tiles (read_surface_tiles()) from above, north up: each patch's
/// outline filled by the height of its middle, with axes in metres. Memory is that of the picture
/// and of one tile. Needs no rendering back end; same input, same pixels.
/// @param folder  has the folder surface
/// @throws std::invalid_argument, InputError; NoAnswerError where there are no patches
Image render_surface_map(const std::filesystem::path& folder, const SurfaceMapOptions& options);

}  // namespace camber
