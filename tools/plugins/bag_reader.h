#pragma once

#include <filesystem>
#include <memory>

#include "camber/import/import_rosbag.h"

namespace camber::tools {

/// Opens a bag of ROS 1 by ROS's own library, which a plugin of its own loads.
/// @throws InputError for what is no bag, is damaged, was not closed or is encrypted; MachineError
///         where the program was built without ROS's library.
std::unique_ptr<BagReader> open_bag(const std::filesystem::path& path);

/// What the plugin rosbag exports as camber_rosbag().
struct BagFunctions {
  decltype(&tools::open_bag) open_bag;
};

}  // namespace camber::tools
