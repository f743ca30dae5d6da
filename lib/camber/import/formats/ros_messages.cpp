#include "camber/import/formats/ros_messages.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>

#include "camber/core/errors.h"
#include "camber/core/read_file.h"
#include "camber/import/formats/detail/calibration_forms.h"

namespace camber {
namespace {

constexpr std::uint32_t kMaxSide = 16384;
constexpr std::size_t kMaxFields = 1024;  // of a point

/// Takes a message from its start; the machine is little-endian.
class Cursor {
 public:
  explicit Cursor(const RosBytes& message) : message_(message) {
    if (!message.cdr) return;
    constexpr std::size_t kEncapsulation = 4;
    const std::uint8_t* const start = take(kEncapsulation, "encapsulation");
    // 0 and 1 are CDR, 6 and 7 XCDR2; odd ones are little-endian.
    const int kind = start[0] << 8 | start[1];
    if (kind != 0 && kind != 1 && kind != 6 && kind != 7) {
      fail(
          fmt::format("found the encapsulation {:#06x}, expected CDR (0x0000, 0x0001) or XCDR2 "
                      "(0x0006, 0x0007)",
                      kind));
    }
    start_ = kEncapsulation;
    swap_ = kind % 2 == 0;
    largest_alignment_ = kind < 6 ? 8 : 4;
  }

  template <typename T>
  T value(const char* what) {
    align(sizeof(T), what);
    std::array<std::uint8_t, sizeof(T)> bytes;
    std::copy_n(take(sizeof(T), what), sizeof(T), bytes.begin());
    if (swap_) std::reverse(bytes.begin(), bytes.end());
    T out;
    std::memcpy(&out, bytes.data(), sizeof(T));
    return out;
  }
  std::string text(const char* what) {
    const auto length = value<std::uint32_t>(what);
    const std::uint8_t* from = take(length, what);
    std::string out(reinterpret_cast<const char*>(from), length);
    // CDR counts the zero at the end.
    if (message_.cdr && !out.empty() && out.back() == '\0') out.pop_back();
    return out;
  }
  std::vector<double> numbers(std::size_t count, const char* what) {
    if (count > message_.size / sizeof(double)) {
      fail(fmt::format("found {} numbers in {} bytes ({}), expected a whole message", count,
                       message_.size, what));
    }
    std::vector<double> out(count);
    for (double& number : out) number = value<double>(what);
    return out;
  }
  Eigen::Vector3d vector(const char* what) {
    const std::vector<double> v = numbers(3, what);
    return {v[0], v[1], v[2]};
  }
  /// x y z w
  Eigen::Quaterniond quaternion(const char* what) {
    const std::vector<double> v = numbers(4, what);
    return {v[3], v[0], v[1], v[2]};
  }
  template <std::size_t N>
  std::array<double, N> array(const char* what) {
    const std::vector<double> v = numbers(N, what);
    std::array<double, N> out;
    std::copy(v.begin(), v.end(), out.begin());
    return out;
  }
  const std::uint8_t* take(std::size_t count, const char* what) {
    const std::size_t left = message_.size - at_;
    if (count > left) {
      fail(fmt::format("found {} of {} bytes at byte {} ({}), expected a whole message", left,
                       count, at_, what));
    }
    const std::uint8_t* out = message_.data + at_;
    at_ += count;
    return out;
  }
  RosStamp header() {
    if (!message_.cdr) value<std::uint32_t>("sequence number");
    const auto seconds = value<std::uint32_t>("time stamp");
    const auto nanoseconds = value<std::uint32_t>("time stamp");
    RosStamp out;
    out.ns = std::int64_t{seconds} * 1000000000 + nanoseconds;
    out.frame = text("frame_id");
    return out;
  }
  /// A rigid transform with a rotation of length 1, or nearly.
  SE3 pose(const char* what) {
    const Eigen::Vector3d translation = vector(what);
    const Eigen::Quaterniond rotation = quaternion(what);
    const double norm = rotation.norm();
    if (!translation.allFinite() || !(norm > 0.5 && norm < 2.0)) {
      fail(fmt::format("found a pose that is none ({}), expected finite numbers and a rotation",
                       what));
    }
    return {rotation.normalized(), translation};
  }
  std::size_t left() const { return message_.size - at_; }
  [[noreturn]] void fail(const std::string& reason) const {
    throw InputError(message_.file, message_.position, reason);
  }

 private:
  void align(std::size_t size, const char* what) {
    if (!message_.cdr) return;
    const std::size_t step = std::min(size, largest_alignment_);
    const std::size_t over = (at_ - start_) % step;
    if (over > 0) take(step - over, what);
  }

  const RosBytes& message_;
  std::size_t at_ = 0, start_ = 0, largest_alignment_ = 1;
  bool swap_ = false;
};

}  // namespace

RosImage read_ros_image(const RosBytes& message) {
  Cursor cursor(message);
  RosImage out;
  out.stamp = cursor.header();
  out.height = cursor.value<std::uint32_t>("height");
  out.width = cursor.value<std::uint32_t>("width");
  out.encoding = cursor.text("encoding");
  out.big_endian = cursor.value<std::uint8_t>("is_bigendian") != 0;
  out.step = cursor.value<std::uint32_t>("step");
  out.size = cursor.value<std::uint32_t>("length of the pixels");
  out.data = cursor.take(out.size, "pixels");
  if (out.width < 1 || out.height < 1 || out.width > kMaxSide || out.height > kMaxSide) {
    cursor.fail(fmt::format("found an image of {} x {} pixels, expected 1 to {} a side", out.width,
                            out.height, kMaxSide));
  }
  const std::uint64_t needed = std::uint64_t{out.height} * out.step;
  if (out.size < needed) {
    cursor.fail(fmt::format("found {} bytes of pixels, expected {} rows of {}", out.size,
                            out.height, out.step));
  }
  return out;
}

RosCompressedImage read_ros_compressed_image(const RosBytes& message) {
  Cursor cursor(message);
  RosCompressedImage out;
  out.stamp = cursor.header();
  out.format = cursor.text("format");
  out.size = cursor.value<std::uint32_t>("length of the image");
  out.data = cursor.take(out.size, "image");
  return out;
}

RosFix read_ros_fix(const RosBytes& message) {
  Cursor cursor(message);
  RosFix out;
  out.stamp = cursor.header();
  out.status = cursor.value<std::int8_t>("status");
  cursor.value<std::uint16_t>("service");
  out.latitude = cursor.value<double>("latitude");
  out.longitude = cursor.value<double>("longitude");
  out.altitude = cursor.value<double>("altitude");
  out.covariance = cursor.array<9>("covariance");
  out.covariance_type = cursor.value<std::uint8_t>("covariance type");
  return out;
}

RosImu read_ros_imu(const RosBytes& message) {
  Cursor cursor(message);
  RosImu out;
  out.stamp = cursor.header();
  out.orientation = cursor.quaternion("orientation");
  const auto covariance = cursor.array<9>("covariance of the orientation");
  out.angular_velocity = cursor.vector("angular velocity");
  cursor.array<9>("covariance of the angular velocity");
  out.linear_acceleration = cursor.vector("acceleration");
  cursor.array<9>("covariance of the acceleration");
  const double norm = out.orientation.norm();
  out.has_orientation = covariance[0] != -1.0 && norm > 0.5 && norm < 2.0;
  return out;
}

RosOdometry read_ros_odometry(const RosBytes& message) {
  Cursor cursor(message);
  RosOdometry out;
  out.stamp = cursor.header();
  out.child = cursor.text("child_frame_id");
  out.pose = cursor.pose("pose");
  cursor.array<36>("covariance of the pose");
  out.linear_velocity = cursor.vector("velocity");
  cursor.vector("angular velocity");
  out.velocity_covariance = cursor.array<36>("covariance of the velocity");
  return out;
}

std::vector<RosTransform> read_ros_transforms(const RosBytes& message) {
  Cursor cursor(message);
  const auto count = cursor.value<std::uint32_t>("number of transforms");
  std::vector<RosTransform> out;
  for (std::uint32_t i = 0; i < count; ++i) {
    RosTransform one;
    one.stamp = cursor.header();
    one.child = cursor.text("child_frame_id");
    one.parent_from_child = cursor.pose("transform");
    out.push_back(std::move(one));
  }
  return out;
}

RosPointCloud read_ros_point_cloud(const RosBytes& message) {
  static const std::uint32_t kSizes[] = {0, 1, 1, 2, 2, 4, 4, 4, 8};
  Cursor cursor(message);
  RosPointCloud out;
  out.stamp = cursor.header();
  out.height = cursor.value<std::uint32_t>("height");
  out.width = cursor.value<std::uint32_t>("width");
  const auto count = cursor.value<std::uint32_t>("number of fields");
  for (std::uint32_t i = 0; i < count; ++i) {
    RosPointCloud::Field field;
    field.name = cursor.text("name of a field");
    field.offset = cursor.value<std::uint32_t>("offset of a field");
    field.type = cursor.value<std::uint8_t>("type of a field");
    field.count = cursor.value<std::uint32_t>("count of a field");
    if (field.count > kMaxFields || out.fields.size() > kMaxFields) {
      cursor.fail("found more than 1024 values a point, expected fewer");
    }
    if (field.type < 1 || field.type > 8) {
      cursor.fail(fmt::format("found a field '{}' of the type {}, expected 1 to 8",
                              printable(field.name, 40), field.type));
    }
    out.fields.push_back(std::move(field));
  }
  out.big_endian = cursor.value<std::uint8_t>("is_bigendian") != 0;
  out.point_step = cursor.value<std::uint32_t>("point_step");
  out.row_step = cursor.value<std::uint32_t>("row_step");
  out.size = cursor.value<std::uint32_t>("length of the points");
  out.data = cursor.take(out.size, "points");
  const std::uint64_t row = std::uint64_t{out.width} * out.point_step;
  // Of one row drivers often state no step.
  if (out.height <= 1 && out.row_step < row && row <= UINT32_MAX) {
    out.row_step = static_cast<std::uint32_t>(row);
  }
  if (out.row_step < row || std::uint64_t{out.height} * out.row_step > out.size) {
    cursor.fail(fmt::format("found {} bytes of points, expected {} rows of {} points of {} bytes",
                            out.size, out.height, out.width, out.point_step));
  }
  for (const RosPointCloud::Field& field : out.fields) {
    const std::uint64_t end =
        field.offset + std::uint64_t{field.count} * kSizes[static_cast<std::size_t>(field.type)];
    if (end > out.point_step) {
      cursor.fail(
          fmt::format("found the field '{}' up to byte {} of a point of {}, expected it "
                      "to end within the point",
                      printable(field.name, 40), end, out.point_step));
    }
  }
  return out;
}

CameraCalibration read_ros_camera_info(const RosBytes& message) {
  Cursor cursor(message);
  CameraCalibration out;
  cursor.header();
  const auto height = cursor.value<std::uint32_t>("height");
  const auto width = cursor.value<std::uint32_t>("width");
  out.model = cursor.text("distortion_model");
  const auto count = cursor.value<std::uint32_t>("length of D");
  out.coefficients = cursor.numbers(count, "D");
  const std::vector<double> k = cursor.numbers(9, "K");
  cursor.numbers(9, "R");
  out.projection = cursor.numbers(12, "P");
  const auto binning_x = cursor.value<std::uint32_t>("binning");
  const auto binning_y = cursor.value<std::uint32_t>("binning");
  const auto left = cursor.value<std::uint32_t>("region of interest");
  const auto top = cursor.value<std::uint32_t>("region of interest");
  const auto roi_height = cursor.value<std::uint32_t>("region of interest");
  const auto roi_width = cursor.value<std::uint32_t>("region of interest");
  cursor.value<std::uint8_t>("region of interest");
  if (binning_x > 1 || binning_y > 1 || left > 0 || top > 0 ||
      (roi_width > 0 && roi_width != width) || (roi_height > 0 && roi_height != height)) {
    cursor.fail(
        "found a CameraInfo of images that were binned or cut out, expected one of whole images; "
        "give their calibration with --calib");
  }
  const auto finite = [](const std::vector<double>& values) {
    return std::all_of(values.begin(), values.end(), [](double v) { return std::isfinite(v); });
  };
  if (!finite(k) || !finite(out.coefficients) || !finite(out.projection)) {
    cursor.fail("found a CameraInfo with values that are no numbers, expected numbers");
  }
  if (!(k[0] > 0.0 && k[4] > 0.0)) {
    cursor.fail(
        fmt::format("found a CameraInfo with focal lengths {} and {}, as of a camera that was not "
                    "calibrated, expected positive ones; give a calibration with --calib",
                    k[0], k[4]));
  }
  if (width > 0 && height > 0 && width <= kMaxSide && height <= kMaxSide) {
    out.width = static_cast<int>(width);
    out.height = static_cast<int>(height);
  }
  out.fx = k[0];
  out.cx = k[2];
  out.fy = k[4];
  out.cy = k[5];
  set_lens_by_word(&out, out.model, out.coefficients);
  return out;
}

}  // namespace camber
