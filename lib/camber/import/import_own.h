#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "camber/core/progress.h"
#include "camber/import/formats/class_map.h"
#include "camber/import/formats/trajectory.h"
#include "camber/scene/scene.h"

namespace camber {

/// The camera of a person's own images: a calibration file, or numbers.
struct OwnCamera {
  std::filesystem::path calibration;  ///< import/formats/calibration.h
  std::string name;        ///< of the camera in that file, or its index; empty: the only one
  bool rectified = false;  ///< the images were rectified: the file's projection matrix holds
  std::optional<double> fx, fy, cx, cy;  ///< px; fy default fx, centre default the image's middle
  std::optional<double> fov_deg;         ///< horizontal field of view, in (0, 180)
  std::optional<double> fov_sigma_deg;   ///< its standard deviation, > 0; none: kFovSigmaDeg
  /// Where nothing of the above is given: the camera is kGuessedFovDeg; else that is an error.
  bool guess = false;
};

// How well a camera is known that a person states: what the manifest gets (Scene::camera_sigma,
// Scene::height_sigma) unless another is given.
inline constexpr double kFovSigmaDeg = 5.0;             ///< "about 70 degrees"
inline constexpr double kTypedFocalSigma = 0.01;        ///< relative, of a focal length in pixels
inline constexpr double kCalibratedFocalSigma = 0.003;  ///< relative, of a calibration file
inline constexpr double kTypedHeightSigma = 0.03;       ///< m
/// A camera of which nothing is known: two standard deviations of the focal length's logarithm
/// reach from 35 to 115 degrees, which holds telephones, dash cameras and the cameras of public
/// drives.
inline constexpr double kGuessedFovDeg = 70.0;
inline constexpr double kGuessedFocalSigma = 0.4;

/// When the images were taken; at most one of them.
struct OwnTimes {
  std::optional<double> rate;  ///< frames a second, > 0
  std::filesystem::path list;  ///< read_frame_times()
  bool from_names = false;     ///< time_from_name()
};

/// Boxes of another program; import/formats/detections.h.
struct OwnDetections {
  std::filesystem::path file;         ///< or folder; empty: none
  std::filesystem::path class_names;  ///< of class numbers; empty: as the files have them
  std::vector<std::string> classes = {"car", "van", "truck", "bus"};  ///< that count, in any case
  std::string default_class = "car";  ///< of boxes in files without classes
  double least_score = 0.0;           ///< boxes with a lower one are left out
  std::string source = "import";      ///< the manifest's detections_source
};

/// A place on a map: m, and the direction of true north there, rad counterclockwise from the map's.
struct MapPlace {
  double east = 0.0, north = 0.0;
  double convergence = 0.0;
};

/// Places on the map of a coordinate system. @throws UsageError for one that is no projected system
/// in metres.
using MapProjection = std::function<std::vector<MapPlace>(const std::string& crs,
                                                          const std::vector<GeoPoint>& points)>;

/// Positions on the earth; empty: none.
struct GnssOptions {
  std::filesystem::path file;    ///< read_geo_log(), or KITTI's oxts
  std::vector<GeoPoint> points;  ///< where there is no file; `form` is what they are of
  std::string form;
  std::string offset;             ///< s, added to the log's times; "first": its start is frame 0
  double sigma = 2.5;             ///< m, > 0, east and north each, where the file states none
  double heading_sigma = 0.0175;  ///< rad, > 0, of headings (oxts), the camera's mounting included
  Eigen::Vector3d antenna = Eigen::Vector3d::Zero();  ///< m, of the receiver, camera frame
  std::string crs;                                    ///< EPSG:n or a definition; empty: UTM
  MapProjection projection;
};

/// What was recorded with a film; film_telemetry.h.
struct TelemetryOptions {
  bool use = true;
  /// s: on the film's clock, added to its times; a log of the world's time: when its first position
  /// was, since the film's first frame.
  std::optional<double> offset;
};

/// What a person has beside the images; empty: not given.
struct OwnDataOptions {
  OwnCamera camera;
  OwnTimes times;
  OwnDetections detections;
  std::filesystem::path masks;  ///< folder of label images, colours, or binary road masks
  std::string class_map;        ///< name as in named_class_map(), "binary", or a file
  std::filesystem::path poses;  ///< import/formats/trajectory.h; of the camera
  double pose_scale = 1.0;      ///< metres per unit of the poses, > 0
  std::filesystem::path speed;  ///< read_speeds(), or KITTI's oxts
  std::string speed_offset;     ///< s, added to the log's times; "first": its start is frame 0
  std::filesystem::path up;     ///< read_attitudes(), or KITTI's oxts
  double up_sigma = 0.0175;     ///< rad, > 0; a degree: the camera's mounting on the vehicle
  GnssOptions gnss;
  TelemetryOptions telemetry;          ///< of films
  std::optional<double> height;        ///< m, camera above the road, > 0
  std::optional<double> height_sigma;  ///< m, > 0; none: kTypedHeightSigma
  std::string frames;                  ///< list as in select_frames; empty: all
  std::optional<int> reference_frame;
  std::string name;  ///< of the scene; empty: by the images

  void validate() const;  ///< throws std::invalid_argument
};

/// Takes the bytes of a file and the name that it is to have.
using ImageSink = std::function<void(const std::filesystem::path&, const std::string&)>;

/// A scene as imported, and what a person should know of it.
struct OwnImport {
  Scene scene;
  bool camera_guessed = false;  ///< nothing was given of it: OwnCamera::guess
  /// Ids of frames are places in a whole recording, of which the frames may be a part.
  bool ids_of_recording = false;
  std::vector<std::string> found;    ///< a phrase each: order, calibration, boxes, ...
  std::vector<std::string> missing;  ///< a phrase each: what is not there, and what that costs
  std::string telemetry;  ///< of a film: one of `found`, what was recorded with it; empty: nothing
  /// Masks in colours, by frame id: written as labels beside the manifest.
  std::vector<std::pair<int, std::filesystem::path>> conversions;
  ClassMap mask_classes;
  /// Frames of a video to be written as PNG files: from "drive.mp4#120", ascending, to a file.
  std::vector<std::pair<std::filesystem::path, std::filesystem::path>> extractions;
  /// Where images are no files yet: hands out those of all frames, for image/ beside the manifest.
  std::function<void(const ImageSink&)> write_images;
};

/// Writes the converted masks to segmentation/ and the frames that are no files yet to image/
/// beside the manifest, and the manifest; all or nothing.
/// @throws InputError for masks of other colours or sizes; OutputError, also where it would replace
///         a manifest or a picture that no import wrote.
void write_own_import(OwnImport& import, const std::filesystem::path& manifest);

/// The camera of the scene's image files: the lens's where there is one.
const PinholeCamera& file_camera(const Scene& scene);

/// The last step of an import of images of a lens: the scene's camera becomes a pinhole camera that
/// loses no row of road, and boxes and keypoints, given in the files' pixels, are carried over.
void take_out_lens(Scene& scene, OwnImport& out);

/// What a scene lacks, a phrase each with what it costs and the option that would give it.
std::vector<std::string> missing_in(const Scene& scene);

/// Images as a scene: one frame each in natural order. Frames are numbered as their files are where
/// all are named by different numbers, else from 0.
/// @param places  folders, glob patterns and files.
/// @throws InputError, UsageError.
OwnImport import_images(const std::vector<std::string>& places, const OwnDataOptions& options,
                        const LogSink& warn = {});

/// A model of COLMAP as a scene: its images, their camera with its lens, and, where the metres per
/// unit of the model are given, its poses.
/// @param model   folder with cameras, images and points3D, .bin or .txt.
/// @param images  folder that the names of the model's images are relative to.
/// @param metres_per_unit  > 0; none: a model is up to scale, and poses are left out.
/// @throws InputError also for images of several cameras, unless options.camera.name chooses one.
OwnImport import_colmap(const std::filesystem::path& model, const std::filesystem::path& images,
                        std::optional<double> metres_per_unit, const OwnDataOptions& options);

/// Which frames of a video, and how they are kept.
struct VideoChoice {
  int every = 1;               ///< >= 1: each n-th frame
  std::optional<double> from;  ///< s since the first frame; none: from the start
  std::optional<double> to;    ///< s, inclusive; none: to the end
  bool extract = false;        ///< written as PNG files to image/ beside the manifest

  void validate() const;  ///< throws std::invalid_argument
};

/// A video as a scene: every frame is decoded once for its time; ids are the frames' numbers in the
/// video. options.times must be empty: a video has its own.
/// @param manifest  where the scene will be written; extracted frames go to image/ beside it, by
///                  write_own_import().
OwnImport import_video(const std::filesystem::path& video, const VideoChoice& choice,
                       const OwnDataOptions& options, const std::filesystem::path& manifest);

}  // namespace camber
