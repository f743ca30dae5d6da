// camber render: a picture of a result folder or of any cloud, without a display.

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <functional>
#include <memory>
#include <nlohmann/json.hpp>

#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "camber/core/stopwatch.h"
#include "camber/core/version.h"
#include "camber/render/contact_sheet.h"
#include "camber/render/film.h"
#include "camber/render/frame_overlay.h"
#include "camber/render/gltf.h"
#include "camber/render/loaded_result.h"
#include "camber/render/overlay.h"
#include "camber/render/pictures.h"
#include "camber/render/report.h"
#include "camber/render/result_plots.h"
#include "camber/render/vehicle_comparison.h"
#include "cloud_arguments.h"
#include "command.h"
#include "own_inputs.h"

namespace fs = std::filesystem;
using nlohmann::json;

namespace camber::tools {
namespace {

constexpr double kDegree = M_PI / 180.0;

struct Arguments {
  std::string input, out, scene, view, color = "height", size = "1600x900", title, truth;
  std::vector<std::string> show, hide;
  double upscale = 1.0;
  std::vector<double> camera, up;
  double azimuth_deg = ScenePictureOptions().azimuth / kDegree;
  double elevation_deg = ScenePictureOptions().elevation / kDegree;
  ScenePictureOptions picture;
  std::optional<int> frame;
  int turntable = 0, sheet_columns = 0;
  std::string frames;
  std::vector<std::string> beside;
  std::optional<int> vehicle;
  double rate = 0.0;
  bool sheet = false;
  bool no_truth = false, links = false, json = false;
  CloudArguments cloud;
};

void parse_size(const std::string& text, int* width, int* height) {
  char rest = 0;
  if (std::sscanf(text.c_str(), "%dx%d%c", width, height, &rest) != 2) {
    throw UsageError("--size: found '" + text + "', expected WIDTHxHEIGHT such as 1920x1080");
  }
}

SceneView view_of(const std::string& name) {
  if (name == "oblique") return SceneView::kOblique;
  if (name == "side") return SceneView::kSide;
  if (name == "driver") return SceneView::kDriver;
  return SceneView::kObliqueAndSide;
}

FreeView free_view_of(const std::vector<double>& numbers) {
  FreeView view;
  view.eye = {numbers[0], numbers[1], numbers[2]};
  view.target = {numbers[3], numbers[4], numbers[5]};
  view.up = {numbers[6], numbers[7], numbers[8]};
  view.field_of_view = numbers[9] * kDegree;
  return view;
}

struct OverlaySwitch {
  const char* name;
  bool OverlayOptions::*shown;
};
constexpr OverlaySwitch kOverlaySwitches[] = {
    {"boxes-2d", &OverlayOptions::show_boxes_2d}, {"boxes", &OverlayOptions::show_boxes_3d},
    {"planes", &OverlayOptions::show_planes},     {"labels", &OverlayOptions::show_labels},
    {"ellipses", &OverlayOptions::show_ellipses}, {"patches", &OverlayOptions::show_patches},
    {"normals", &OverlayOptions::show_normals},   {"grade", &OverlayOptions::show_grade},
    {"mask", &OverlayOptions::show_mask}};

struct BevSwitch {
  const char* name;
  bool BevPictureOptions::*shown;
};
constexpr BevSwitch kBevSwitches[] = {{"points", &BevPictureOptions::show_points},
                                      {"truth-cloud", &BevPictureOptions::show_truth_cloud},
                                      {"patches", &BevPictureOptions::show_patches},
                                      {"links", &BevPictureOptions::show_links},
                                      {"vehicles", &BevPictureOptions::show_vehicles},
                                      {"truth", &BevPictureOptions::show_truth},
                                      {"cameras", &BevPictureOptions::show_cameras}};

/// Sets the switches that --show and --hide name. @param table has `name` and `shown`.
template <typename Table, typename Options>
void switch_parts(const Table& table, const Arguments& a, const std::string& view,
                  Options* options) {
  const auto set = [&](const char* option, const std::vector<std::string>& names, bool value) {
    for (const std::string& name : names) {
      bool known = false;
      std::string all;
      for (const auto& entry : table) {
        if (name == entry.name) {
          options->*entry.shown = value;
          known = true;
        }
        all += (all.empty() ? "" : ", ") + std::string(entry.name);
      }
      if (!known) {
        throw UsageError(fmt::format("{}: found '{}', which the view {} does not have; expected {}",
                                     option, name, view, all));
      }
    }
  };
  set("--show", a.show, true);
  set("--hide", a.hide, false);
}

/// "grid, points, ...".
template <typename Table>
std::string names_of(const Table& table) {
  std::string all;
  for (const auto& entry : table) all += (all.empty() ? "" : ", ") + std::string(entry.name);
  return all;
}

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

/// A report of a result folder, with the pictures and the metrics that lie in it.
std::string make_page(const PictureContent& content, const fs::path& input) {
  ReportContent report;
  report.picture = content;
  std::error_code error;
  if (fs::is_directory(input, error)) {
    report.picture_folder = input;
    const fs::path metrics = input / "metrics.json";
    if (fs::exists(metrics, error)) {
      std::ifstream in(metrics);
      report.metrics = json::parse(in, nullptr, false);
      if (report.metrics->is_discarded()) {
        throw InputError(metrics.string(), "is no JSON, expected the metrics of a run");
      }
    }
  }
  return make_report(report);
}

int report(const Command& command, const Arguments& a, const std::vector<fs::path>& written,
           const RenderRecord& record, const Timings& timings) {
  if (a.json) {
    json out;
    out["version"] = kVersion;
    out["seed"] = command.common.seed;
    out["options"] = {{"view", a.camera.empty() ? a.view : "free"},
                      {"color", a.color},
                      {"width", a.picture.width},
                      {"height", a.picture.height},
                      {"supersampling", a.picture.supersampling},
                      {"truth", a.picture.show_truth}};
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
  return 0;
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
  return select_frames(known, list == "all" ? "" : list);
}

/// A series of pictures: to files of their own, one contact sheet or a film.
struct Series {
  int count = 1;
  std::function<Image(int)> picture;
  std::function<std::string(int)> caption;  ///< below it on a contact sheet
  std::function<int(int)> number;           ///< in its file's name
};

/// Draws all, then writes: a picture that fails leaves nothing behind.
std::vector<fs::path> write_series(const Series& series, const Arguments& a, double rate,
                                   const std::vector<fs::path>& inputs, const Progress& progress,
                                   Timings& timings) {
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
      if (!film && !sheet) refuse_own_inputs({numbered(out, series.number(i))}, inputs);
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
void read_scene_of(const Arguments& a, LoadedResult& result, const LogSink& warn) {
  std::string missing;
  if (!a.scene.empty()) {
    result.scene = read_scene(a.scene, warn);
  } else {
    missing = result.load_scene_of_run(warn);
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

int run(const Command& command, Arguments& a) {
  Timings timings;
  const std::string kind = fs::path(a.out).extension().string();
  const bool film = FilmWriter::knows(kind), series = a.turntable > 0 || !a.frames.empty();
  if (kind != ".png" && kind != ".glb" && kind != ".html" && !film) {
    throw UsageError("--out: found '" + a.out +
                     "', expected a name in .png, .glb, .html, .mp4 or .avi");
  }
  if (series && kind != ".png" && !film) {
    throw UsageError(
        "--turntable and --frames make pictures: --out must end in .png, .mp4 or .avi");
  }
  if (a.turntable > 0 && !a.frames.empty()) {
    throw UsageError("--turntable and --frames exclude each other");
  }
  if (a.frame && !a.frames.empty()) throw UsageError("--frame and --frames exclude each other");
  if ((film || a.sheet) && !series) {
    throw UsageError(std::string(film ? "a film" : "--sheet") +
                     " needs several pictures: --frames or --turntable");
  }
  if (a.rate > 0.0 && !film) {
    throw UsageError("--rate goes with a film: --out must end in .mp4 or .avi");
  }
  if (a.sheet_columns > 0 && !a.sheet) throw UsageError("--sheet-columns goes with --sheet");
  if (film && a.sheet) throw UsageError("--sheet makes one picture: --out must end in .png");
  if ((film || a.sheet) && a.picture.transparent) {
    throw UsageError("--transparent goes with single pictures only");
  }
  const bool timing = a.view == "timings", beside = !a.beside.empty();
  if (beside && (series || kind != ".png")) {
    throw UsageError("--beside makes one picture: expected a .png, without a series");
  }
  if (a.vehicle && !beside) throw UsageError("--vehicle names the one that --beside compares");
  if (timing && (series || kind != ".png")) {
    throw UsageError("--view timings is one picture: --out must end in .png, without a series");
  }
  const bool bev = a.view == "bev", overlay = a.view == "overlay";
  if (a.turntable > 0 &&
      (bev || overlay || !a.camera.empty() || a.view == "driver" || a.view == "side")) {
    throw UsageError("--turntable turns the oblique view and goes with no other");
  }
  ScenePictureOptions& options = a.picture;
  parse_size(a.size, &options.width, &options.height);
  options.view = a.turntable > 0 ? SceneView::kOblique : view_of(a.view);
  options.azimuth = a.azimuth_deg * kDegree;
  options.elevation = a.elevation_deg * kDegree;
  options.color = PointColor::parse(a.color);
  options.show_truth = !a.no_truth;
  options.show_links = a.links;
  OverlayOptions overlay_options;
  overlay_options.upscale = a.upscale;
  BevPictureOptions bev_options;
  bev_options.show_truth = options.show_truth;
  bev_options.show_links = options.show_links;
  if (bev) {
    switch_parts(kBevSwitches, a, "bev", &bev_options);
  } else if (overlay) {
    switch_parts(kOverlaySwitches, a, "overlay", &overlay_options);
    overlay_options.validate();
  } else {
    switch_parts(scene_switches(), a, a.camera.empty() ? a.view : "free", &options);
  }
  if (options.transparent && (bev || overlay || kind != ".png")) {
    throw UsageError("--transparent goes with the 3D views only");
  }
  if (!a.camera.empty()) {
    options.view = SceneView::kFree;
    options.free_view = free_view_of(a.camera);
  }
  bev_options.width = options.width;
  bev_options.height = options.height;
  bev_options.point_size = options.point_size;
  bev_options.color = options.color;
  bev ? bev_options.validate() : options.validate();

  StageTimer load(timings, "load");
  const LogSink warn = make_warning_sink(command.common);
  LoadedResult result = load_result(a.input, a.cloud.read_options());
  warn_about(a.input, result.cloud_report, warn);
  read_scene_of(a, result, warn);
  std::vector<fs::path> inputs = {a.input, a.scene, a.truth};
  inputs.insert(inputs.end(), a.beside.begin(), a.beside.end());
  if (result.scene) {
    const std::vector<fs::path> named = files_of(*result.scene);
    inputs.insert(inputs.end(), named.begin(), named.end());
  }
  refuse_own_inputs({a.out}, inputs);
  if (a.truth == "scene") {
    result.load_scene_truth_cloud(a.cloud.read_options());
  } else if (!a.truth.empty()) {
    result.truth_cloud = read_cloud_file(a.truth, a.cloud.read_options()).cloud;
  }
  std::vector<LoadedResult> others;
  for (const std::string& other : a.beside) others.push_back(load_result(other));
  if (beside && result.scene->truth && !result.scene->truth->cloud.empty() && !result.truth_cloud) {
    result.load_scene_truth_cloud(a.cloud.read_options());
  }
  load.stop();

  PictureContent content = result.content();
  if (a.frame) content.frame = *a.frame;
  if (!a.up.empty()) content.up = Eigen::Vector3d(a.up[0], a.up[1], a.up[2]);
  content.title = a.title;
  if (content.title.empty() && result.scene) content.title = result.scene->name;
  if (content.title.empty()) content.title = fs::path(a.input).filename().string();

  if (kind == ".glb" || kind == ".html") {
    std::string file;
    {
      const StageTimer compute(timings, "compute");
      file = kind == ".glb" ? make_glb(content, options) : make_page(content, a.input);
    }
    {
      const StageTimer write(timings, "write");
      write_file_atomically(a.out, file);
    }
    return report(command, a, {a.out}, {}, timings);
  }

  RenderRecord record;
  const auto draw = [&] {
    if (beside) {
      std::vector<const LoadedResult*> results = {&result};
      for (const LoadedResult& other : others) results.push_back(&other);
      PlotStyle style = plot_style(options);
      style.panel_height = (style.panel_height - static_cast<int>(style.text_size)) / 2;
      return draw_plots(vehicle_comparison(results, content.frame, a.vehicle), style);
    }
    if (timing) return draw_timings(result, content.title, options);
    if (overlay) return draw_frame_overlay(result, content.frame, overlay_options);
    if (bev) return render_bev_picture(content, bev_options);
    return render_scene_picture(content, options, &record);
  };
  if (series) {
    const std::vector<int> frames =
        a.frames.empty() ? std::vector<int>() : frames_of(result, a.frames);
    double rate = a.rate;
    if (!(rate > 0.0)) {
      rate = !frames.empty() && result.scene && result.scene->frame_rate ? *result.scene->frame_rate
                                                                         : 10.0;
    }
    const double start = options.azimuth;
    Series pictures;
    if (frames.empty()) {
      pictures.count = a.turntable;
      const auto turned = [&](int i) { return 2.0 * M_PI * i / a.turntable; };
      pictures.picture = [&, turned](int i) {
        options.azimuth = start + turned(i);
        return draw();
      };
      pictures.caption = [turned](int i) { return fmt::format("{:.0f} deg", turned(i) / kDegree); };
      pictures.number = [](int i) { return i; };
    } else {
      pictures.count = static_cast<int>(frames.size());
      pictures.picture = [&](int i) {
        content.frame = frames[static_cast<std::size_t>(i)];
        return draw();
      };
      pictures.number = [&](int i) { return frames[static_cast<std::size_t>(i)]; };
      pictures.caption = [&](int i) {
        const int id = frames[static_cast<std::size_t>(i)];
        std::string text = "frame " + std::to_string(id);
        if (!result.scene) return text;
        for (const SceneFrame& frame : result.scene->frames) {
          if (frame.id == id && frame.time_s) text += fmt::format(", {:.2f} s", *frame.time_s);
        }
        return text;
      };
    }
    return report(command, a,
                  write_series(pictures, a, rate, inputs, make_progress(command.common), timings),
                  record, timings);
  }
  Image picture;
  {
    const StageTimer compute(timings, "compute");
    picture = draw();
  }
  {
    const StageTimer write(timings, "write");
    write_png(picture, a.out);
  }
  return report(command, a, {a.out}, record, timings);
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
  auto arguments = std::make_shared<Arguments>();
  Arguments& a = *arguments;
  App& app = *command->app;
  app.add_option("input", a.input, "result folder, or a cloud of any format")->required();
  app.add_option(
         "--out", a.out,
         "file to write: .png a picture, .mp4 or .avi a film of --frames or --turntable, .glb the "
         "scene as glTF, .html a report of a result folder")
      ->required();
  a.view = "both";
  app.add_option("--view", a.view,
                 "both (oblique over side), oblique, side, driver (needs a scene), bev, overlay "
                 "(the frame's image, needs a scene), timings (of the stages of the run)")
      ->check(is_member({"both", "oblique", "side", "driver", "bev", "overlay", "timings"}))
      ->capture_default_str();
  app.add_option("--camera", a.camera,
                 "free view: eye x,y,z, target x,y,z, up x,y,z in metres of the input's frame, and "
                 "the vertical field of view in degrees")
      ->delimiter(',')
      ->expected(10)
      ->excludes("--view");
  app.add_option("--azimuth-deg", a.azimuth_deg,
                 "oblique view: direction of looking, from ahead to the right")
      ->capture_default_str();
  app.add_option("--elevation-deg", a.elevation_deg, "oblique view: height of the eye")
      ->capture_default_str();
  app.add_option("--turntable", a.turntable, "so many pictures all around, OUT_000.png, ...")
      ->check(in_range(1, 3600));
  app.add_option("--beside", a.beside,
                 "results of other methods for the same --scene: one vehicle as each places it, "
                 "from the side and from above, over the truth");
  app.add_option("--vehicle", a.vehicle,
                 "--beside: id of the true vehicle; default: where the results differ most");
  app.add_option("--frames", a.frames,
                 "a picture of each of these frames: ids as 48,49,50, 48:52, 0:10:5 or all; "
                 "OUT_048.png, ...");
  app.add_flag("--sheet", a.sheet,
               "all pictures of --frames or --turntable on one contact sheet, --out itself");
  app.add_option("--sheet-columns", a.sheet_columns, "of a contact sheet; 0: from the shapes")
      ->check(in_range(0, 1000))
      ->capture_default_str();
  app.add_option("--rate", a.rate,
                 "film: pictures a second; default: the scene's frame rate, else 10")
      ->check(in_range(0.1, 240.0));
  app.add_option("--color", a.color,
                 "of the points: height, sigma, patch, image, error (above or below the "
                 "cloud of --truth), or the name of an attribute")
      ->capture_default_str();
  app.add_option("--size", a.size, "WIDTHxHEIGHT in pixels, up to 8192 each")
      ->capture_default_str();
  app.add_option("--supersampling", a.picture.supersampling,
                 "the 3D scene is drawn so many times larger and averaged, 1 to 4")
      ->capture_default_str();
  app.add_option("--point-size", a.picture.point_size, "pixels; 0: from the number of points")
      ->capture_default_str();
  app.add_option("--show", a.show,
                 "parts to draw besides the usual ones. 3D: " + names_of(scene_switches()) +
                     "; bev: " + names_of(kBevSwitches) +
                     "; overlay: " + names_of(kOverlaySwitches))
      ->delimiter(',')
      ->type_name("LIST");
  app.add_option("--hide", a.hide, "parts to leave out, as --show")
      ->delimiter(',')
      ->type_name("LIST");
  app.add_flag("--links", a.links,
               "draw the consistency graph of the patches: links coloured by their height step, "
               "those not used dashed");
  app.add_flag("--transparent", a.picture.transparent,
               "3D views: a picture with an alpha channel instead of a white ground");
  app.add_option("--upscale", a.upscale, "overlay: the image is enlarged so many times")
      ->capture_default_str();
  app.add_option("--scene", a.scene,
                 "manifest of the run: adds the camera and the truth, in red; default: the one "
                 "that the run read, if it is still there");
  app.add_option("--truth", a.truth,
                 "dense ground truth to draw, in grey: a cloud in the input's frame, or the word "
                 "scene for that of --scene");
  app.add_flag("--no-truth", a.no_truth, "leave out the truth of --scene");
  app.add_option("--frame", a.frame, "frame id whose vehicles are shown; default: the reference");
  app.add_option("--up", a.up, "x,y,z: up in the input's frame")->delimiter(',')->expected(3);
  app.add_option("--title", a.title, "heading; default: the scene's or the input's name");
  app.add_flag("--json", a.json, "print what was done as JSON to stdout");
  add_cloud_arguments(app, a.cloud);
  command->run = [command, arguments] { return run(*command, *arguments); };
}

}  // namespace camber::tools
