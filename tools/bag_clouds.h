#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "camber/core/progress.h"
#include "cloud_arguments.h"

namespace camber::tools {

/// Point clouds out of a recording.
struct BagClouds {
  std::string topic;   ///< of PointCloud2; empty: the only one
  int message = -1;    ///< from 0; -1: the only one, or all
  bool merge = false;  ///< all messages as one cloud, in the frame that does not move
};

struct BagCloudsWritten {
  std::uint64_t points = 0, messages = 0;
  std::vector<std::string> files;
  std::vector<std::string> notes;
};

/// Writes the clouds of a topic: one file, or, where `out` is a folder (there already, or ending
/// in a slash), a file a message, named by its stamp (seconds_nanoseconds).
/// @throws InputError, UsageError; NoAnswerError where no message has a place in the fixed frame.
BagCloudsWritten write_bag_clouds(const std::string& bag, const BagClouds& what,
                                  const std::string& out, const WriteOptions& options,
                                  bool overwrite);

}  // namespace camber::tools
