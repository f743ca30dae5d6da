#pragma once

#include <cstdint>
#include <string>
#include <string_view>

namespace camber {

/// A file of JSON messages being written: MCAP.
class MessageSink {
 public:
  virtual ~MessageSink() = default;
  /// A JSON Schema of the messages of channels. @return its id, for add_channel().
  virtual std::uint16_t add_schema(const std::string& name, const std::string& json_schema) = 0;
  /// @return its id, for write().
  virtual std::uint16_t add_channel(std::uint16_t schema, const std::string& topic) = 0;
  /// A message in JSON. @param time_ns  of its recording and its publication
  virtual void write(std::uint16_t channel, std::uint64_t time_ns, std::string_view message) = 0;
  /// Ends the file; nothing may be written after it.
  virtual void finish() = 0;
};

/// Foxglove's schemas for JSON, by their names ("foxglove.PointCloud"), as far as Camber writes
/// them: CompressedImage, CameraCalibration, FrameTransform, PointCloud, SceneUpdate, LocationFix.
/// @throws std::invalid_argument for another name.
std::string foxglove_schema(const std::string& name);

/// RFC 4648, with padding.
std::string base64(std::string_view bytes);

}  // namespace camber
