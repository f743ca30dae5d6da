#pragma once

#include <cmath>
#include <optional>
#include <string>
#include <vector>

#include "camber/render/overlay.h"
#include "camber/render/pictures.h"
#include "cloud_arguments.h"
#include "options.h"

namespace camber::tools {

/// What `render` takes, as typed.
struct RenderArguments {
  std::string input, out, scene, view = "both", color = "height", size = "1600x900", title, truth;
  std::vector<std::string> show, hide;
  double upscale = 1.0;
  std::vector<double> camera, up;
  double azimuth_deg = ScenePictureOptions().azimuth / (M_PI / 180.0);
  double elevation_deg = ScenePictureOptions().elevation / (M_PI / 180.0);
  ScenePictureOptions picture;
  std::optional<int> frame;
  int turntable = 0, sheet_columns = 0;
  std::string frames;
  std::vector<std::string> beside;
  std::optional<int> vehicle;
  double rate = 0.0;
  bool sheet = false;
  bool no_truth = false, links = false, json = false, confine = false;
  CloudArguments cloud;
};

/// `arguments` must live as long as the app.
void add_render_arguments(App& app, RenderArguments& arguments);

/// What is to be drawn, as far as the command line alone decides it.
struct RenderPlan {
  enum class Output { kPicture, kFilm, kGltf, kReport };
  enum class Drawing { kScene, kBev, kMap, kOverlay, kTimings, kVehicleComparison };
  Output output = Output::kPicture;
  Drawing drawing = Drawing::kScene;
  bool series = false;  ///< several pictures: of the frames or all around
  ScenePictureOptions scene;
  BevPictureOptions bev;
  OverlayOptions overlay;
};

/// @throws UsageError, std::invalid_argument where options contradict each other or are out of
///         their bounds.
RenderPlan make_render_plan(const RenderArguments& arguments);

}  // namespace camber::tools
