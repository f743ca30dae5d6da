#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "camber/render/picture_space.h"
#include "camber/render/pictures.h"
#include "camber/render/scene_camera.h"

namespace camber {

// What pictures ask of VTK. Everything else of this folder calls VTK through these functions only,
// so that a program can load it when the first of them is called (tools/plugins).

/// Opacity of one line of text, rows from the top; 0 x 0 where nothing is to be seen.
struct TextBitmap {
  int width = 0;
  int height = 0;
  std::vector<std::uint8_t> opacity;  ///< height * width
};

/// VTK's own font; no GL is needed. @param size  pixels, of the font.
TextBitmap rasterize_text(const std::string& line, int size, bool bold);

/// One view of a scene.
struct SceneShot {
  const PictureContent& content;
  const PictureSpace& space;
  const ScenePictureOptions& options;
  const SceneCamera& camera;
  const SceneGrid& grid;
  Color background = kPaper;
  double line_unit = 1.0;  ///< pixels of a line of width one
};

/// An off-screen window that is kept from shot to shot; OpenGL's start and the compiled shaders are
/// those of the window.
using KeptWindow = std::shared_ptr<void>;

/// Pixels of the 3D content without any text.
/// @param window  opened where it is empty. @param record  may be nullptr.
/// @throws MachineError if no rendering back end answers.
Image render_scene_content(const SceneShot& shot, KeptWindow* window, RenderRecord* record);

}  // namespace camber
