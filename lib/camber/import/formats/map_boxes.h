#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "camber/geometry/se3.h"

namespace camber {

/// A box of a data set with z up: its own axes x to the front, y to the left, z up.
struct MapBox {
  Eigen::Vector3d center = Eigen::Vector3d::Zero();              ///< m
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();  ///< frame from box
  double length = 0.0, width = 0.0, height = 0.0;                ///< m, > 0
  std::int64_t timestamp = -1;                                   ///< ns; -1: none is stated
  std::string category;
};

/// What is written beside a box that was put on the ground.
struct MapBoxNote {
  std::string status, reason;
  double height_sigma = 0.0;  ///< m; NaN: not known
};

/// Boxes of nuScenes (.json: results of a detector by sample token, or a table of annotations, each
/// with translation, size (width, length, height) and rotation (w, x, y, z)) or of Argoverse 2
/// (.feather or .csv: length_m, width_m, height_m, qw, qx, qy, qz, tx_m, ty_m, tz_m or x_m, y_m,
/// z_m, and timestamp_ns), with all else that the file holds but nested columns.
class MapBoxFile {
 public:
  /// @throws InputError "file: place: found, expected".
  static MapBoxFile read(const std::filesystem::path& path);
  ~MapBoxFile();
  MapBoxFile(MapBoxFile&&) noexcept;

  const std::vector<MapBox>& boxes() const { return boxes_; }
  const char* form() const;  ///< "nuscenes" or "argoverse2"
  /// The file, a Feather file as CSV, with other centres and rotations, and what was done:
  /// camber_status, camber_reason and camber_height_sigma of each box.
  /// @param boxes, notes  one a box, in their order.
  std::string encoded(const std::vector<MapBox>& boxes, const std::vector<MapBoxNote>& notes) const;

 private:
  struct Content;
  MapBoxFile();
  std::vector<MapBox> boxes_;
  std::unique_ptr<Content> content_;
};

/// Poses of a vehicle by time stamp, Argoverse 2's city_SE3_egovehicle as Feather or CSV:
/// timestamp_ns, qw, qx, qy, qz, tx_m, ty_m, tz_m (or x_m, ...). @throws InputError.
std::map<std::int64_t, SE3> read_stamped_poses(const std::filesystem::path& path);

}  // namespace camber
