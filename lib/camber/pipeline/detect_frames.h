#pragma once

#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "camber/core/progress.h"
#include "camber/detect/detector.h"
#include "camber/detect/segmenter.h"
#include "camber/image/frame_pixels.h"
#include "camber/pipeline/detection_cache.h"
#include "camber/pipeline/stages/load.h"
#include "camber/scene/scene.h"

namespace camber {

/// The files of the networks that a person brings; empty: none. The detector may be
/// kShippedNetwork: the one that ships.
struct NetworkFiles {
  std::filesystem::path detector, segmenter;                ///< ONNX
  std::filesystem::path detector_config, segmenter_config;  ///< empty: beside the network, .json
  bool empty() const { return detector.empty() && segmenter.empty(); }
  bool detector_ships() const;  ///< and no description of another file is given
};

/// Score of the detector that ships: of 19 boxes in photographs with as much, 17 are vehicles.
inline constexpr double kSureScore = 0.8;

struct DetectFramesOptions {
  NetworkFiles networks;
  std::filesystem::path cache;  ///< folder of DetectionCache; empty: none
  int num_threads = 0;          ///< <= 0: see resolve_num_threads
  FramePixelSource pixels;      ///< images in memory, as stages::LoadOptions has them
};

/// What was used of a network.
struct NetworkUse {
  std::string file, hash;        ///< as given; hash_file()
  std::string name;              ///< of its description
  std::string layers;            ///< Network::layers()
  int computed = 0, cached = 0;  ///< images
};

/// What the networks see in the frames of a scene.
struct NetworkView {
  std::map<int, std::vector<VehicleDetection>> vehicles;  ///< by frame id; with a detector
  std::map<int, Image> labels;  ///< as the image files are, by frame id; with a segmenter
  std::optional<NetworkUse> detector, segmenter;
  double box_sigma_px = 0.0;                ///< of the detector's boxes
  std::optional<SegmenterClasses> classes;  ///< of the segmenter: which labels may occur
};

/// Runs the networks on the images of frames. Boxes are found in the undistorted image, labels in
/// the image as the camera gave it.
/// @param frame_ids  ids of the scene that have images, else NoAnswerError.
/// @throws InputError for images, networks and side files that cannot be read.
NetworkView detect_frames(const Scene& scene, const std::vector<int>& frame_ids,
                          const DetectFramesOptions& options, const Progress& progress = {},
                          const LogSink& warn = {});

/// Whether some frame has the box of a vehicle.
bool has_boxes(const Scene& scene);
/// Whether all of these frames have an image, in a file or in memory.
bool has_images(const Scene& scene, const std::vector<int>& frame_ids,
                const FramePixelSource& pixels = {});

/// Puts what the networks see into the scene: boxes with their sigma and source in place of those
/// of the same frames (boxes of other frames are dropped: they are another detector's); the
/// meaning and source of the labels. The label images themselves are the caller's.
void put_network_view(const NetworkView& view, Scene* scene);

/// Where nothing shows vehicles (no mask is read, and the scene has no box), lets the detector that
/// ships look for them: `load->vehicle_boxes` is what it finds, else empty. Much of that is no
/// vehicle in photographs (detect/models/README.md): enough for a mask, not for results.
/// @param options  cache, threads and pixels; its networks are not used.
/// @return what was used; nothing where something shows vehicles.
/// @throws as detect_frames.
std::optional<NetworkUse> mask_vehicles(const Scene& scene, const std::vector<int>& frame_ids,
                                        DetectFramesOptions options, stages::LoadOptions* load,
                                        const Progress& progress = {});

}  // namespace camber
