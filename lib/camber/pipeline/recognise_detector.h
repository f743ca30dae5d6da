#pragma once

#include <optional>
#include <string>

#include "camber/detect/network.h"
#include "camber/detect/network_description.h"

namespace camber {

/// What an ONNX file that comes without a description is taken for.
struct RecognisedDetector {
  /// Empty: it is none of the known heads.
  std::optional<DetectorDescription> description;
  /// What it is taken for and by what, or what was found and why that is not enough.
  std::string reason;
};

/// Recognises YOLOX, YOLOv5, YOLOv8 (and 11) and FastestDet, as their own programs export them, by
/// the shapes of input and output, the number of anchors that these grids have, and the names of
/// classes that an export carries (metadata `names`); 80 classes without names are COCO's. Colours,
/// range and padding are then those of that program.
RecognisedDetector recognise_detector(const OnnxFile& file);

}  // namespace camber
