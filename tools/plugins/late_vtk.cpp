// The functions of the library that call VTK, as the other plugins have them: VTK is loaded at the
// first call. Linked before the library's archives, these definitions take the place of theirs.

#include "late_vtk.h"

#include "plugin.h"

namespace camber {
namespace {

const tools::VtkFunctions& vtk() {
  using Functions = const tools::VtkFunctions* (*)();
  static const auto* functions =
      reinterpret_cast<Functions>(tools::plugin_symbol("vtk", "camber_vtk"))();
  return *functions;
}

}  // namespace

TextBitmap rasterize_text(const std::string& line, int size, bool bold) {
  return vtk().rasterize_text(line, size, bold);
}

Image render_scene_content(const SceneShot& shot, KeptWindow* window, RenderRecord* record) {
  return vtk().render_scene_content(shot, window, record);
}

}  // namespace camber
