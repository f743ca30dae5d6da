#pragma once

#include <memory>
#include <string>

class vtkRenderWindow;

namespace camber {

/// Why no window can be opened on the display that DISPLAY names; empty: it answers and has GLX.
std::string display_problem();

/// An off-screen OpenGL window for VTK that needs no X server: a surfaceless EGL context, else an
/// existing display, else an Xvfb of its own, which DISPLAY then names. Use from one thread;
/// windows may be made one after another in a process.
class OffscreenWindow {
 public:
  /// @param width, height  pixels, 1 to 16384.
  /// @throws MachineError if no rendering back end answers.
  OffscreenWindow(int width, int height);
  ~OffscreenWindow();
  OffscreenWindow(const OffscreenWindow&) = delete;
  OffscreenWindow& operator=(const OffscreenWindow&) = delete;

  /// @param width, height  pixels, 1 to 16384.
  void resize(int width, int height);

  vtkRenderWindow* window();
  /// "egl-surfaceless", "display" or "xvfb"
  const std::string& backend() const;
  /// GL_RENDERER, "llvmpipe (LLVM 15.0.6, 256 bits)"; known after the first render.
  std::string renderer() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace camber
