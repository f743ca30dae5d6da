#include "camber/render/detail/silenced_vtk.h"

#include <vtkObject.h>

#include <mutex>

namespace camber {
namespace {

// VTK's switch is one for the process: the first sets it, the last sets it back.
std::mutex g_mutex;
int g_living = 0, g_before = 0;

}  // namespace

SilencedVtk::SilencedVtk() {
  const std::lock_guard<std::mutex> lock(g_mutex);
  if (g_living++ > 0) return;
  g_before = vtkObject::GetGlobalWarningDisplay();
  vtkObject::SetGlobalWarningDisplay(0);
}

SilencedVtk::~SilencedVtk() {
  const std::lock_guard<std::mutex> lock(g_mutex);
  if (--g_living == 0) vtkObject::SetGlobalWarningDisplay(g_before);
}

}  // namespace camber
