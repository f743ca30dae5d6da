#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "camber/cloud/road_cloud.h"
#include "camber/geometry/pinhole_camera.h"
#include "camber/geometry/se3.h"

namespace camber {

/// A camera of a COLMAP model, as COLMAP has it: the centre of the top-left pixel is (0.5, 0.5).
struct ColmapCamera {
  std::int64_t id = 0;
  std::string model;  ///< "PINHOLE", "SIMPLE_RADIAL", ...
  std::uint64_t width = 0, height = 0;
  std::vector<double> parameters;  ///< in the order that COLMAP's documentation gives

  /// In Camber's convention (pixel centres at integers: cx and cy less one half), for the models
  /// without distortion, SIMPLE_PINHOLE and PINHOLE; nothing for others.
  std::optional<PinholeCamera> pinhole() const;
};

struct ColmapImage {
  std::int64_t id = 0;
  std::int64_t camera_id = 0;
  std::string name;
  SE3 camera_from_world;
  std::vector<Eigen::Vector2d> points;  ///< px, COLMAP's convention
  std::vector<std::int64_t> point_ids;  ///< of the 3D points seen there, -1 for none
};

struct ColmapPoint {
  std::uint64_t id = 0;
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  ///< world, unit unknown
  std::array<std::uint8_t, 3> color{};
  double error = 0.0;  ///< mean reprojection error, px; -1 unknown
  std::vector<std::pair<std::int32_t, std::int32_t>> track;  ///< image id, index of its point
};

/// A sparse reconstruction of COLMAP (Schoenberger and Frahm, "Structure-from-motion revisited",
/// CVPR 2016).
struct ColmapModel {
  std::vector<ColmapCamera> cameras;  ///< in the files' order
  std::vector<ColmapImage> images;
  std::vector<ColmapPoint> points;

  /// The points with colours, the scalar "error" (px) and the label "track_length"; up to scale.
  RoadCloud cloud() const;
};

/// Reads cameras, images and points3D (all .bin or all .txt) of a folder. Files are trusted no more
/// than clouds are.
/// @throws InputError "file: line N / byte N: what was found, what was expected".
ColmapModel read_colmap_model(const std::filesystem::path& folder);

/// The same for one file in memory. @param name in messages; binary if it ends in .bin
std::vector<ColmapCamera> parse_colmap_cameras(const void* data, std::size_t size,
                                               const std::string& name);
std::vector<ColmapImage> parse_colmap_images(const void* data, std::size_t size,
                                             const std::string& name);
std::vector<ColmapPoint> parse_colmap_points(const void* data, std::size_t size,
                                             const std::string& name);

}  // namespace camber
