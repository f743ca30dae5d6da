#include "camber/scene/input_kind.h"

#include <algorithm>
#include <array>

#include "camber/core/lower_case.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

template <std::size_t N>
bool ends_in(const fs::path& path, const std::array<const char*, N>& extensions) {
  const std::string extension = lower_case(path.extension().string());
  return std::find(extensions.begin(), extensions.end(), extension) != extensions.end();
}

constexpr std::array kImageExtensions = {".png", ".jpg", ".jpeg"};
constexpr std::array kVideoExtensions = {".mp4", ".mov", ".m4v",  ".mkv",   ".avi",  ".webm",
                                         ".mts", ".ts",  ".m2ts", ".mpg",   ".mpeg", ".wmv",
                                         ".flv", ".3gp", ".ogv",  ".mjpeg", ".h264", ".hevc"};

constexpr std::array kBagExtensions = {".bag", ".mcap", ".db3"};

}  // namespace

std::string to_string(InputKind kind) {
  switch (kind) {
    case InputKind::kVideo:
      return "video";
    case InputKind::kImages:
      return "images";
    case InputKind::kBag:
      return "rosbag";
    case InputKind::kScene:
      break;
  }
  return "scene";
}

InputKind kind_of_input(const fs::path& path) {
  std::error_code error;
  if (fs::is_directory(path, error)) {
    for (const char* own : {"scene.json", "run.json"}) {  // the pictures of a result are no drive
      if (fs::exists(path / own, error)) return InputKind::kScene;
    }
    bool images = false, recording = false;
    for (fs::directory_iterator at(path, error), end; !error && at != end; at.increment(error)) {
      images = images || ends_in(at->path(), kImageExtensions);
      recording = recording || ends_in(at->path(), kBagExtensions);
    }
    if (recording && fs::exists(path / "metadata.yaml", error)) return InputKind::kBag;
    return images ? InputKind::kImages : InputKind::kScene;
  }
  if (!fs::is_regular_file(path, error)) return InputKind::kScene;
  if (ends_in(path, kVideoExtensions)) return InputKind::kVideo;
  return ends_in(path, kBagExtensions) ? InputKind::kBag : InputKind::kScene;
}

}  // namespace camber
