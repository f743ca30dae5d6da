#include "render_arguments.h"

#include <fmt/format.h>

#include <cmath>
#include <cstdio>
#include <filesystem>

#include "camber/core/errors.h"
#include "camber/render/film.h"
#include "camber/render/picture_switches.h"
#include "own_inputs.h"

namespace camber::tools {
namespace {

constexpr double kDegree = M_PI / 180.0;

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

/// @throws UsageError
FreeView free_view_of(const std::vector<double>& numbers) {
  constexpr double kNarrowest = 1.0, kWidest = 177.0;  // degrees
  if (!(numbers[9] >= kNarrowest && numbers[9] <= kWidest)) {
    throw UsageError(fmt::format("--camera: found a field of view of {} degrees, expected {} to {}",
                                 numbers[9], kNarrowest, kWidest));
  }
  FreeView view;
  view.eye = {numbers[0], numbers[1], numbers[2]};
  view.target = {numbers[3], numbers[4], numbers[5]};
  view.up = {numbers[6], numbers[7], numbers[8]};
  view.field_of_view = numbers[9] * kDegree;
  return view;
}

/// Sets the switches that --show and --hide name. @throws UsageError
template <typename Table, typename Options>
void set_parts(const Table& table, const RenderArguments& a, const std::string& view,
               Options* options) {
  try {
    switch_parts(table, a.show, a.hide, view, options);
  } catch (const std::invalid_argument& error) {
    throw UsageError(std::string("--") + error.what());
  }
}

/// Whether a file can hold what is wanted of it.
void check_output(const RenderArguments& a, RenderPlan::Output output, bool series) {
  const bool film = output == RenderPlan::Output::kFilm;
  if (series && output != RenderPlan::Output::kPicture && !film) {
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
}

/// Whether a view goes with the output and the series.
void check_view(const RenderArguments& a, RenderPlan::Output output, bool series) {
  const bool one_picture = output == RenderPlan::Output::kPicture && !series;
  const bool beside = !a.beside.empty();
  if (beside && !one_picture) {
    throw UsageError("--beside makes one picture: expected a .png, without a series");
  }
  if (a.vehicle && !beside) throw UsageError("--vehicle names the one that --beside compares");
  if ((a.view == "timings" || a.view == "map") && !one_picture) {
    throw UsageError("--view " + a.view +
                     " is one picture: --out must end in .png, without a series");
  }
  const bool oblique = a.camera.empty() && (a.view == "both" || a.view == "oblique");
  if (a.turntable > 0 && !oblique) {
    throw UsageError("--turntable turns the oblique view and goes with no other");
  }
}

RenderPlan::Output output_of(const std::string& path) {
  const std::string kind = std::filesystem::path(path).extension().string();
  if (kind == ".png") return RenderPlan::Output::kPicture;
  if (kind == ".glb") return RenderPlan::Output::kGltf;
  if (kind == ".html") return RenderPlan::Output::kReport;
  if (FilmWriter::knows(kind)) return RenderPlan::Output::kFilm;
  throw UsageError("--out: found '" + path +
                   "', expected a name in .png, .glb, .html, .mp4 or .avi");
}

RenderPlan::Drawing drawing_of(const RenderArguments& a) {
  if (!a.beside.empty()) return RenderPlan::Drawing::kVehicleComparison;
  if (a.view == "timings") return RenderPlan::Drawing::kTimings;
  if (a.view == "overlay") return RenderPlan::Drawing::kOverlay;
  if (a.view == "bev") return RenderPlan::Drawing::kBev;
  if (a.view == "map") return RenderPlan::Drawing::kMap;
  return RenderPlan::Drawing::kScene;
}

/// Size, view and colours, which the drawings share as far as they know them.
void set_picture(const RenderArguments& a, RenderPlan* plan) {
  ScenePictureOptions& scene = plan->scene;
  scene = a.picture;
  parse_size(a.size, &scene.width, &scene.height);
  scene.view = a.turntable > 0 ? SceneView::kOblique : view_of(a.view);
  scene.turning = a.turntable > 0;
  scene.azimuth = a.azimuth_deg * kDegree;
  scene.elevation = a.elevation_deg * kDegree;
  scene.color = PointColor::parse(a.color);
  scene.show_truth = !a.no_truth;
  scene.show_links = a.links;
  plan->overlay.upscale = a.upscale;
  plan->bev.show_truth = scene.show_truth;
  plan->bev.show_links = scene.show_links;
  plan->bev.width = scene.width;
  plan->bev.height = scene.height;
  plan->bev.point_size = scene.point_size;
  plan->bev.color = scene.color;
}

/// --input, --out and the views.
void add_view_arguments(App& app, RenderArguments& a) {
  app.add_option("input", a.input, "result folder, a cloud of any format, or a vehicles.json")
      ->required();
  app.add_option(
         "--out", a.out,
         "file to write: .png a picture, .mp4 or .avi a film of --frames or --turntable, .glb the "
         "scene as glTF, .html a report of a result folder")
      ->output_file()
      ->required();
  app.add_option("--view", a.view,
                 "both (oblique over side), oblique, side, driver (needs a scene), bev, map (of "
                 "the joined patches of camber tiles, read by tile), overlay "
                 "(the frame's image, needs a scene), timings (of the stages of the run)")
      ->check(is_member({"both", "oblique", "side", "driver", "bev", "map", "overlay", "timings"}))
      ->capture_default_str();
  app.add_option("--camera", a.camera,
                 "free view: eye x,y,z and target x,y,z in the input's coordinates (as camber info "
                 "shows them), up x,y,z, and the vertical field of view in degrees")
      ->delimiter(',')
      ->expected(10)
      ->excludes("--view");
  app.add_option("--azimuth-deg", a.azimuth_deg,
                 "oblique view: direction of looking, from ahead to the right")
      ->check(in_range(-360.0, 360.0))
      ->capture_default_str();
  app.add_option("--elevation-deg", a.elevation_deg, "oblique view: height of the eye")
      ->check(in_range(0.6, 88.8))
      ->capture_default_str();
}

/// Several pictures, or one that compares several results.
void add_series_arguments(App& app, RenderArguments& a) {
  app.add_option("--turntable", a.turntable, "so many pictures all around, OUT_000.png, ...")
      ->check(in_range(1, 3600));
  app.add_option(
      "--beside", a.beside,
      "results of other methods for the same --scene, folders or vehicles.json: one vehicle as "
      "each places it, "
      "from the side and from above, over the truth");
  app.add_option("--vehicle", a.vehicle,
                 "--beside: id of the true vehicle; default: where the results differ most");
  app.add_option("--frames", a.frames,
                 "a picture of each of these frames: ids as 48,49,50, 48:52, 0:10:5 or all; "
                 "OUT_048.png, ...")
      ->no_name();
  app.add_flag("--sheet", a.sheet,
               "all pictures of --frames or --turntable on one contact sheet, --out itself");
  app.add_option("--sheet-columns", a.sheet_columns, "of a contact sheet; 0: from the shapes")
      ->check(in_range(0, 1000))
      ->capture_default_str();
  app.add_option("--rate", a.rate,
                 "film: pictures a second; default: the scene's frame rate, else 10")
      ->check(in_range(0.1, 240.0));
}

/// How a picture looks.
void add_look_arguments(App& app, RenderArguments& a) {
  app.add_option("--color", a.color,
                 "of the points: height, sigma, patch, image, error (above or below the "
                 "cloud of --truth), or the name of an attribute")
      ->no_name()
      ->capture_default_str();
  app.add_option("--size", a.size, "WIDTHxHEIGHT in pixels, up to 8192 each")
      ->no_name()
      ->capture_default_str();
  app.add_option("--supersampling", a.picture.supersampling,
                 "the 3D scene is drawn so many times larger and averaged, 1 to 4")
      ->capture_default_str();
  app.add_option("--point-size", a.picture.point_size, "pixels; 0: from the number of points")
      ->capture_default_str();
  app.add_option("--show", a.show,
                 "parts to draw besides the usual ones. 3D: " + names_of_parts(scene_switches()) +
                     "; bev: " + names_of_parts(bev_switches()) +
                     "; overlay: " + names_of_parts(overlay_switches()))
      ->no_name()
      ->delimiter(',')
      ->type_name("LIST");
  app.add_option("--hide", a.hide, "parts to leave out, as --show")
      ->no_name()
      ->delimiter(',')
      ->type_name("LIST");
  app.add_flag("--links", a.links,
               "draw the consistency graph of the patches: links coloured by their height step, "
               "those not used dashed");
  app.add_flag("--transparent", a.picture.transparent,
               "3D views: a picture with an alpha channel instead of a white ground");
  app.add_option("--upscale", a.upscale, "overlay: the image is enlarged so many times")
      ->capture_default_str();
}

/// What is read beside the input.
void add_content_arguments(App& app, RenderArguments& a) {
  app.add_option("--scene", a.scene,
                 "manifest of the run: adds the camera and the truth, in red; default: the one "
                 "that the run read, if it is still there");
  add_confine_option(app, a.confine);
  app.add_option("--truth", a.truth,
                 "dense ground truth to draw, in grey: a cloud in the input's frame, or the word "
                 "scene for that of --scene");
  app.add_flag("--no-truth", a.no_truth, "leave out the truth of --scene");
  app.add_option("--frame", a.frame, "frame id whose vehicles are shown; default: the reference");
  app.add_option("--up", a.up, "x,y,z: up in the input's frame")->delimiter(',')->expected(3);
  app.add_option("--title", a.title, "heading; default: the scene's or the input's name")
      ->no_name();
}

}  // namespace

void add_render_arguments(App& app, RenderArguments& arguments) {
  add_view_arguments(app, arguments);
  add_series_arguments(app, arguments);
  add_look_arguments(app, arguments);
  add_content_arguments(app, arguments);
  app.add_flag("--json", arguments.json, "print what was done as JSON to stdout");
  add_cloud_arguments(app, arguments.cloud);
}

RenderPlan make_render_plan(const RenderArguments& a) {
  RenderPlan plan;
  plan.output = output_of(a.out);
  plan.series = a.turntable > 0 || !a.frames.empty();
  check_output(a, plan.output, plan.series);
  check_view(a, plan.output, plan.series);
  plan.drawing = drawing_of(a);
  set_picture(a, &plan);
  const bool bev = a.view == "bev", overlay = a.view == "overlay";
  if (bev) {
    set_parts(bev_switches(), a, "bev", &plan.bev);
  } else if (overlay) {
    set_parts(overlay_switches(), a, "overlay", &plan.overlay);
    plan.overlay.validate();
  } else {
    set_parts(scene_switches(), a, a.camera.empty() ? a.view : "free", &plan.scene);
  }
  if (plan.scene.transparent && (bev || overlay || plan.output != RenderPlan::Output::kPicture)) {
    throw UsageError("--transparent goes with the 3D views only");
  }
  if (!a.camera.empty()) {
    plan.scene.view = SceneView::kFree;
    plan.scene.free_view = free_view_of(a.camera);
  }
  bev ? plan.bev.validate() : plan.scene.validate();
  return plan;
}

}  // namespace camber::tools
