// camber-view: the interactive viewer; started by `camber view`.

#include <QVTKOpenGLNativeWidget.h>

#include <QApplication>
#include <QElapsedTimer>
#include <QSurfaceFormat>
#include <QWindow>
#include <cstdio>
#include <cstdlib>
#include <new>

#include "camber/core/errors.h"
#include "camber/core/version.h"
#include "camber/render/gl_context.h"
#include "view_arguments.h"
#include "viewer_window.h"

namespace fs = std::filesystem;

#if defined(__SANITIZE_ADDRESS__)
/// Qt's fonts and Mesa keep memory to the end of the process: no leaks of ours.
extern "C" const char* __asan_default_options();
extern "C" const char* __asan_default_options() { return "detect_leaks=0"; }
#endif

namespace camber {
namespace {

LoadedResult load(const ViewArguments& a) {
  const LogSink warn = [](const std::string& sentence) {
    std::fprintf(stderr, "camber: warning: %s\n", sentence.c_str());
  };
  LoadedResult result = load_result(a.input);
  if (!a.scene.empty()) {
    result.scene = read_scene(a.scene, warn);
  } else if (const std::string missing = result.load_scene_of_run(warn); !missing.empty()) {
    warn(a.input + ": " + missing + "; --scene names it");
  }
  if (a.truth == "scene") {
    result.load_scene_truth_cloud();
  } else if (!a.truth.empty()) {
    result.truth_cloud = read_cloud_file(a.truth).cloud;
  }
  return result;
}

int run(const ViewArguments& a, int argc, char** argv) {
  LoadedResult result = load(a);
  const std::string platform = std::getenv("QT_QPA_PLATFORM") ? std::getenv("QT_QPA_PLATFORM") : "";
  const std::string problem = display_problem();
  if (!problem.empty() && (platform.empty() || platform == "xcb")) {
    // What is wrong with the content matters more than where it cannot be shown.
    make_picture_space(result.content(), true, PointColor::parse(a.color));
    throw MachineError("no display to open a window on: " + problem +
                       "; camber render draws pictures without one");
  }
  QSurfaceFormat::setDefaultFormat(QVTKOpenGLNativeWidget::defaultFormat());
  QApplication application(argc, argv);
  ViewerOptions options;
  options.color_name = a.color;
  options.color = PointColor::parse(a.color);
  options.frame = a.frame;
  if (a.up.size() == 3) options.up = Eigen::Vector3d(a.up[0], a.up[1], a.up[2]);
  options.snapshots = a.snapshots;
  options.title = result.scene ? result.scene->name : fs::path(a.input).filename().string();
  ViewerWindow window(std::move(result), options);
  if (!a.picture.empty()) {
    // Windows come up over several rounds of events: half a second after it is seen it stands.
    QElapsedTimer clock, seen;
    clock.start();
    while (clock.elapsed() < 20000 && !(seen.isValid() && seen.elapsed() > 500)) {
      QApplication::processEvents(QEventLoop::AllEvents, 50);
      if (!seen.isValid() && window.windowHandle() && window.windowHandle()->isExposed()) {
        seen.start();
      }
    }
    window.save(a.picture);
    return 0;
  }
  return QApplication::exec();
}

int report(const char* message, int exit_code) {
  std::fprintf(stderr, "camber: %s\n", message);
  return exit_code;
}

}  // namespace
}  // namespace camber

int main(int argc, char** argv) {
  camber::tools::App app(
      "Camber's interactive viewer: turns, picks and switches what camber render draws",
      "camber-view");
  app.set_version(std::string("camber-view ") + camber::kVersion);
  camber::ViewArguments arguments;
  arguments.add_to(app);
  const int done = app.parse(argc, argv);
  if (done >= 0) return done;
  try {
    return camber::run(arguments, argc, argv);
  } catch (const camber::Error& error) {
    return camber::report(error.what(), error.exit_code());
  } catch (const std::bad_alloc&) {
    return camber::report("out of memory", 3);
  } catch (const std::invalid_argument& error) {
    return camber::report(error.what(), 2);
  } catch (const std::exception& error) {
    return camber::report(error.what(), 3);
  }
}
