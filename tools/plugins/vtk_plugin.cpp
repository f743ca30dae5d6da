#include "late_vtk.h"
#include "plugin.h"

CAMBER_EXPORT const camber::tools::VtkFunctions* camber_vtk();
CAMBER_EXPORT const camber::tools::VtkFunctions* camber_vtk() {
  static const camber::tools::VtkFunctions functions = {camber::rasterize_text,
                                                        camber::render_scene_content};
  return &functions;
}
