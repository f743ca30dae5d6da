// The reader of bags, as the other plugins have it: see late_vtk.cpp. Its plugin is built only
// where ROS's library is installed.

#include <fstream>

#include "bag_reader.h"
#include "camber/core/errors.h"
#include "camber/core/lower_case.h"
#include "plugin.h"
#include "recording_plugin.h"

namespace fs = std::filesystem;

namespace camber::tools {
namespace {

enum class BagKind { kNone, kRos1, kRecording };

BagKind kind_of(const fs::path& path) {
  std::error_code error;
  if (fs::is_directory(path, error)) {
    if (fs::exists(path / "metadata.yaml", error)) return BagKind::kRecording;
    for (const fs::directory_entry& entry : fs::directory_iterator(path, error)) {
      const std::string extension = lower_case(entry.path().extension().string());
      if (extension == ".mcap" || extension == ".db3") return BagKind::kRecording;
    }
    return BagKind::kNone;
  }
  const std::string extension = lower_case(path.extension().string());
  if (extension == ".mcap" || extension == ".db3") return BagKind::kRecording;
  if (extension == ".bag") return BagKind::kRos1;
  char bytes[16] = {};
  std::ifstream(path, std::ios::binary).read(bytes, sizeof bytes);
  const std::string_view start(bytes, sizeof bytes);
  if (start.substr(0, 7) == "#ROSBAG") return BagKind::kRos1;
  if (start.substr(0, 5) == "\x89MCAP" || start.substr(0, 13) == "SQLite format") {
    return BagKind::kRecording;
  }
  return BagKind::kNone;
}

}  // namespace

bool looks_like_bag(const fs::path& path) { return kind_of(path) != BagKind::kNone; }

namespace {

const RecordingFunctions& recordings() {
  using Functions = const RecordingFunctions* (*)();
  static const auto* functions =
      reinterpret_cast<Functions>(plugin_symbol("bags", "camber_bags"))();
  return *functions;
}

}  // namespace

std::unique_ptr<BagReader> open_any_bag(const fs::path& path) {
  if (kind_of(path) != BagKind::kRecording) return open_bag(path);
  return recordings().open_recording(path);
}

std::unique_ptr<MessageSink> make_mcap_sink(std::ostream& out) {
  return recordings().make_mcap_sink(out);
}

std::unique_ptr<BagReader> open_bag(const std::filesystem::path& path) {
  if (!has_plugin("rosbag")) {
    throw MachineError(
        "bags are read by Debian's package librosbag-storage-dev, which was not there when this "
        "program was built: install it and build the program anew");
  }
  using Functions = const BagFunctions* (*)();
  static const auto* functions =
      reinterpret_cast<Functions>(plugin_symbol("rosbag", "camber_rosbag"))();
  return functions->open_bag(path);
}

}  // namespace camber::tools
