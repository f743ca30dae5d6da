#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "camber/core/progress.h"
#include "camber/geometry/camera_sigma.h"
#include "camber/geometry/lens_distortion.h"
#include "camber/geometry/pinhole_camera.h"
#include "camber/geometry/plane.h"
#include "camber/geometry/se3.h"
#include "camber/vehicle/vehicle_estimate.h"

namespace camber {

/// The reader refuses more detections in a frame: vehicles hide each other long before.
inline constexpr std::size_t kMostVehiclesPerFrame = 2000;

/// Where a GNSS receiver's antenna was when an image was taken, on the map of Scene::map_crs.
struct MapPosition {
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  ///< m: east, north, height (NaN: not known)
  double sigma = 2.5;                                  ///< m, standard deviation of east and north
  double height_sigma = 3.75;                          ///< m
  /// rad, of the camera's view, counterclockwise from the map's east.
  std::optional<double> heading;
  double heading_sigma = 0.0175;  ///< rad
};

/// One image of a scene with what is known about it. Paths are absolute or relative to the working
/// folder (the reader has resolved them against the manifest); empty: not given. An image may be a
/// frame of a video, "drive.mp4#120" (image/video.h).
struct SceneFrame {
  int id = 0;
  std::optional<double> time_s;
  std::filesystem::path image;
  std::filesystem::path segmentation;    ///< 8-bit label image
  std::filesystem::path road_mask;       ///< non-zero is road
  std::optional<Plane> ego_plane;        ///< given, camera frame
  std::optional<SE3> world_from_camera;  ///< known pose
  std::optional<Eigen::Vector3d> up;     ///< gravity's up, unit, camera frame
  double up_sigma = 0.0035;              ///< rad, standard deviation about each axis; 0.2 degrees
  std::optional<double> speed;           ///< m/s, of the camera, >= 0
  double speed_sigma = 0.0;              ///< m/s, > 0 where there is a speed
  std::optional<MapPosition> map_position;
  std::vector<VehicleDetection> vehicles;
};

/// When a frame's image was taken, s: its own time, else its id at a frame rate (Hz).
double time_of(const SceneFrame& frame, double frame_rate);

/// Truth of one vehicle; read by evaluation only.
struct TruthVehicle {
  int id = 0;
  std::string vehicle_class = "car";
  Box2 box;
  OrientedBox pose;                        ///< camera frame of its image, m
  std::optional<Plane> plane;              ///< ground under it, camera frame
  std::vector<Eigen::Vector3d> keypoints;  ///< 36 or none, camera frame, m
  bool moving = false;
  double occlusion = 0.0;   ///< share in [0, 1]
  double truncation = 0.0;  ///< share in [0, 1]
  /// Why the box is not to be relied on ("one_side", "occluded", ...: vehicles_from_depth.h);
  /// empty: it is. Evaluation does not count such vehicles.
  std::string uncertain;
};

struct TruthFrame {
  int id = 0;
  std::optional<SE3> world_from_camera;
  std::optional<Plane> ego_plane;
  std::filesystem::path depth;
  std::string depth_encoding;  ///< "kitti" or "synthia"
  std::filesystem::path label;
  std::vector<TruthVehicle> vehicles;
};

/// Ground truth; no estimate may touch it.
struct SceneTruth {
  std::vector<TruthFrame> frames;
  /// "depth_fit" where the vehicles were fitted to depth and labels; empty: as the data set has
  /// them.
  std::string vehicles_source;
  std::filesystem::path cloud;
  std::optional<int> cloud_frame;  ///< frame id in whose camera the cloud is
};

/// The standard deviation of a speed that states none: 2 %, at least 0.1 m/s.
double default_speed_sigma(double speed);

/// A scene manifest (scene.json, format "camber-scene", version 1).
struct Scene {
  std::string name;
  PinholeCamera camera;
  CameraSigma camera_sigma;                 ///< how well `camera` and `distortion` are known
  LensDistortion distortion;                ///< of the image files; model kNone: none is given
  std::optional<double> height_above_road;  ///< m; none: results are up to scale
  double height_sigma = 0.01;               ///< m, standard deviation of height_above_road, > 0
  std::optional<double> frame_rate;         ///< Hz
  std::optional<int> reference_frame;       ///< frame id
  std::string detections_source;            ///< "network", "truth_boxes", ..., or empty
  /// Standard deviation of the sides of all frames' boxes, px; none: BoxNoise's.
  std::optional<double> box_sigma_px;
  std::map<std::string, std::vector<int>> segmentation_classes;  ///< "road" -> label values
  std::string segmentation_source;           ///< "network", "truth", ..., or empty
  std::map<std::string, double> markings_m;  ///< "dash_length" -> m
  /// Coordinate system of the map positions: EPSG:n or a definition, projected, metres; or empty.
  std::string map_crs;
  Eigen::Vector3d antenna = Eigen::Vector3d::Zero();  ///< m, of the receiver, camera frame
  std::vector<SceneFrame> frames;                     ///< ids strictly ascending
  std::optional<SceneTruth> truth;

  /// Not found: nullptr.
  const SceneFrame* find_frame(int id) const;
};

/// Where the files that a manifest names may lie.
enum class ScenePaths {
  kAnywhere,
  kConfined,  ///< in the manifest's folder or below, links followed
};

/// Reads and validates a manifest; images are not opened.
/// @param path  the manifest or a folder that holds a scene.json.
/// @param warn  receives a sentence for each unknown key; may be empty.
/// @throws InputError "file: JSON path: what was found, what was expected".
Scene read_scene(const std::filesystem::path& path, const LogSink& warn = {},
                 ScenePaths paths = ScenePaths::kAnywhere);

/// Writes a manifest with paths relative to its folder. Atomic. @throws OutputError.
void write_scene(const Scene& scene, const std::filesystem::path& path);

/// Resolves a --frames list ("48,49,50", "48:52", "0:10:5"; both ends included) to frame ids of
/// the scene, ascending; an empty list and "all" mean all frames.
/// @throws UsageError for bad syntax or an id that is not in the scene.
std::vector<int> select_frames(const Scene& scene, const std::string& list);

/// The reference frame of a selection: the manifest's if it is among the ids, else the one at index
/// n / 2 rounded down. @param ids not empty.
int choose_reference_frame(const Scene& scene, const std::vector<int>& ids);

}  // namespace camber
