#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "camber/core/progress.h"
#include "camber/scene/scene.h"

namespace camber {

/// The camera of SYNTHIA-SF: 1920 x 1080, f = 847.630211643 px, principal point (960, 540), given
/// for images of any size of that shape.
/// @throws std::invalid_argument for sizes of another shape.
PinholeCamera synthia_sf_camera(int width, int height);

/// Class ids in the red channel of SYNTHIA-SF's GTLeft images.
enum SynthiaSfClass {
  kSynthiaVoid = 0,
  kSynthiaRoad = 1,
  kSynthiaSidewalk = 2,
  kSynthiaBuilding = 3,
  kSynthiaPole = 6,
  kSynthiaTrafficSign = 8,
  kSynthiaVegetation = 9,
  kSynthiaTerrain = 10,
  kSynthiaSky = 11,
  kSynthiaCar = 14,
  kSynthiaTruck = 15,
  kSynthiaBus = 16,
  kSynthiaRoadLines = 20,
};

struct SynthiaSfImportOptions {
  std::filesystem::path
      sequence;        ///< folder like SEQ1 with RGBLeft, and DepthLeft, GTLeft if there
  std::string frames;  ///< list as in select_frames; empty: all
  /// Boxes in KITTI's form: a tracking file, or a folder of object files; "network".
  std::filesystem::path detections;
  /// Take the true labels for the road, pavement and vehicle masks of the run, as the paper does;
  /// marked in the manifest (segmentation_source "truth").
  bool segmentation_from_labels = false;
  std::optional<double> camera_height;  ///< m above the road, > 0; none: results up to scale
  std::optional<double> height_sigma;   ///< m, > 0; none: the manifest's default
  std::optional<double> frame_rate;     ///< Hz, > 0; not in the data set
  std::optional<int> reference_frame;   ///< frame id; none: the manifest names none
  std::vector<std::string> classes = {"car", "van", "truck", "bus"};  ///< of the detections
  std::string name;                                                   ///< empty: the folder's name
  int num_threads = 0;                                                ///< see resolve_num_threads

  void validate() const;  ///< throws std::invalid_argument
};

/// A SYNTHIA-SF sequence (Hernandez-Juarez et al., "Slanted Stixels", BMVC 2017) as a scene.
///
/// Depth images (24-bit) become truth as they are. Labels, whose class is in the red channel of a
/// colour image, are written beside the manifest as one-channel images label/ID.png and become
/// truth. Frames without a depth or label image have none. Frames with both get true vehicles by a
/// fit to the depth (vehicles_from_depth.h), as SceneTruth::vehicles_source states. Where green
/// and blue number the vehicles, their ids are green + 256 blue; else vehicles are separated by
/// depth, and ids are good for one frame.
/// @param manifest path of the scene.json to write; its folder must exist.
/// @return the scene as written.
/// @throws InputError, UsageError, OutputError; then nothing new is left behind.
Scene import_synthia_sf_to(const SynthiaSfImportOptions& options,
                           const std::filesystem::path& manifest, const LogSink& warn = {});

}  // namespace camber
