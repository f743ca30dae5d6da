#pragma once

#include <filesystem>
#include <memory>
#include <string>

#include "camber/detect/network.h"

namespace camber {

/// Labels of a segmenter's images, as scene.json's segmentation_classes names them.
enum SegmentationLabel : unsigned char {
  kOtherLabel = 0,
  kRoadLabel = 1,
  kPavementLabel = 2,
  kVehicleLabel = 3
};

/// A network that shows the road.
class Segmenter {
 public:
  /// As Detector's.
  Segmenter(const std::filesystem::path& path, const SegmenterDescription& description);
  Segmenter(OnnxFile file, const SegmenterDescription& description);

  /// The label of every pixel of an image of 3 channels (one channel, SegmentationLabel). The
  /// network's values are interpolated to the image's pixels, then compared. Uses one thread:
  /// images may be segmented side by side while SingleThreadedOpenCv lives.
  Image segment(const Image& image) const;

  const SegmenterDescription& description() const { return description_; }
  const Network& network() const { return *network_; }

 private:
  std::string file_;
  SegmenterDescription description_;
  std::unique_ptr<Network> network_;
};

}  // namespace camber
