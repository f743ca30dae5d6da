#pragma once

namespace camber {

/// Switches VTK's warnings off for as long as it lives.
class SilencedVtk {
 public:
  SilencedVtk();
  ~SilencedVtk();
  SilencedVtk(const SilencedVtk&) = delete;
  SilencedVtk& operator=(const SilencedVtk&) = delete;

 private:
  int before_;
};

}  // namespace camber
