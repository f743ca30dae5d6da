// Any bytes as the messages of ROS 1 and ROS 2 that are read.

#include "camber/image/raw_pixels.h"
#include "camber/import/formats/ros_messages.h"
#include "camber/import/ros_cloud.h"
#include "read_or_refuse.h"

namespace {

void read_all(const camber::RosBytes& message) {
  read_or_refuse([&] {
    const camber::RosImage image = camber::read_ros_image(message);
    const auto pixels =
        camber::decode_raw_pixels({static_cast<int>(image.width), static_cast<int>(image.height),
                                   image.encoding, image.step, image.data, image.big_endian});
    if (pixels && (pixels->width < 1 || pixels->data.empty())) __builtin_trap();
  });
  read_or_refuse([&] { camber::read_ros_compressed_image(message); });
  read_or_refuse([&] { camber::read_ros_camera_info(message); });
  read_or_refuse([&] { camber::read_ros_fix(message); });
  read_or_refuse([&] { camber::read_ros_imu(message); });
  read_or_refuse([&] { camber::read_ros_odometry(message); });
  read_or_refuse([&] { camber::read_ros_transforms(message); });
  read_or_refuse([&] {
    const camber::RosPointCloud cloud = camber::read_ros_point_cloud(message);
    const camber::SE3 move;
    const auto source = camber::make_ros_cloud_source(message, cloud, &move);
    // A point of no bytes costs nothing, and may be there any number of times.
    if (cloud.point_step == 0 || cloud.width == 0) return;
    camber::PointBatch batch;
    std::uint64_t count = 0;
    while (source->next(batch)) count += batch.count;
    if (count != source->header().count) __builtin_trap();
  });
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  for (const bool cdr : {false, true}) read_all({data, size, "drive.bag", "message 0", cdr});
  return 0;
}
