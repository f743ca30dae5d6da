#pragma once

#include "camber/render/detail/vtk_drawing.h"

namespace camber::tools {

/// What the plugin vtk exports as camber_vtk(): the functions of the library that call VTK.
struct VtkFunctions {
  decltype(&camber::rasterize_text) rasterize_text;
  decltype(&camber::render_scene_content) render_scene_content;
};

}  // namespace camber::tools
