#pragma once

#include <memory>
#include <string>

#include "camber/import/bag.h"
#include "camber/import/import_own.h"

namespace camber {

/// Which images of a bag.
struct BagChoice {
  VideoChoice frames;      ///< times since the first image; extract is of no effect: images always
                           ///< are written to image/ beside the manifest
  std::string topic;       ///< of the images; empty: the only one
  std::string info_topic;  ///< of their CameraInfo; empty: camera_info beside the images
  /// Of positions (NavSatFix), gravity (Imu) and speeds (Odometry); empty: the only one, where
  /// options have no file of them; "none": left out.
  std::string fix_topic, imu_topic, odometry_topic;
};

/// The images of a topic (sensor_msgs/Image or CompressedImage) as a scene: frames in the order of
/// their headers' time stamps, which are their times, numbered from 0. Unless options.camera gives
/// one, the camera is that of the first CameraInfo. options.times must be empty. Positions,
/// gravity, speeds and, above base_footprint, the camera's height come from the recording, too.
/// @param file  of the bag, for messages.
/// @param manifest  as for import_video().
/// @throws InputError, UsageError.
OwnImport import_rosbag(const std::shared_ptr<BagReader>& bag, const std::filesystem::path& file,
                        const BagChoice& choice, const OwnDataOptions& options,
                        const std::filesystem::path& manifest);

}  // namespace camber
