// camber render: a picture of a result folder or of any cloud, without a display.

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <memory>
#include <nlohmann/json.hpp>

#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "camber/core/protected_inputs.h"
#include "camber/core/stopwatch.h"
#include "camber/core/version.h"
#include "camber/render/contact_sheet.h"
#include "camber/render/film.h"
#include "camber/render/frame_overlay.h"
#include "camber/render/gltf.h"
#include "camber/render/loaded_result.h"
#include "camber/render/pictures.h"
#include "camber/render/report.h"
#include "camber/render/result_plots.h"
#include "camber/render/surface_map.h"
#include "camber/render/vehicle_comparison.h"
#include "camber/scene/surface_tiles.h"
#include "command.h"
#include "crs.h"
#include "own_inputs.h"
#include "render_arguments.h"
#include "unknown_scale.h"

namespace fs = std::filesystem;
using nlohmann::json;

namespace camber::tools {
namespace {

constexpr double kDegree = M_PI / 180.0;

/// "out.png" and 3 give "out_003.png".
fs::path numbered(const fs::path& path, int index) {
  return path.parent_path() /
         fmt::format("{}_{:03d}{}", path.stem().string(), index, path.extension().string());
}

std::string make_glb(const PictureContent& content, const ScenePictureOptions& picture) {
  GltfOptions options;
  options.color = picture.color;
  options.show_truth = picture.show_truth;
  return encode_glb(content, options);
}

void report(const Command& command, const RenderArguments& a, const ScenePictureOptions& picture,
            const std::vector<fs::path>& written, const RenderRecord& record,
            const Timings& timings) {
  if (a.json) {
    json out;
    out["version"] = kVersion;
    out["seed"] = command.common.seed;
    out["options"] = {{"view", a.camera.empty() ? a.view : "free"},
                      {"color", a.color},
                      {"width", picture.width},
                      {"height", picture.height},
                      {"supersampling", picture.supersampling},
                      {"truth", picture.show_truth}};
    add_other_options(command, &out["options"]);
    out["files"] = json::array();
    for (const fs::path& path : written) out["files"].push_back(path.string());
    out["gl_backend"] = record.backend;
    out["gl_renderer"] = record.renderer;
    out["timings_ms"] = json::object();
    for (const auto& [stage, ms] : timings.stages()) out["timings_ms"][stage] = ms;
    std::printf("%s\n", out.dump(2).c_str());
  } else if (!command.common.quiet) {
    for (const fs::path& path : written) std::printf("%s\n", path.string().c_str());
  }
}

/// The frames of a result that a --frames list names.
std::vector<int> frames_of(const LoadedResult& result, const std::string& list) {
  Scene known;  // with the result's frames, as select_frames() takes them
  if (result.vehicles) {
    for (const VehicleFrame& frame : result.vehicles->frames) {
      known.frames.emplace_back().id = frame.id;
    }
  } else if (result.run) {
    for (const RunDocument::CameraPose& camera : result.run->cameras) {
      known.frames.emplace_back().id = camera.id;
    }
  }
  if (known.frames.empty()) {
    throw NoAnswerError("--frames: " + result.path.string() + " holds no frames");
  }
  return select_frames(known, list);
}

/// @throws UsageError for a frame that the result does not hold; of a bare cloud none is asked.
void check_frame(const LoadedResult& result, int frame) {
  std::vector<int> ids;
  if (result.vehicles) {
    for (const VehicleFrame& f : result.vehicles->frames) ids.push_back(f.id);
  } else if (result.run) {
    for (const RunDocument::CameraPose& camera : result.run->cameras) ids.push_back(camera.id);
  }
  if (ids.empty() || std::find(ids.begin(), ids.end(), frame) != ids.end()) return;
  throw UsageError(fmt::format("--frame: found {}, expected one of the frames of {}: {}", frame,
                               result.path.string(), fmt::join(ids, ", ")));
}

/// A series of pictures: to files of their own, one contact sheet or a film.
struct Series {
  int count = 1;
  std::function<Image(int)> picture;
  std::function<std::string(int)> caption;  ///< below it on a contact sheet
  std::function<int(int)> number;           ///< in its file's name
};

/// Draws all, then writes: a picture that fails leaves nothing behind.
std::vector<fs::path> write_series(const Series& series, const RenderArguments& a, double rate,
                                   const Progress& progress, Timings& timings) {
  const fs::path out = a.out;
  std::optional<FilmWriter> film;
  std::optional<ContactSheet> sheet;
  if (FilmWriter::knows(out.extension().string())) {
    film.emplace(out, rate);
  } else if (a.sheet) {
    sheet.emplace(series.count, ContactSheetOptions{a.sheet_columns, 2400});
  }
  std::vector<std::pair<fs::path, Image>> pictures;
  {
    const StageTimer compute(timings, "compute");
    for (int i = 0; i < series.count; ++i) {
      progress("render", static_cast<double>(i) / series.count);
      if (!film && !sheet) check_output_file(numbered(out, series.number(i)));
      Image picture = series.picture(i);
      if (film) {
        film->add(picture);
      } else if (sheet) {
        sheet->add(picture, series.caption(i));
      } else {
        pictures.emplace_back(numbered(out, series.number(i)), std::move(picture));
      }
    }
    progress("render", 1.0);
  }
  const StageTimer write(timings, "write");
  if (film) film->finish();
  if (sheet) write_png(sheet->sheet(), out);
  if (film || sheet) return {out};
  std::vector<fs::path> written;
  AtomicFiles files;
  for (const auto& [path, image] : pictures) {
    write_png(image, files.stage(path));
    written.push_back(path);
  }
  files.commit();
  return written;
}

/// Plots of one panel that fill a picture of the wanted size.
PlotStyle plot_style(const ScenePictureOptions& options) {
  PlotStyle style;
  style.width = options.width;
  style.text_size = std::clamp(options.width / 70.0, 8.0, 60.0);
  style.panel_height =
      std::max(120, static_cast<int>(options.height - std::ceil(2.6 * style.text_size)));
  return style;
}

/// A bar a stage of the run that made a result.
Image draw_timings(const LoadedResult& result, const std::string& title,
                   const ScenePictureOptions& options) {
  if (!result.run) {
    throw NoAnswerError(result.path.string() + " is no result folder: it tells no timings");
  }
  return draw_plots(timing_plots(result.run->timings, "Time of each stage: " + title),
                    plot_style(options));
}

/// Reads the scene of --scene, else that of the run.
/// @throws UsageError where something is to be drawn that needs a scene, and there is none.
void read_scene_of(const RenderArguments& a, LoadedResult& result, const LogSink& warn) {
  std::string missing;
  if (!a.scene.empty()) {
    result.scene = read_scene(a.scene, warn, scene_paths(a.confine));
  } else {
    missing = result.load_scene_of_run(warn, scene_paths(a.confine));
  }
  if (result.scene) return;
  const auto refuse = [&](const std::string& what) {
    throw UsageError(what + (missing.empty() ? "" : ", and " + missing));
  };
  if (a.view == "overlay") {
    refuse("--view overlay draws onto the images of a scene: expected --scene");
  }
  if (!a.beside.empty()) refuse("--beside needs the truth: expected --scene");
  if (a.truth == "scene") refuse("--truth scene: expected a --scene that has a truth cloud");
  if (!missing.empty()) {
    if (a.view == "driver") refuse("--view driver needs the camera: expected --scene");
    warn(a.input + ": " + missing + ": drawn without its images and truth; --scene names it");
  }
}

bool is_metric(const LoadedResult& result) {
  if (result.run) return result.run->metric;
  if (result.surface) return result.surface->metric;
  if (result.cloud) return result.cloud->metric;
  return !result.vehicles || result.vehicles->metric;
}

/// A free view in the coordinates of the input, whose unit may not be the metre.
FreeView in_metres(FreeView view, const ReadReport& report) {
  if (!report.crs || report.crs->metric() || report.crs->horizontal.angle) return view;
  const double across = report.crs->horizontal.metres;
  const Eigen::Vector3d unit(across, across, report.crs->vertical.metres);
  view.eye = view.eye.cwiseProduct(unit);
  view.target = view.target.cwiseProduct(unit);
  return view;
}

/// What is drawn, in memory.
struct Loaded {
  LoadedResult result;
  std::vector<LoadedResult> others;  ///< of --beside
};

Loaded load(const RenderArguments& a, const LogSink& warn) {
  Loaded loaded;
  LoadedResult& result = loaded.result;
  result = load_result(a.input, a.cloud.read_options());
  warn_about(a.input, result.cloud_report, warn);
  if (result.cloud) use_metres(a.input, &*result.cloud, &result.cloud_report, warn);
  read_scene_of(a, result, warn);
  if (result.scene) protect_inputs(files_of(*result.scene));
  check_output_file(a.out);
  if (a.truth == "scene") {
    result.load_scene_truth_cloud(a.cloud.read_options());
  } else if (!a.truth.empty()) {
    CloudFile truth = read_cloud_file(a.truth, a.cloud.read_options());
    use_metres(a.truth, &truth, warn);
    result.truth_cloud = std::move(truth.cloud);
  }
  for (const std::string& other : a.beside) loaded.others.push_back(load_result(other));
  const bool beside = !a.beside.empty();
  const bool metric = !result.run || result.run->metric;
  if (beside && metric && result.scene->truth && !result.scene->truth->cloud.empty() &&
      !result.truth_cloud) {
    result.load_scene_truth_cloud(a.cloud.read_options());
  }
  return loaded;
}

/// The content of the loaded result, which it points into.
PictureContent content_of(const RenderArguments& a, const LoadedResult& result) {
  PictureContent content = result.content();
  if (a.frame) {
    check_frame(result, *a.frame);
    content.frame = *a.frame;
  }
  if (!a.up.empty()) content.up = Eigen::Vector3d(a.up[0], a.up[1], a.up[2]);
  content.title = a.title;
  if (content.title.empty() && result.scene) content.title = result.scene->name;
  if (content.title.empty()) content.title = fs::path(a.input).filename().string();
  return content;
}

/// Draws a plan, of any frame and from any side.
class Painter {
 public:
  Painter(const RenderPlan& plan, const Loaded& loaded, PictureContent content,
          std::optional<int> vehicle)
      : plan_(plan), loaded_(loaded), content_(std::move(content)), vehicle_(vehicle) {}

  void set_frame(int id) { content_.frame = id; }
  void set_azimuth(double azimuth) { plan_.scene.azimuth = azimuth; }  ///< rad
  double azimuth() const { return plan_.scene.azimuth; }
  const RenderRecord& record() const { return record_; }

  Image draw() {
    switch (plan_.drawing) {
      case RenderPlan::Drawing::kVehicleComparison:
        return draw_vehicle_comparison();
      case RenderPlan::Drawing::kTimings:
        return draw_timings(loaded_.result, content_.title, plan_.scene);
      case RenderPlan::Drawing::kOverlay:
        return draw_frame_overlay(loaded_.result, content_.frame, plan_.overlay);
      case RenderPlan::Drawing::kBev:
        return render_bev_picture(content_, plan_.bev);
      case RenderPlan::Drawing::kMap:  // draw_map()
      case RenderPlan::Drawing::kScene:
        break;
    }
    return render_scene_picture(content_, plan_.scene, &record_);
  }

 private:
  Image draw_vehicle_comparison() const {
    std::vector<const LoadedResult*> results = {&loaded_.result};
    for (const LoadedResult& other : loaded_.others) results.push_back(&other);
    PlotStyle style = plot_style(plan_.scene);
    style.panel_height = (style.panel_height - static_cast<int>(style.text_size)) / 2;
    return draw_plots(vehicle_comparison(results, content_.frame, vehicle_), style);
  }

  RenderPlan plan_;
  const Loaded& loaded_;
  PictureContent content_;
  std::optional<int> vehicle_;
  RenderRecord record_;
};

/// All around, `count` pictures. The painter must outlive the series.
Series turntable(int count, Painter& painter) {
  const auto turned = [count](int i) { return 2.0 * M_PI * i / count; };
  Series series;
  series.count = count;
  series.picture = [&painter, turned, start = painter.azimuth()](int i) {
    painter.set_azimuth(start + turned(i));
    return painter.draw();
  };
  series.caption = [turned](int i) { return fmt::format("{:.0f} deg", turned(i) / kDegree); };
  series.number = [](int i) { return i; };
  return series;
}

/// "frame 3, 0.30 s".
std::string frame_caption(const std::optional<Scene>& scene, int id) {
  std::string text = "frame " + std::to_string(id);
  if (!scene) return text;
  for (const SceneFrame& frame : scene->frames) {
    if (frame.id == id && frame.time_s) text += fmt::format(", {:.2f} s", *frame.time_s);
  }
  return text;
}

/// A picture of each frame. The painter and the scene must outlive the series.
Series pictures_of_frames(const std::vector<int>& frames, const std::optional<Scene>& scene,
                          Painter& painter) {
  const auto id = [frames](int i) { return frames[static_cast<std::size_t>(i)]; };
  Series series;
  series.count = static_cast<int>(frames.size());
  series.picture = [&painter, id](int i) {
    painter.set_frame(id(i));
    return painter.draw();
  };
  series.caption = [&scene, id](int i) { return frame_caption(scene, id(i)); };
  series.number = id;
  return series;
}

/// Frames a second at which pictures of these frames pass as the drive did.
double drive_rate(const std::optional<Scene>& scene, const std::vector<int>& ids) {
  constexpr double kUnknown = 10.0, kFewest = 0.5, kMost = 120.0;  // Hz
  if (!scene || ids.size() < 2) return kUnknown;
  const SceneFrame* first = scene->find_frame(ids.front());
  const SceneFrame* last = scene->find_frame(ids.back());
  if (!first || !last || (!scene->frame_rate && !(first->time_s && last->time_s))) return kUnknown;
  const double rate = scene->frame_rate.value_or(kUnknown);
  const double span = time_of(*last, rate) - time_of(*first, rate);
  if (!(span > 0.0)) return kUnknown;
  return std::clamp(static_cast<double>(ids.size() - 1) / span, kFewest, kMost);
}

std::vector<fs::path> draw_series(const RenderArguments& a, const Loaded& loaded,
                                  const Progress& progress, Painter& painter, Timings& timings) {
  const LoadedResult& result = loaded.result;
  if (a.frames.empty()) {
    const double rate = a.rate > 0.0 ? a.rate : 10.0;
    return write_series(turntable(a.turntable, painter), a, rate, progress, timings);
  }
  const Series series = pictures_of_frames(frames_of(result, a.frames), result.scene, painter);
  const double rate = a.rate > 0.0 ? a.rate : drive_rate(result.scene, frames_of(result, a.frames));
  return write_series(series, a, rate, progress, timings);
}

/// One file, glTF or a report.
void write_document(const RenderArguments& a, const RenderPlan& plan, const PictureContent& content,
                    Timings& timings) {
  StageTimer compute(timings, "compute");
  const std::string file = plan.output == RenderPlan::Output::kGltf
                               ? make_glb(content, plan.scene)
                               : make_report(report_of_result(content, a.input));
  compute.stop();
  const StageTimer write(timings, "write");
  write_file_atomically(a.out, file);
}

void draw_one(const std::string& out, Painter& painter, Timings& timings) {
  StageTimer compute(timings, "compute");
  const Image picture = painter.draw();
  compute.stop();
  const StageTimer write(timings, "write");
  write_png(picture, out);
}

/// Of a surface in tiles, which is not read as a whole.
int draw_map(const Command& command, const RenderArguments& a, const RenderPlan& plan) {
  if (!has_surface_tiles(a.input)) {
    throw UsageError(a.input +
                     ": --view map: expected the folder that camber tiles join --job patches "
                     "wrote; --view bev shows other results");
  }
  protect_inputs({a.input});
  check_output_file(a.out);
  SurfaceMapOptions options;
  options.width = plan.scene.width;
  options.height = plan.scene.height;
  options.title = a.title.empty() ? fs::path(a.input).filename().string() : a.title;
  Timings timings;
  StageTimer compute(timings, "compute");
  const Image picture = render_surface_map(a.input, options);
  compute.stop();
  StageTimer write(timings, "write");
  write_png(picture, a.out);
  write.stop();
  report(command, a, plan.scene, {a.out}, {}, timings);
  return 0;
}

int run(const Command& command, const RenderArguments& a) {
  RenderPlan plan = make_render_plan(a);
  if (plan.drawing == RenderPlan::Drawing::kMap) return draw_map(command, a, plan);
  const LogSink warn = make_warning_sink(command.common);
  Timings timings;
  StageTimer load_timer(timings, "load");
  const Loaded loaded = load(a, warn);
  load_timer.stop();
  plan.scene.free_view = in_metres(plan.scene.free_view, loaded.result.cloud_report);
  const PictureContent content = content_of(a, loaded.result);
  std::vector<fs::path> written = {a.out};
  Painter painter(plan, loaded, content, a.vehicle);
  if (plan.output == RenderPlan::Output::kGltf || plan.output == RenderPlan::Output::kReport) {
    write_document(a, plan, content, timings);
  } else if (plan.series) {
    written = draw_series(a, loaded, make_progress(command.common), painter, timings);
  } else {
    draw_one(a.out, painter, timings);
  }
  warn_of_unknown_scale(a.input, is_metric(loaded.result), loaded.result.cloud_report.crs, warn);
  if (painter.record().none_in_view && warn) {
    warn(a.input + ": the view of --camera holds none of the points; eye and target are in the " +
         "coordinates that camber info shows");
  }
  report(command, a, plan.scene, written, painter.record(), timings);
  return 0;
}

}  // namespace

void register_render(App& root) {
  Command* command = add_command(
      root, "render",
      "Draws a result folder or a cloud into a PNG, without a display: the 3D scene from the "
      "paper's oblique view, from the side, through the driver's eyes or from anywhere, or the "
      "bird's-eye view with a metric grid, or the vehicles over their image. Or writes it as glTF, "
      "or as a report to read.",
      "  camber render out/steep_hill --out hill.png\n"
      "  camber render out/steep_hill --view bev --out from_above.png\n"
      "  camber render out/steep_hill --out report.html\n"
      "  camber render out/steep_hill --truth scene --color error "
      "--hide patches --out errors.png\n"
      "  camber render out/steep_hill --view overlay --show "
      "grade,ellipses --out overlay.png\n"
      "  camber render out/steep_hill --view overlay --frames all --sheet "
      "--out sheet.png\n"
      "  camber render out/joint --beside out/coplanar out/flat --out methods.png\n"
      "  camber render out/steep_hill --view oblique --turntable 120 --rate 24 --out around.mp4\n"
      "  camber render out/steep_hill --show links,normals --transparent --out graph.png\n"
      "  camber render road.ply --color sigma --size 3840x2160 --out road.png\n"
      "  camber render scan.las --camera 0,-20,15,0,30,0,0,0,1,40 --out scan.png");
  const auto arguments = std::make_shared<RenderArguments>();
  add_render_arguments(*command->app, *arguments);
  command->run = [command, arguments] { return run(*command, *arguments); };
}

}  // namespace camber::tools
