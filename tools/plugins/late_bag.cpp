// The reader of bags, as the other plugins have it: see late_vtk.cpp. Its plugin is built only
// where ROS's library is installed.

#include "bag_reader.h"
#include "camber/core/errors.h"
#include "plugin.h"

namespace camber::tools {

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
