#pragma once

#include <string>
#include <vector>

#include "camber/cloud/road_cloud.h"
#include "camber/geometry/pinhole_camera.h"
#include "camber/road/road_surface.h"
#include "camber/scene/image_io.h"
#include "camber/scene/results.h"
#include "camber/scene/scene.h"

namespace camber {

/// What a picture shows. Every part but one may be absent (nullptr); all are only looked at.
struct PictureContent {
  const RoadCloud* cloud = nullptr;           ///< reference camera's frame
  const RoadSurface* surface = nullptr;       ///< the same frame
  const VehicleDocument* vehicles = nullptr;  ///< each frame's in its own camera
  const RunDocument* run = nullptr;           ///< cameras and whether the result is metric
  const PinholeCamera* camera = nullptr;      ///< for the field of view; needs run
  const SceneTruth* truth = nullptr;          ///< true boxes, drawn in red and said so
  int frame = 0;                              ///< id of the frame whose vehicles are shown
  std::string title;                          ///< heading, one line; may be empty
};

/// How a picture was made.
struct RenderRecord {
  std::string backend;   ///< "egl-surfaceless", "display"
  std::string renderer;  ///< of the driver, "llvmpipe (LLVM 15.0.6, 256 bits)"
};

enum class SceneView {
  kOblique,         ///< from behind and above, the paper's view
  kSide,            ///< from the right, without perspective: shows the grade
  kObliqueAndSide,  ///< oblique over side
};

struct ScenePictureOptions {
  int width = 1600;       ///< pixels, 64 to 8192
  int height = 900;       ///< pixels, 64 to 8192
  int supersampling = 2;  ///< rendered so many times larger and averaged, 1 to 4
  SceneView view = SceneView::kObliqueAndSide;
  double point_size = 0.0;  ///< pixels, [0, 20]; 0: from the number of points
  double azimuth = -0.85;   ///< rad, of the oblique view's direction, from ahead to the right
  double elevation = 0.42;  ///< rad, of the oblique view's eye above the content, (0, pi / 2)
  bool show_truth = true;

  void validate() const;  ///< throws std::invalid_argument naming field, value and bound
};

struct BevPictureOptions {
  int width = 1600;         ///< pixels, 64 to 8192
  int height = 900;         ///< pixels, 64 to 8192
  double point_size = 0.0;  ///< pixels, [0, 20]; 0: from the number of points
  bool show_truth = true;

  void validate() const;  ///< throws std::invalid_argument naming field, value and bound
};

/// The reconstruction in 3D, off-screen: road points coloured by height, patches, vehicles with
/// their boxes, true boxes in red, cameras with their path, a level grid, scale, colour bar. The
/// view is fitted to the bulk of the content: stray points neither shrink nor empty it.
/// Same input and Mesa version, same pixels.
/// @throws std::invalid_argument for bad options; NoAnswerError if there is nothing finite to show;
///         MachineError without a rendering back end.
Image render_scene_picture(const PictureContent& content, const ScenePictureOptions& options = {},
                           RenderRecord* record = nullptr);

/// The same from above, ahead pointing right: metric grid with axes in metres, road points coloured
/// by height, patch outlines, footprints with ids and 95 % ellipses of the position (chi-square,
/// two degrees of freedom), true footprints in red, the camera with its field of view, colour bar.
/// Needs no rendering back end. Same input, same pixels.
/// @throws std::invalid_argument for bad options; NoAnswerError if there is nothing finite to show.
Image render_bev_picture(const PictureContent& content, const BevPictureOptions& options = {});

}  // namespace camber
