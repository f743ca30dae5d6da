#pragma once

#include <ostream>

#include "camber/export/foxglove.h"
#include "camber/import/recording.h"

namespace camber::tools {

/// Opens a recording of ROS 1 (by ROS's own library), rosbag2 or MCAP, by what it begins with; the
/// plugin that reads it is loaded.
/// @throws InputError for what is none or is damaged; MachineError where ROS's library is needed
///         and was not there when the program was built.
std::unique_ptr<BagReader> open_any_bag(const std::filesystem::path& path);

/// Whether a path is a folder or file of rosbag2, an MCAP file or a bag of ROS 1, by its name or
/// its first bytes.
bool looks_like_bag(const std::filesystem::path& path);

/// A file of MCAP, by the plugin bags; McapWriter of export/mcap_file.h.
std::unique_ptr<MessageSink> make_mcap_sink(std::ostream& out);

/// What the plugin bags exports as camber_bags().
struct RecordingFunctions {
  decltype(&camber::open_recording) open_recording;
  decltype(&tools::make_mcap_sink) make_mcap_sink;
};

}  // namespace camber::tools
