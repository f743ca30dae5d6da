// camber-view: the interactive viewer; started by `camber view`.

#include <QVTKOpenGLNativeWidget.h>

#include <QApplication>
#include <QElapsedTimer>
#include <QSurfaceFormat>
#include <QWindow>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <set>

#include "../tools/crs.h"
#include "../tools/own_inputs.h"
#include "../tools/standard_streams.h"
#include "camber/core/errors.h"
#include "camber/core/protected_inputs.h"
#include "camber/core/stopwatch.h"
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

/// What the program takes: the view, and what every command takes.
struct Arguments {
  ViewArguments view;
  std::uint64_t seed = 0;
  bool quiet = false;
};

LoadedResult load(const ViewArguments& a, const LogSink& warn) {
  const ScenePaths paths = tools::scene_paths(a.confine);
  ReadOptions reading;
  if (a.bounds.size() == 4) {
    reading.bounds = PlanBounds{a.bounds[0], a.bounds[1], a.bounds[2], a.bounds[3]};
    reading.bounds->validate();
  }
  LoadedResult result = load_result(a.input, reading);
  if (result.cloud) tools::use_metres(a.input, &*result.cloud, &result.cloud_report, warn);
  if (!a.scene.empty()) {
    result.scene = read_scene(a.scene, warn, paths);
  } else if (const std::string missing = result.load_scene_of_run(warn, paths);
             !missing.empty() && warn) {
    warn(a.input + ": " + missing + "; --scene names it");
  }
  protect_inputs({a.input, a.scene, a.truth});
  if (result.scene) protect_inputs(files_of(*result.scene));
  if (a.truth == "scene") {
    result.load_scene_truth_cloud();
  } else if (!a.truth.empty()) {
    CloudFile truth = read_cloud_file(a.truth);
    tools::use_metres(a.truth, &truth, warn);
    result.truth_cloud = std::move(truth.cloud);
  }
  return result;
}

/// @throws UsageError for a name that is no PNG's, and for a frame that the result does not hold;
/// of a bare cloud none is asked.
void check_arguments(const ViewArguments& a, const LoadedResult& result) {
  if (!a.picture.empty() && fs::path(a.picture).extension() != ".png") {
    throw UsageError("--picture: found '" + a.picture + "', expected FILE.png");
  }
  std::set<int> ids;
  if (result.run) {
    for (const RunDocument::CameraPose& camera : result.run->cameras) ids.insert(camera.id);
  }
  if (result.vehicles) {
    for (const VehicleFrame& frame : result.vehicles->frames) ids.insert(frame.id);
  }
  if (!a.frame || ids.empty() || ids.count(*a.frame) > 0) return;
  std::string list;
  for (const int id : ids) list += (list.empty() ? "" : ", ") + std::to_string(id);
  throw UsageError("--frame: found " + std::to_string(*a.frame) +
                   ", expected one of the frames of " + a.input + ": " + list);
}

/// @throws MachineError where no window can be opened.
void require_display(const ViewArguments& a, const LoadedResult& result) {
  const std::string platform = std::getenv("QT_QPA_PLATFORM") ? std::getenv("QT_QPA_PLATFORM") : "";
  const std::string problem = display_problem();
  if (problem.empty() || (!platform.empty() && platform != "xcb")) return;
  // What is wrong with the content matters more than where it cannot be shown.
  make_picture_space(result.content(), true, PointColor::parse(a.color));
  throw MachineError("no display to open a window on: " + problem +
                     "; camber render draws pictures without one");
}

ViewerOptions options_of(const ViewArguments& a, const LoadedResult& result) {
  ViewerOptions options;
  options.color_name = a.color;
  options.color = PointColor::parse(a.color);
  options.frame = a.frame;
  if (a.up.size() == 3) options.up = Eigen::Vector3d(a.up[0], a.up[1], a.up[2]);
  options.snapshots = a.snapshots;
  options.title = result.scene ? result.scene->name : fs::path(a.input).filename().string();
  return options;
}

/// Windows come up over several rounds of events: half a second after it is seen it stands.
void wait_until_shown(const ViewerWindow& window) {
  QElapsedTimer clock, seen;
  clock.start();
  while (clock.elapsed() < 20000 && !(seen.isValid() && seen.elapsed() > 500)) {
    QApplication::processEvents(QEventLoop::AllEvents, 50);
    if (!seen.isValid() && window.windowHandle() && window.windowHandle()->isExposed()) {
      seen.start();
    }
  }
}

/// What was shown and written, on stdout.
void print_json(const Arguments& a, const std::string& scene, const ViewerWindow& window,
                const Timings& timings) {
  using nlohmann::json;
  const ViewArguments& view = a.view;
  json out = {{"version", kVersion},
              {"seed", a.seed},
              {"options",
               {{"scene", view.scene},
                {"truth", view.truth},
                {"color", view.color},
                {"up", view.up},
                {"snapshots", view.snapshots},
                {"picture", view.picture}}},
              {"file", view.input},
              {"scene", scene},
              {"frame", window.frame()},
              {"points", window.space().points.size()},
              {"patches", window.space().patches.size()},
              {"vehicles", window.space().vehicles.size()},
              {"files", json::array()},
              {"timings_ms", {{"load", 0.0}, {"compute", 0.0}, {"write", 0.0}}}};
  out["options"]["frame"] = view.frame ? json(*view.frame) : json(nullptr);
  for (const fs::path& path : window.written()) out["files"].push_back(path.string());
  for (const auto& [stage, ms] : timings.stages()) out["timings_ms"][stage] = ms;
  std::printf("%s\n", out.dump(2, ' ', false, json::error_handler_t::replace).c_str());
}

int run(const Arguments& a, int argc, char** argv) {
  const ViewArguments& view = a.view;
  LogSink warn;
  if (!a.quiet) {
    warn = [](const std::string& sentence) {
      std::fprintf(stderr, "camber: warning: %s\n", sentence.c_str());
    };
  }
  Timings timings;
  StageTimer load_timer(timings, "load");
  LoadedResult result = load(view, warn);
  load_timer.stop();
  check_arguments(view, result);
  std::string scene = view.scene;
  if (scene.empty() && result.scene) scene = result.run->scene;
  require_display(view, result);

  StageTimer compute(timings, "compute");
  QSurfaceFormat::setDefaultFormat(QVTKOpenGLNativeWidget::defaultFormat());
  QApplication application(argc, argv);
  const ViewerOptions options = options_of(view, result);
  ViewerWindow window(std::move(result), options);
  int exit_code = 0;
  if (view.picture.empty()) {
    compute.stop();
    exit_code = QApplication::exec();
  } else {
    wait_until_shown(window);
    if (!window.draws()) {
      throw MachineError("the window system gives no OpenGL to draw the scene with: " +
                         QApplication::platformName().toStdString() +
                         "; camber render draws pictures without a window");
    }
    compute.stop();
    const StageTimer write(timings, "write");
    window.save(view.picture);
  }
  if (view.json) print_json(a, scene, window, timings);
  return exit_code;
}

}  // namespace
}  // namespace camber

int main(int argc, char** argv) {
  camber::tools::App app(
      "Camber's interactive viewer: turns, picks and switches what camber render draws",
      "camber-view");
  app.set_version(std::string("camber-view ") + camber::kVersion);
  camber::Arguments arguments;
  arguments.view.add_to(app);
  app.add_option("--seed", arguments.seed, "as every command takes it; nothing here is random")
      ->capture_default_str();
  app.add_flag("--quiet", arguments.quiet, "no warnings");
  const int done = app.parse(argc, argv);
  if (done >= 0) return done;
  try {
    return camber::tools::finish_standard_output(camber::run(arguments, argc, argv));
  } catch (const std::exception& error) {
    return camber::tools::report_failure(error);
  }
}
