#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "camber/detect/network.h"
#include "camber/geometry/box.h"

namespace camber {

/// A vehicle as a detector sees it.
struct DetectedVehicle {
  std::string vehicle_class;  ///< of Camber's priors
  double score = 0.0;         ///< in [0, 1]
  Box2 box;                   ///< px, pixel centres at whole numbers, inside the image
};

/// The parts of an image that a detector looks at: the whole image first, then the tiles from left
/// to right.
std::vector<ImagePart> detection_parts(int width, int height, const DetectionTiles& tiles);

/// Keeps of boxes that overlap the one with the higher score, whatever their classes: by their
/// intersection over union, and where boxes of several parts of an image meet also by the share
/// of the smaller one that lies in the other. Descending scores.
/// @param most_overlap  IoU, in (0, 1).
std::vector<DetectedVehicle> merge_detections(std::vector<DetectedVehicle> boxes,
                                              double most_overlap);

/// A network that finds vehicles, with the description of its input and output.
class Detector {
 public:
  /// Loads the network and checks that its output has the form of its head.
  /// @throws InputError; std::invalid_argument for a description that is not valid.
  Detector(const std::filesystem::path& path, const DetectorDescription& description);
  Detector(OnnxFile file, const DetectorDescription& description);

  /// The vehicles in an image of 3 channels, descending scores. The same image gives the same
  /// vehicles for any number of threads (<= 0: see resolve_num_threads).
  std::vector<DetectedVehicle> detect(const Image& image, int num_threads = 0) const;

  // What detect() is made of, for several images side by side while SingleThreadedOpenCv lives.
  std::vector<ImagePart> parts(const Image& image) const;
  std::vector<DetectedVehicle> look_at(const Image& image, const ImagePart& part) const;
  std::vector<DetectedVehicle> merge(
      const std::vector<std::vector<DetectedVehicle>>& by_part) const;

  const DetectorDescription& description() const { return description_; }
  const Network& network() const { return *network_; }

 private:
  std::string file_;
  DetectorDescription description_;
  std::unique_ptr<Network> network_;
};

}  // namespace camber
