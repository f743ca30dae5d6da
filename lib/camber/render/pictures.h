#pragma once

#include <Eigen/Core>
#include <optional>
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
  /// Up in the frame of cloud and surface; without: the surface's, else the cloud's.
  std::optional<Eigen::Vector3d> up;
};

/// What the colours of points mean.
struct PointColor {
  enum class By {
    kHeight,
    kSigma,   ///< the cloud's standard deviations
    kPatch,   ///< label "patch", -1 grey
    kImage,   ///< the points' own colours
    kScalar,  ///< the scalar or label called `name`
  } by = By::kHeight;
  std::string name;

  /// "height", "sigma", "patch", "image", else the name of a scalar or label.
  static PointColor parse(const std::string& word);
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
  kDriver,          ///< through the shown frame's camera
  kFree,            ///< ScenePictureOptions::free_view
};

/// A camera set by hand, frame of the cloud and the surface.
struct FreeView {
  Eigen::Vector3d eye = Eigen::Vector3d::Zero();  ///< m
  Eigen::Vector3d target{0.0, 0.0, 1.0};          ///< m, in the middle of the picture
  Eigen::Vector3d up{0.0, -1.0, 0.0};             ///< not along eye - target
  double field_of_view = 0.7;                     ///< rad, vertical, (0, pi)
};

struct ScenePictureOptions {
  int width = 1600;       ///< pixels, 64 to 8192
  int height = 900;       ///< pixels, 64 to 8192
  int supersampling = 2;  ///< rendered so many times larger and averaged, 1 to 4
  SceneView view = SceneView::kObliqueAndSide;
  double point_size = 0.0;  ///< pixels, [0, 20]; 0: from the number of points
  double azimuth =
      -49.0 *
      0.017453292519943295;  ///< rad, of the oblique view's direction, from ahead to the right
  double elevation =
      24.0 *
      0.017453292519943295;  ///< rad, of the oblique view's eye above the content, (0, pi / 2)
  FreeView free_view;        ///< for SceneView::kFree
  bool show_links = false;   ///< the consistency graph: valid links solid, others dashed
  PointColor color;
  bool show_truth = true;

  void validate() const;  ///< throws std::invalid_argument naming field, value and bound
};

struct BevPictureOptions {
  int width = 1600;         ///< pixels, 64 to 8192
  int height = 900;         ///< pixels, 64 to 8192
  double point_size = 0.0;  ///< pixels, [0, 20]; 0: from the number of points
  PointColor color;
  bool show_truth = true;

  void validate() const;  ///< throws std::invalid_argument naming field, value and bound
};

/// The reconstruction in 3D, off-screen: road points coloured by height, patches, vehicles with
/// their boxes, true boxes in red, cameras with their path, a level grid, scale, colour bar. The
/// view is fitted to the bulk of the content: stray points neither shrink nor empty it.
/// Same input and Mesa version, same pixels.
/// @throws std::invalid_argument for bad options; NoAnswerError if there is nothing finite to show,
///         the cloud lacks what its colours should mean, or the driver's camera is not known;
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
