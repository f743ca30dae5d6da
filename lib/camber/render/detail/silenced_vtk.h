#pragma once

#include <vtkObject.h>

namespace camber {

/// Switches VTK's warnings off for as long as it lives.
class SilencedVtk {
 public:
  SilencedVtk() : before_(vtkObject::GetGlobalWarningDisplay()) {
    vtkObject::SetGlobalWarningDisplay(0);
  }
  ~SilencedVtk() { vtkObject::SetGlobalWarningDisplay(before_); }
  SilencedVtk(const SilencedVtk&) = delete;
  SilencedVtk& operator=(const SilencedVtk&) = delete;

 private:
  int before_;
};

}  // namespace camber
