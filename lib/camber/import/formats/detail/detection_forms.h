#pragma once

#include <string>

#include "camber/import/formats/detections.h"

namespace camber {

// The forms of read_detections() by family.

DetectionFile detections_of_json(const std::string& text, const std::filesystem::path& path);
DetectionFile detections_of_xml(const std::string& text, const std::filesystem::path& path);
/// YOLO, absolute text, MOT, KITTI.
DetectionFile detections_of_text(const std::filesystem::path& path,
                                 const DetectionOptions& options);

}  // namespace camber
