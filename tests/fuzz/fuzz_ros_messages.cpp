// Any bytes as the messages of ROS 1 that are read.

#include "camber/image/raw_pixels.h"
#include "camber/import/formats/ros_messages.h"
#include "read_or_refuse.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const camber::RosBytes message{data, size, "drive.bag", "message 0"};
  read_or_refuse([&] {
    const camber::RosImage image = camber::read_ros_image(message);
    const auto pixels =
        camber::decode_raw_pixels({static_cast<int>(image.width), static_cast<int>(image.height),
                                   image.encoding, image.step, image.data});
    if (pixels && (pixels->width < 1 || pixels->data.empty())) __builtin_trap();
  });
  read_or_refuse([&] { camber::read_ros_compressed_image(message); });
  read_or_refuse([&] { camber::read_ros_camera_info(message); });
  return 0;
}
