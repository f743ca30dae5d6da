#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>

#include "camber/import/import_own.h"

namespace camber {

/// A message of a bag, serialised. Not owned: it lasts for the call that hands it out.
struct BagMessage {
  const std::uint8_t* data = nullptr;
  std::size_t size = 0;
  std::int64_t recorded_ns = 0;  ///< when it was written to the bag
};

/// A bag of ROS 1. The library has no reader of its own: the program brings one that loads ROS's
/// (tools/plugins/bag_reader.h).
class BagReader {
 public:
  struct Topic {
    std::string name;  ///< "/camera/image_raw"
    std::string type;  ///< "sensor_msgs/Image"
    std::size_t messages = 0;
  };
  virtual ~BagReader() = default;
  virtual const std::vector<Topic>& topics() const = 0;  ///< in the order of their names
  /// Hands out the messages of a topic in the order of recording until `take` returns false.
  virtual void read(const std::string& topic,
                    const std::function<bool(const BagMessage&)>& take) = 0;
};

/// Which images of a bag.
struct BagChoice {
  VideoChoice frames;      ///< times since the first image; extract is of no effect: images always
                           ///< are written to image/ beside the manifest
  std::string topic;       ///< of the images; empty: the only one
  std::string info_topic;  ///< of their CameraInfo; empty: camera_info beside the images
};

/// The images of a topic (sensor_msgs/Image or CompressedImage) as a scene: frames in the order of
/// their headers' time stamps, which are their times, numbered from 0. Unless options.camera gives
/// one, the camera is that of the first CameraInfo. options.times must be empty.
/// @param file  of the bag, for messages.
/// @param manifest  as for import_video().
/// @throws InputError, UsageError.
OwnImport import_rosbag(const std::shared_ptr<BagReader>& bag, const std::filesystem::path& file,
                        const BagChoice& choice, const OwnDataOptions& options,
                        const std::filesystem::path& manifest);

}  // namespace camber
