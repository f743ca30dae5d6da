#include "camber/render/gl_context.h"

// EGL before anything of X11, whose macros would break VTK's headers: X11 is used through the
// narrow declarations at the end of this list only.
#define EGL_NO_X11
#include <EGL/egl.h>
#include <EGL/eglext.h>
#include <vtkCallbackCommand.h>
#include <vtkCommand.h>
#include <vtkGenericOpenGLRenderWindow.h>
#include <vtkNew.h>
#include <vtkObject.h>
#include <vtkObjectFactory.h>
#include <vtkRenderWindow.h>
#include <vtkSmartPointer.h>

#include <X11/Xlib.h>
#include <fcntl.h>
#include <poll.h>
#include <spawn.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <stdexcept>
#include <thread>

#include "camber/core/errors.h"
#include "camber/core/memory.h"
#include "camber/render/detail/silenced_vtk.h"

namespace camber {
namespace {

constexpr int kMaxSide = 16384;
constexpr unsigned int kGlRenderer = 0x1F01;  // GL_RENDERER
constexpr unsigned int kGlVersion = 0x1F02;   // GL_VERSION

/// Address space of Mesa's software renderer with LLVM, measured: 420 MB for the first window of a
/// process on two cores besides a stack of 8 MB and a heap of 64 MB for each thread, little for
/// those after it; with buffers of colour and depth and the copies of a picture 60 bytes a pixel.
/// Mesa ends the process where it gets less.
constexpr std::size_t kFirstWindowBytes = std::size_t{420} << 20;
constexpr std::size_t kThreadBytes = std::size_t{72} << 20;
constexpr std::size_t kWindowBytes = std::size_t{64} << 20;
constexpr std::size_t kPixelBytes = 64;

void require_renderer_memory(int width, int height) {
  static bool first = true;
  const std::size_t threads = std::clamp(std::thread::hardware_concurrency(), 2u, 16u);
  const std::size_t pixels = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  require_address_space(
      (first ? kFirstWindowBytes + threads * kThreadBytes : kWindowBytes) + kPixelBytes * pixels,
      "drawing a picture of " + std::to_string(width) + " x " + std::to_string(height) + " pixels");
  first = false;
}

/// VTK's window for foreign contexts, with GLEW's complaint mended: on EGL glewInit() finds all
/// functions, then reports that there is no GLX display, and VTK would try again, and print an
/// error, at every render. The context's version has been checked before.
class SurfacelessWindow : public vtkGenericOpenGLRenderWindow {
 public:
  static SurfacelessWindow* New();
  vtkTypeMacro(SurfacelessWindow, vtkGenericOpenGLRenderWindow)

      void OpenGLInitContext() override {
    if (Initialized) return;
    const SilencedVtk silenced;
    Superclass::OpenGLInitContext();
    Initialized = true;
    GlewInitValid = true;
  }
};

vtkStandardNewMacro(SurfacelessWindow)

    std::string gl_string(unsigned int name) {
  using GetString = const unsigned char* (*)(unsigned int);
  const auto get = reinterpret_cast<GetString>(eglGetProcAddress("glGetString"));
  const unsigned char* text = get ? get(name) : nullptr;
  return text ? reinterpret_cast<const char*>(text) : "";
}

/// A desktop OpenGL 3.2 core context without any surface.
class SurfacelessContext {
 public:
  /// False, with the reason, if the machine has none.
  bool create(std::string* reason) {
    const char* extensions = eglQueryString(EGL_NO_DISPLAY, EGL_EXTENSIONS);
    if (!extensions || !std::strstr(extensions, "EGL_MESA_platform_surfaceless")) {
      *reason = "EGL has no surfaceless platform";
      return false;
    }
    display_ = eglGetPlatformDisplay(EGL_PLATFORM_SURFACELESS_MESA, EGL_DEFAULT_DISPLAY, nullptr);
    // The display is shared by all windows of the process and stays initialised: eglTerminate would
    // take it away from the others.
    if (display_ == EGL_NO_DISPLAY || !eglInitialize(display_, nullptr, nullptr)) {
      *reason = "EGL's surfaceless display cannot be initialised";
      return false;
    }
    if (!eglBindAPI(EGL_OPENGL_API)) {
      *reason = "EGL has no desktop OpenGL";
      return false;
    }
    const EGLint config_attributes[] = {EGL_SURFACE_TYPE, 0, EGL_RENDERABLE_TYPE, EGL_OPENGL_BIT,
                                        EGL_NONE};
    EGLConfig config = nullptr;
    EGLint count = 0;
    if (!eglChooseConfig(display_, config_attributes, &config, 1, &count) || count == 0) {
      config = nullptr;  // EGL_KHR_no_config_context: contexts without a surface need none
    }
    const EGLint context_attributes[] = {EGL_CONTEXT_MAJOR_VERSION,
                                         3,
                                         EGL_CONTEXT_MINOR_VERSION,
                                         2,
                                         EGL_CONTEXT_OPENGL_PROFILE_MASK,
                                         EGL_CONTEXT_OPENGL_CORE_PROFILE_BIT,
                                         EGL_NONE};
    context_ = eglCreateContext(display_, config, EGL_NO_CONTEXT, context_attributes);
    if (context_ == EGL_NO_CONTEXT || !make_current()) {
      *reason = "EGL makes no OpenGL 3.2 core context";
      return false;
    }
    int major = 0, minor = 0;
    const std::string version = gl_string(kGlVersion);
    if (std::sscanf(version.c_str(), "%d.%d", &major, &minor) != 2 || major * 10 + minor < 32) {
      *reason = "OpenGL " + (version.empty() ? "of an unknown version" : version) +
                " found, 3.2 or newer needed";
      return false;
    }
    return true;
  }

  ~SurfacelessContext() {
    if (context_ == EGL_NO_CONTEXT) return;
    if (is_current()) {
      eglMakeCurrent(display_, EGL_NO_SURFACE, EGL_NO_SURFACE, EGL_NO_CONTEXT);
    }
    eglDestroyContext(display_, context_);
  }

  bool make_current() {
    return eglMakeCurrent(display_, EGL_NO_SURFACE, EGL_NO_SURFACE, context_) == EGL_TRUE;
  }
  bool is_current() const {
    return context_ != EGL_NO_CONTEXT && eglGetCurrentContext() == context_;
  }

 private:
  EGLDisplay display_ = EGL_NO_DISPLAY;
  EGLContext context_ = EGL_NO_CONTEXT;
};

/// Whether a display answers and knows GLX. VTK's X window aborts the process where it does not.
bool display_answers(std::string* reason) {
  const char* name = std::getenv("DISPLAY");
  if (!name || !*name) {
    *reason = "DISPLAY is not set";
    return false;
  }
  Display* display = XOpenDisplay(nullptr);
  if (!display) {
    *reason = "the display \"" + std::string(name) + "\" does not answer";
    return false;
  }
  int opcode = 0, event = 0, error = 0;
  const bool has_glx = XQueryExtension(display, "GLX", &opcode, &event, &error) == True;
  XCloseDisplay(display);
  if (!has_glx) *reason = "the display \"" + std::string(name) + "\" has no GLX";
  return has_glx;
}

/// The connection to this process's own X server; nullptr: it has none.
Display*& virtual_display() {
  static Display* connection = nullptr;
  return connection;
}

/// An X server in memory for the rest of the process, started where nothing else can render. It
/// ends with the last connection, and so with this process, however that ends.
bool start_virtual_display(std::string* reason) {
  Display*& connection = virtual_display();
  if (connection) return true;
  int ends[2];
  if (::pipe2(ends, O_CLOEXEC) != 0) {
    *reason = "no pipe for Xvfb";
    return false;
  }
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_adddup2(&actions, ends[1], 3);
  posix_spawn_file_actions_addopen(&actions, 0, "/dev/null", O_RDONLY, 0);
  posix_spawn_file_actions_addopen(&actions, 1, "/dev/null", O_WRONLY, 0);
  posix_spawn_file_actions_addopen(&actions, 2, "/dev/null", O_WRONLY, 0);
  const char* const words[] = {"Xvfb", "-displayfd", "3", "-terminate",   "-nolisten",
                               "tcp",  "-screen",    "0", "1280x1024x24", nullptr};
  pid_t child = 0;
  const int failed =
      ::posix_spawnp(&child, words[0], &actions, nullptr, const_cast<char* const*>(words), environ);
  posix_spawn_file_actions_destroy(&actions);
  ::close(ends[1]);
  std::string number;
  pollfd ready{ends[0], POLLIN, 0};
  char letter = 0;
  while (failed == 0 && number.size() < 8 && ::poll(&ready, 1, 10000) > 0 &&
         ::read(ends[0], &letter, 1) == 1 && letter != '\n') {
    number += letter;
  }
  ::close(ends[0]);
  if (letter != '\n' || number.empty()) {
    *reason = "Xvfb cannot be started";
    return false;
  }
  const std::string name = ":" + number;
  connection = XOpenDisplay(name.c_str());
  if (!connection) {
    *reason = "Xvfb does not answer";
    return false;
  }
  ::setenv("DISPLAY", name.c_str(), 1);
  return true;
}

}  // namespace

std::string display_problem() {
  std::string reason;
  return display_answers(&reason) ? std::string() : reason;
}

struct OffscreenWindow::Impl {
  // Order matters: the window is destroyed while the context still lives.
  std::unique_ptr<SurfacelessContext> context;
  vtkSmartPointer<vtkRenderWindow> window;
  vtkNew<vtkCallbackCommand> make_current;
  vtkNew<vtkCallbackCommand> is_current;
  std::string backend;
  std::string renderer;

  bool open_surfaceless(int width, int height, std::string* reason) {
    context = std::make_unique<SurfacelessContext>();
    if (!context->create(reason)) {
      context.reset();
      return false;
    }
    renderer = gl_string(kGlRenderer);
    vtkNew<SurfacelessWindow> generic;
    make_current->SetClientData(context.get());
    make_current->SetCallback([](vtkObject*, unsigned long, void* data, void*) {
      static_cast<SurfacelessContext*>(data)->make_current();
    });
    is_current->SetClientData(context.get());
    is_current->SetCallback([](vtkObject*, unsigned long, void* data, void* answer) {
      *static_cast<bool*>(answer) = static_cast<SurfacelessContext*>(data)->is_current();
    });
    generic->AddObserver(vtkCommand::WindowMakeCurrentEvent, make_current);
    generic->AddObserver(vtkCommand::WindowIsCurrentEvent, is_current);
    generic->SetOwnContext(0);
    generic->SetSize(width, height);
    generic->SetReadyForRendering(true);
    generic->SetMultiSamples(0);
    generic->SetFrameBlitModeToNoBlit();  // there is nothing to blit to
    generic->OpenGLInit();
    window = generic;
    backend = "egl-surfaceless";
    return true;
  }

  bool open_display(int width, int height, std::string* reason) {
    if (!display_answers(reason)) return false;
    window = vtkSmartPointer<vtkRenderWindow>::New();
    if (!window) {
      *reason = "VTK has no window for this display";
      return false;
    }
    window->SetShowWindow(false);
    window->SetUseOffScreenBuffers(true);
    window->SetMultiSamples(0);
    window->SetSize(width, height);
    window->Render();
    if (!window->SupportsOpenGL()) {
      *reason = "the display has no OpenGL 3.2";
      window = nullptr;
      return false;
    }
    const std::string report = window->ReportCapabilities();
    const std::string key = "OpenGL renderer string:";
    const std::size_t at = report.find(key);
    if (at != std::string::npos) {
      const std::size_t begin = report.find_first_not_of(' ', at + key.size());
      renderer = report.substr(begin, report.find('\n', begin) - begin);
    }
    backend = virtual_display() ? "xvfb" : "display";
    return true;
  }

  ~Impl() {
    if (!window) return;
    if (context) context->make_current();
    window->Finalize();
    window->RemoveObserver(make_current);
    window->RemoveObserver(is_current);
  }
};

namespace {

void require_size(int width, int height) {
  if (width < 1 || height < 1 || width > kMaxSide || height > kMaxSide) {
    throw std::invalid_argument("picture size: found " + std::to_string(width) + " x " +
                                std::to_string(height) + " pixels, expected 1 to " +
                                std::to_string(kMaxSide) + " each");
  }
  require_renderer_memory(width, height);
}

}  // namespace

OffscreenWindow::OffscreenWindow(int width, int height) : impl_(std::make_unique<Impl>()) {
  require_size(width, height);
  // Mesa's warnings are about other drivers that it tried.
  ::setenv("EGL_LOG_LEVEL", "fatal", 0);
  std::string no_egl, no_display, no_xvfb;
  if (impl_->open_surfaceless(width, height, &no_egl)) return;
  if (impl_->open_display(width, height, &no_display)) return;
  if (start_virtual_display(&no_xvfb) && impl_->open_display(width, height, &no_xvfb)) return;
  throw MachineError("no rendering back end: " + no_egl + ", " + no_display + ", and " + no_xvfb +
                     "; install libegl-mesa0 and libgl1-mesa-dri, or run under an X server");
}

OffscreenWindow::~OffscreenWindow() = default;

void OffscreenWindow::resize(int width, int height) {
  const int* size = impl_->window->GetSize();
  if (size[0] == width && size[1] == height) return;
  require_size(width, height);
  impl_->window->SetSize(width, height);
}

vtkRenderWindow* OffscreenWindow::window() { return impl_->window; }

const std::string& OffscreenWindow::backend() const { return impl_->backend; }

std::string OffscreenWindow::renderer() const { return impl_->renderer; }

}  // namespace camber
