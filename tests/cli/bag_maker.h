#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace camber::test {

enum class BagCompression { kNone, kBz2, kLz4 };

struct BagContent {
  std::string topic;
  std::string type;   ///< "Image", "CompressedImage" or "CameraInfo", or another word
  std::string bytes;  ///< serialised
};

/// Writes a bag by ROS's own writer, the messages 0.1 s apart.
/// @param chunk_bytes  about the length of a chunk; the writer's least is one message.
void write_bag(const std::filesystem::path& path, const std::vector<BagContent>& messages,
               BagCompression compression = BagCompression::kNone, int chunk_bytes = 768 * 1024);

}  // namespace camber::test
