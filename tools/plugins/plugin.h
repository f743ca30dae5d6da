#pragma once

#include <string>

namespace camber::tools {

/// The program is made of a small front and of plugins, shared modules libcamber_NAME.so in the
/// folder lib/camber beside its bin. Each holds its part of the library; what it needs from outside
/// is loaded with it, at its first use:
///   clouds  commands on clouds
///   frames  all other commands: OpenCV, without its image and video formats
///   vtk     text and 3D scenes
///   crs     coordinate systems by name: PROJ
///   gdal    GeoTIFF; built only where GDAL is installed
///   pcl     patches and ground by the Point Cloud Library
///   video   films and videos: OpenCV's videoio, FFmpeg
///   networks  detectors and segmenters: OpenCV's DNN
///   bags    recordings of ROS 2 and MCAP: SQLite, zstd, lz4
///   rosbag  bags: ROS's rosbag_storage; built only where that is installed
///
/// @return what a plugin exports under that name, not nullptr.
/// @throws MachineError if the plugin is not there, cannot be loaded, or is of another version.
void* plugin_symbol(const std::string& plugin, const char* symbol);

/// Whether a plugin was built and installed.
bool has_plugin(const std::string& plugin);

}  // namespace camber::tools

/// Marks what a plugin exports; all else is hidden.
#define CAMBER_EXPORT extern "C" __attribute__((visibility("default")))
