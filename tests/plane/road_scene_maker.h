#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "camber/cloud/road_cloud.h"
#include "camber/geometry/plane.h"

namespace camber::test {

/// A made road cloud with the truth about its planes.
///
/// z is up. The road is a chain of `planes` planar pieces, 15 to 30 m long and 10 m wide, slopes
/// within 25 degrees, breaks between neighbours of 4 to 14 degrees, banks within 5, heading changes
/// within 6. Every point is uniform on its surface and is seen by a camera that drives along,
/// 1.65 m above the road and 6 to 30 m before the point; its standard deviation along the ray is
/// 0.5 px * r^2 / (718 px * 1 m), across it 0.5 px * r / 718 px.
struct RoadSceneOptions {
  std::uint64_t seed = 0;
  int planes = 1;
  std::size_t points = 10000;
  /// Share of points that are not road: a quarter each uniform mismatches, facades, pavement 15 cm
  /// above the road, boxes of cars.
  double outlier_share = 0.3;
  bool with_sigmas = false;  ///< RoadCloud::sigmas: along the ray
  bool with_noise = true;
  /// true: neighbouring planes are cut where they meet; false: across the axis, with a step in
  /// height where their banks differ.
  bool cut_at_creases = true;
};

/// What a point was made from.
enum class PointSourceKind { kRoad, kMismatch, kFacade, kPavement, kCar };

struct RoadScene {
  RoadCloud cloud;
  std::vector<int> truth;  ///< index of the plane, -1: not road
  std::vector<PointSourceKind> kinds;
  std::vector<Plane> planes;          ///< normals up
  std::vector<Eigen::Vector3d> axis;  ///< planes + 1 points: ends of the pieces
  /// Index of the plane with the most points.
  int largest() const;
};

RoadScene make_road_scene(const RoadSceneOptions& options);

}  // namespace camber::test
