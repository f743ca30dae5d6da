#pragma once

#include <filesystem>

#include "camber/core/progress.h"
#include "camber/detect/network_description.h"

namespace camber {

/// The side file of a network: `given`, or where that is empty the network's own name with .json.
std::filesystem::path side_file_of(const std::filesystem::path& network,
                                   const std::filesystem::path& given);

/// Reads the description of a detector, a segmenter or a keypoint network (docs/formats.md, format
/// "camber-network").
/// @param warn  receives a sentence for each unknown key; may be empty.
/// @throws InputError "file: JSON path: found, expected"; for a file that is not there the message
///         names what it is for.
DetectorDescription read_detector_description(const std::filesystem::path& path,
                                              const LogSink& warn = {});
SegmenterDescription read_segmenter_description(const std::filesystem::path& path,
                                                const LogSink& warn = {});

KeypointsDescription read_keypoints_description(const std::filesystem::path& path,
                                                const LogSink& warn = {});
/// The same of a text. @param name  for messages.
DetectorDescription parse_detector_description(const std::string& text, const std::string& name);
KeypointsDescription parse_keypoints_description(const std::string& text, const std::string& name);

}  // namespace camber
