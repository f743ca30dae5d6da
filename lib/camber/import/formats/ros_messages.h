#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "camber/geometry/se3.h"
#include "camber/import/formats/calibration.h"

namespace camber {

// Messages of ROS as they are serialised, every length checked against the bytes that are there:
// those of ROS 1 little-endian and packed; those of ROS 2 in the Common Data Representation (OMG
// formal/02-06-51, and XCDR2 of DDS-XTypes 1.3), values aligned to their size, in either byte
// order. `where` ("drive.bag", "message 3 of /cam") names the message in errors.

/// The bytes of a message, and what names it. Not owned.
struct RosBytes {
  const std::uint8_t* data = nullptr;
  std::size_t size = 0;
  std::string file, position;
  bool cdr = false;  ///< of ROS 2
};

/// std_msgs/Header. 0 where the driver sets no time.
struct RosStamp {
  std::int64_t ns = 0;
  std::string frame;  ///< "camera_optical"; may be empty
};

/// sensor_msgs/Image; the pixels stay where the message is.
struct RosImage {
  RosStamp stamp;
  std::uint32_t width = 0, height = 0;  ///< pixels, 1 to 16384
  std::string encoding;                 ///< "mono8", "bgr8", "bayer_rggb8", ...
  bool big_endian = false;              ///< of channels of 16 bits
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

/// sensor_msgs/NavSatFix.
struct RosFix {
  RosStamp stamp;
  int status = -1;  ///< -1 no fix, 0 fix, 1 satellite-based, 2 ground-based augmentation
  double latitude = 0.0, longitude = 0.0;  ///< degrees
  double altitude = 0.0;                   ///< m above the ellipsoid; NaN: unknown
  std::array<double, 9> covariance{};      ///< m^2, east north up, row by row
  int covariance_type = 0;                 ///< 0 unknown, 1 approximated, 2 diagonal, 3 full
};

/// sensor_msgs/Imu.
struct RosImu {
  RosStamp stamp;
  Eigen::Quaterniond orientation;       ///< world_from_imu, as it stands
  bool has_orientation = false;         ///< its covariance does not start with -1, it is no zero
  Eigen::Vector3d angular_velocity;     ///< rad/s
  Eigen::Vector3d linear_acceleration;  ///< m/s^2, gravity included
};

/// nav_msgs/Odometry.
struct RosOdometry {
  RosStamp stamp;  ///< its frame is that of the pose
  std::string child;
  SE3 pose;                         ///< frame_from_child, m
  Eigen::Vector3d linear_velocity;  ///< m/s, in the child's frame
  std::array<double, 36> velocity_covariance{};
};

/// geometry_msgs/TransformStamped.
struct RosTransform {
  RosStamp stamp;  ///< its frame is the parent's
  std::string child;
  SE3 parent_from_child;
};

/// sensor_msgs/PointCloud2; the points stay where the message is.
struct RosPointCloud {
  struct Field {
    std::string name;
    std::uint32_t offset = 0;  ///< bytes
    int type = 0;              ///< 1 int8, 2 uint8, 3 int16, ... 7 float32, 8 float64
    std::uint32_t count = 1;
  };
  RosStamp stamp;
  std::uint32_t width = 0, height = 0;
  std::vector<Field> fields;
  bool big_endian = false;
  std::uint32_t point_step = 0, row_step = 0;  ///< bytes
  const std::uint8_t* data = nullptr;          ///< height rows of row_step bytes
  std::size_t size = 0;
};

// @throws InputError (file: position: found, expected) for bytes that cannot be such a message.
RosImage read_ros_image(const RosBytes& message);
RosCompressedImage read_ros_compressed_image(const RosBytes& message);
RosFix read_ros_fix(const RosBytes& message);
RosImu read_ros_imu(const RosBytes& message);
RosOdometry read_ros_odometry(const RosBytes& message);
/// tf2_msgs/TFMessage.
std::vector<RosTransform> read_ros_transforms(const RosBytes& message);
RosPointCloud read_ros_point_cloud(const RosBytes& message);

/// sensor_msgs/CameraInfo as a calibration. @throws InputError also for images that the driver
/// binned or cut out, whose calibration would have to be changed, and for a camera that is not
/// calibrated (focal lengths of 0).
CameraCalibration read_ros_camera_info(const RosBytes& message);

}  // namespace camber
