#pragma once

#include <filesystem>
#include <memory>

#include "camber/import/bag.h"

namespace camber {

/// Whether a file or folder is a recording that open_recording() reads: a file that begins as MCAP
/// or SQLite's do, or a folder with metadata.yaml or with files that end in .mcap or .db3.
bool is_recording(const std::filesystem::path& path);

/// Opens an MCAP file (chunks of lz4 and zstd; the summary is not needed), a database of rosbag2
/// (.db3), or a rosbag2 folder of such files; single messages may be compressed by zstd. Reads it
/// once to count its messages and to see that it is whole. Databases are opened as immutable:
/// nothing is written beside them. Memory of one chunk and one message.
/// @throws InputError (file: position: found, expected) for what is damaged; MachineError where
///         the build lacks a library for it.
std::unique_ptr<BagReader> open_recording(const std::filesystem::path& path);

/// The reader of one MCAP file.
std::unique_ptr<BagReader> open_mcap(const std::filesystem::path& path);

/// Of one MCAP file in memory, which must outlive it. @param name  for messages
std::unique_ptr<BagReader> open_mcap(const void* data, std::size_t size, const std::string& name);

/// "sensor_msgs/Image" of "sensor_msgs/msg/Image".
std::string short_message_type(const std::string& type);

}  // namespace camber
