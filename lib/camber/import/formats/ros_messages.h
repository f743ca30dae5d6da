#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

#include "camber/import/formats/calibration.h"

namespace camber {

// Messages of ROS 1 as they are serialised: little-endian, every length checked against the bytes
// that are there. `where` ("drive.bag", "message 3 of /cam") names the message in errors.

/// The bytes of a message, and what names it. Not owned.
struct RosBytes {
  const std::uint8_t* data = nullptr;
  std::size_t size = 0;
  std::string file, position;
};

/// std_msgs/Header. 0 where the driver sets no time.
struct RosStamp {
  std::int64_t ns = 0;
};

/// sensor_msgs/Image; the pixels stay where the message is.
struct RosImage {
  RosStamp stamp;
  std::uint32_t width = 0, height = 0;  ///< pixels, 1 to 16384
  std::string encoding;                 ///< "mono8", "bgr8", "bayer_rggb8", ...
  std::uint32_t step = 0;               ///< bytes a row
  const std::uint8_t* data = nullptr;   ///< height * step
  std::size_t size = 0;
};

/// sensor_msgs/CompressedImage.
struct RosCompressedImage {
  RosStamp stamp;
  std::string format;                  ///< as the message states it: "bgr8; jpeg compressed bgr8"
  const std::uint8_t* data = nullptr;  ///< of a PNG or JPEG file, if it is one
  std::size_t size = 0;
};

// @throws InputError (file: position: found, expected) for bytes that cannot be such a message.
RosImage read_ros_image(const RosBytes& message);
RosCompressedImage read_ros_compressed_image(const RosBytes& message);

/// sensor_msgs/CameraInfo as a calibration. @throws InputError also for images that the driver
/// binned or cut out, whose calibration would have to be changed, and for a camera that is not
/// calibrated (focal lengths of 0).
CameraCalibration read_ros_camera_info(const RosBytes& message);

}  // namespace camber
