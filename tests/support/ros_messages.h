#pragma once

#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

namespace camber::test {

/// Messages of ROS 1, serialised field by field after their definitions, little-endian.
class RosWriter {
 public:
  template <typename T>
  RosWriter& put(T value) {
    const auto* from = reinterpret_cast<const char*>(&value);
    bytes_.append(from, sizeof(T));
    return *this;
  }
  RosWriter& text(const std::string& text) {
    put(static_cast<std::uint32_t>(text.size()));
    bytes_ += text;
    return *this;
  }
  RosWriter& header(double seconds) {
    put(std::uint32_t{7});
    put(static_cast<std::uint32_t>(seconds));
    put(static_cast<std::uint32_t>(1e9 * (seconds - static_cast<std::uint32_t>(seconds)) + 0.5));
    return text("camera");
  }
  RosWriter& numbers(const std::vector<double>& values) {
    for (const double value : values) put(value);
    return *this;
  }
  const std::string& bytes() const { return bytes_; }

 private:
  std::string bytes_;
};

/// sensor_msgs/Image. @param step  bytes a row.
inline std::string ros_image(double seconds, int width, int height, const std::string& encoding,
                             int step, const std::string& pixels) {
  return RosWriter()
      .header(seconds)
      .put(static_cast<std::uint32_t>(height))
      .put(static_cast<std::uint32_t>(width))
      .text(encoding)
      .put(std::uint8_t{0})
      .put(static_cast<std::uint32_t>(step))
      .text(pixels)
      .bytes();
}

/// sensor_msgs/CompressedImage.
inline std::string ros_compressed_image(double seconds, const std::string& format,
                                        const std::string& file) {
  return RosWriter().header(seconds).text(format).text(file).bytes();
}

/// sensor_msgs/CameraInfo with P = [K | 0] but for a focal length of P of its own.
struct RosCameraInfo {
  int width = 80, height = 60;
  std::string model = "plumb_bob";
  std::vector<double> coefficients = {-0.3, 0.1, 0.001, 0.002, 0};
  double fx = 100, fy = 101, cx = 40, cy = 30, projection_f = 90;
  std::uint32_t binning = 0, roi_left = 0;

  std::string bytes(double seconds = 100) const {
    return RosWriter()
        .header(seconds)
        .put(static_cast<std::uint32_t>(height))
        .put(static_cast<std::uint32_t>(width))
        .text(model)
        .put(static_cast<std::uint32_t>(coefficients.size()))
        .numbers(coefficients)
        .numbers({fx, 0, cx, 0, fy, cy, 0, 0, 1})
        .numbers({1, 0, 0, 0, 1, 0, 0, 0, 1})
        .numbers({projection_f, 0, cx, 0, 0, projection_f, cy, 0, 0, 0, 1, 0})
        .put(binning)
        .put(binning)
        .put(roi_left)
        .put(std::uint32_t{0})
        .put(std::uint32_t{0})
        .put(std::uint32_t{0})
        .put(std::uint8_t{0})
        .bytes();
  }
};

}  // namespace camber::test
