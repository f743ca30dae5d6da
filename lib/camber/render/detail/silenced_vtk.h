#pragma once

namespace camber {

/// Switches VTK's warnings off for as long as one of them lives, in whatever thread.
class SilencedVtk {
 public:
  SilencedVtk();
  ~SilencedVtk();
  SilencedVtk(const SilencedVtk&) = delete;
  SilencedVtk& operator=(const SilencedVtk&) = delete;
};

}  // namespace camber
