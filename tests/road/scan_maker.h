#pragma once

#include <cstdint>
#include <vector>

#include "camber/cloud/road_cloud.h"

namespace camber::test {

/// A made scan of a rotating 64-beam laser in a street, with the truth about its ground.
///
/// Sensor frame, x forward, y left, z up, the sensor `kSensorHeight` above the road. Beams as on
/// KITTI's sensor: 32 from +2 to -8.33 degrees, 32 from -8.83 to -24.33; range to 100 m, noise of
/// 2 cm. The ground has a crown, pavements behind kerbs of 13 cm, verges of grass up to 6 cm high,
/// a ditch on one side, a bank on the other, and undulations. On it stand parked and moving cars on
/// wheels, trucks, houses, walls, hedges, poles, trees and people. 0.3 % of the points are
/// reflections below the ground, some of them in clusters, 0.1 % lie in front of what was hit.
struct ScanOptions {
  std::uint64_t seed = 0;
  /// rad, of the hills: up ahead, down behind (or the other way round, or all one slope, as the
  /// seed says); 0: flat
  double grade = 0.0;
  int azimuths = 2160;  ///< columns of 64 beams
};

constexpr double kSensorHeight = 1.73;  ///< m

struct Scan {
  RoadCloud cloud;
  std::vector<int> ground;    ///< 1 ground, 0 not
  std::vector<float> height;  ///< m, true height above the ground's surface
};

Scan make_scan(const ScanOptions& options);

/// Precision, recall and their harmonic mean of ground labels.
struct GroundScore {
  double precision = 0.0, recall = 0.0, f1 = 0.0;
};
GroundScore score_ground(const std::vector<int>& truth, const std::vector<int>& labels);

}  // namespace camber::test
