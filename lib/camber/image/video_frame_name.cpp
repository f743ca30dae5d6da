#include <string>

#include "camber/image/video.h"

namespace fs = std::filesystem;

namespace camber {

std::optional<VideoFrameName> video_frame_name(const fs::path& path) {
  const std::string text = path.string();
  const std::size_t mark = text.rfind('#');
  if (mark == std::string::npos || mark == 0 || mark + 1 == text.size() ||
      text.size() - mark > 10 ||
      text.find_first_not_of("0123456789", mark + 1) != std::string::npos) {
    return std::nullopt;
  }
  std::error_code error;
  if (fs::exists(path, error)) return std::nullopt;
  return VideoFrameName{text.substr(0, mark), std::stoi(text.substr(mark + 1))};
}

fs::path image_file_of(const fs::path& path) {
  const auto name = video_frame_name(path);
  return name ? name->file : path;
}

}  // namespace camber
