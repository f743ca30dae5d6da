#include "camber/import/formats/ros_messages.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstring>

#include "camber/core/errors.h"
#include "camber/core/read_file.h"
#include "camber/import/formats/detail/calibration_forms.h"

namespace camber {
namespace {

constexpr std::uint32_t kMaxSide = 16384;

/// Takes a message from its start; the machine is little-endian, as the messages are.
class Cursor {
 public:
  explicit Cursor(const RosBytes& message) : message_(message) {}

  template <typename T>
  T value(const char* what) {
    T out;
    std::memcpy(&out, take(sizeof(T), what), sizeof(T));
    return out;
  }
  std::string text(const char* what) {
    const auto length = value<std::uint32_t>(what);
    const std::uint8_t* from = take(length, what);
    return {reinterpret_cast<const char*>(from), length};
  }
  std::vector<double> numbers(std::size_t count, const char* what) {
    const std::uint8_t* from = take(count * sizeof(double), what);
    std::vector<double> out(count);
    if (count > 0) std::memcpy(out.data(), from, count * sizeof(double));
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
    value<std::uint32_t>("sequence number");
    const auto seconds = value<std::uint32_t>("time stamp");
    const auto nanoseconds = value<std::uint32_t>("time stamp");
    text("frame_id");
    return {std::int64_t{seconds} * 1000000000 + nanoseconds};
  }
  [[noreturn]] void fail(const std::string& reason) const {
    throw InputError(message_.file, message_.position, reason);
  }

 private:
  const RosBytes& message_;
  std::size_t at_ = 0;
};

}  // namespace

RosImage read_ros_image(const RosBytes& message) {
  Cursor cursor(message);
  RosImage out;
  out.stamp = cursor.header();
  out.height = cursor.value<std::uint32_t>("height");
  out.width = cursor.value<std::uint32_t>("width");
  out.encoding = cursor.text("encoding");
  cursor.value<std::uint8_t>("is_bigendian");
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
