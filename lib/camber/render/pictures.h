#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "camber/cloud/road_cloud.h"
#include "camber/geometry/pinhole_camera.h"
#include "camber/image/image_io.h"
#include "camber/road/road_surface.h"
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
  const SceneTruth* truth = nullptr;          ///< true boxes in red, where the result is metric
  const RoadCloud* truth_cloud = nullptr;     ///< dense ground truth, drawn in grey
  SE3 reference_from_truth_cloud;             ///< takes it to the frame of cloud and surface
  int frame = 0;                              ///< id of the frame whose vehicles are shown
  std::string title;                          ///< heading, one line; may be empty
  bool projected = false;  ///< the cloud lies on a map: its x is east, its y north
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
    kError,   ///< signed distance to the truth cloud's local plane; without one, scalar "error"
  } by = By::kHeight;
  std::string name;

  /// "height", "sigma", "patch", "image", "error", else the name of a scalar or label.
  static PointColor parse(const std::string& word);
};

/// How a picture was made.
struct RenderRecord {
  std::string backend;        ///< "egl-surfaceless", "display", "xvfb"
  std::string renderer;       ///< of the driver, "llvmpipe (LLVM 15.0.6, 256 bits)"
  bool none_in_view = false;  ///< a free view that holds none of the points
};

enum class SceneView {
  kOblique,         ///< from behind and above, the paper's view
  kSide,            ///< without perspective: shows the grade; of a map, across its longer side
  kObliqueAndSide,  ///< oblique over side
  kDriver,          ///< through the shown frame's camera
  kFree,            ///< ScenePictureOptions::free_view
};

/// A camera set by hand, frame of the cloud and the surface: true coordinates, a cloud's origin
/// included.
struct FreeView {
  Eigen::Vector3d eye = Eigen::Vector3d::Zero();  ///< m
  Eigen::Vector3d target{0.0, 0.0, 1.0};          ///< m, in the middle of the picture
  Eigen::Vector3d up{0.0, -1.0, 0.0};             ///< not along eye - target
  double field_of_view = 0.7;                     ///< rad, vertical, (0, pi)
};

/// What a 3D scene is made of, each on a switch of its own.
enum class SceneElement {
  kGrid,
  kTruthCloud,
  kPoints,
  kVehicles,
  kBoxes,
  kPlanes,
  kTruth,
  kCameras,
  kPatches,
  kNormals,
  kLinks
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
  /// Oblique view of a turntable: from every azimuth at the same distance, which keeps all in view.
  bool turning = false;
  FreeView free_view;  ///< for SceneView::kFree
  PointColor color;

  // What the scene is made of.
  bool show_points = true;
  bool show_truth_cloud = true;  ///< dense ground truth, where content has it
  bool show_patches = true;      ///< translucent polygons with their outlines
  bool show_normals = false;     ///< of the patches, at their middles
  /// The consistency graph: valid links coloured by the height step, others dashed.
  bool show_links = false;
  bool show_vehicles = true;  ///< wireframes and bodies
  bool show_boxes = true;     ///< of the estimated vehicles
  bool show_planes = true;    ///< the ground under vehicles: estimated, and true in red
  bool show_truth = true;     ///< true boxes and planes, in red
  bool show_cameras = true;   ///< frusta and path
  bool show_grid = true;      ///< level metric grid with a height axis
  bool transparent = false;   ///< the ground of the picture: 4 channels with alpha instead of white

  bool shows(SceneElement element) const;
  void validate() const;  ///< throws std::invalid_argument naming field, value and bound
};

/// One switch: how it is called on the command line and in the viewer, and the option behind it.
struct SceneSwitch {
  SceneElement element;
  const char* name;  ///< one word
  const char* text;  ///< for people
  bool ScenePictureOptions::*shown;
};

/// All switches, in the order in which they are drawn.
const std::vector<SceneSwitch>& scene_switches();

struct BevPictureOptions {
  int width = 1600;         ///< pixels, 64 to 8192
  int height = 900;         ///< pixels, 64 to 8192
  double point_size = 0.0;  ///< pixels, [0, 20]; 0: from the number of points
  PointColor color;
  bool show_points = true;
  bool show_truth_cloud = true;
  bool show_patches = true;
  bool show_links = false;
  bool show_vehicles = true;
  bool show_truth = true;
  bool show_cameras = true;    ///< the path and the field of view
  bool show_ellipses = false;  ///< of the vehicles' positions (1 sigma), and the distances' sigmas

  void validate() const;  ///< throws std::invalid_argument naming field, value and bound
};

/// The reconstruction in 3D, off-screen: road points coloured by height, patches, vehicles with
/// their boxes and the planes under them, true ones in red, dense truth in grey, cameras with their
/// path, a level grid with axes, colour bars. The
/// view is fitted to the bulk of the content: stray points neither shrink nor empty it.
/// Same input and Mesa version, same pixels.
/// @throws std::invalid_argument for bad options; NoAnswerError if there is nothing finite to show,
///         the cloud lacks what its colours should mean, or the driver's camera is not known;
///         MachineError without a rendering back end.
Image render_scene_picture(const PictureContent& content, const ScenePictureOptions& options = {},
                           RenderRecord* record = nullptr);

/// The same from above, ahead pointing right: metric grid with axes in metres, road points coloured
/// by height, patch outlines, footprints with numbers (VehicleNumbers), on request with the 1 sigma
/// ellipses of their positions, true footprints in red, the camera with its field of view, colour
/// bar.
/// Needs no rendering back end. Same input, same pixels.
/// @throws std::invalid_argument for bad options; NoAnswerError if there is nothing finite to show.
Image render_bev_picture(const PictureContent& content, const BevPictureOptions& options = {});

}  // namespace camber
