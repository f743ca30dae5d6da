#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace camber {

/// The frame that a cloud's coordinates are in, as far as the file or the producer states it.
enum class CloudFrame { kUnknown, kCamera, kZUp };

/// A point cloud of a road or its surroundings, one array per attribute; optional arrays are empty
/// or have one entry a point. Coordinates are metres relative to `origin` (kept in double so that
/// projected map coordinates survive): x_true = origin + points[i].
struct RoadCloud {
  CloudFrame frame = CloudFrame::kUnknown;
  bool metric = true;                                ///< false: up to an unknown scale
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();  ///< m
  std::vector<Eigen::Vector3f> points;               ///< m, relative to origin
  std::vector<std::array<std::uint8_t, 3>> colors;   ///< red, green, blue; or empty
  std::vector<float> sigmas;                         ///< m, along the viewing ray; or empty
  /// Full covariance of each point, upper triangle xx xy xz yy yz zz, m^2; or empty.
  std::vector<std::array<float, 6>> covariances;
  std::vector<Eigen::Vector3f> normals;               ///< unit; or empty
  std::map<std::string, std::vector<int>> labels;     ///< integer attributes: "patch", "ground"
  std::map<std::string, std::vector<float>> scalars;  ///< other attributes: "intensity"

  std::size_t size() const { return points.size(); }
  bool empty() const { return points.empty(); }

  /// Throws std::invalid_argument naming the first optional array whose length is not size().
  void validate() const;

  /// The cloud of the given points, in that order, with all their attributes.
  /// @param indices each in [0, size()).
  RoadCloud select(const std::vector<int>& indices) const;

  /// Up direction in the cloud's frame: (0, -1, 0) for a camera's, else (0, 0, 1).
  Eigen::Vector3d default_up() const {
    return frame == CloudFrame::kCamera ? Eigen::Vector3d(0, -1, 0) : Eigen::Vector3d(0, 0, 1);
  }
};

}  // namespace camber
