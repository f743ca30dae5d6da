#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <string_view>
#include <vector>

#include "camber/cloud/road_cloud.h"

namespace camber::test {

/// What is wrong with the points of a curved road that a fit to independent errors leaves out.
enum class RoadNoise {
  kCorrelated3m,    ///< heights of 15 mm in common along 3 m of road, 15 mm of their own
  kCorrelated10m,   ///< the same along 10 m
  kCorrelated30m,   ///< the same along 30 m
  kUnderstated,     ///< a camera's, three times as large as the sigmas given with the points
  kFrames,          ///< a camera's; those of a frame (one every 5 m) have a height and a scale in
                    ///< common
  kScanner,         ///< grows with the distance from one place beside the road; no sigmas
  kHeavyTails,      ///< Student's t of two degrees of freedom, 15 mm
  kOneSided,        ///< a quarter of the points above the road, as what grows or stands there is
  kFramesLevelled,  ///< frames, one every 2 m, whose pitch, roll and height drift
  kLevelled,        ///< the whole cloud turned about a level axis through its middle, 0.02 deg
};
inline constexpr RoadNoise kRoadNoises[] = {RoadNoise::kCorrelated3m,   RoadNoise::kCorrelated10m,
                                            RoadNoise::kCorrelated30m,  RoadNoise::kUnderstated,
                                            RoadNoise::kFrames,         RoadNoise::kScanner,
                                            RoadNoise::kHeavyTails,     RoadNoise::kOneSided,
                                            RoadNoise::kFramesLevelled, RoadNoise::kLevelled};
std::string_view to_string(RoadNoise noise);

struct CurvedRoadOptions {
  std::uint64_t seed = 0;
  RoadNoise noise = RoadNoise::kCorrelated10m;
  std::size_t points = 40000;
  double length = 160.0;  ///< m, of road in plan
};

/// A made road, 8 m wide, that bends smoothly in plan, in height and in its bank; every other one
/// (by the second lowest bit of the seed) has a crown of 2 %. z is up. Where errors in common and
/// levelling are not themselves what is wrong, its heights drift by 10 mm along 15 m besides, as
/// those of any survey do.
struct CurvedRoad {
  RoadCloud cloud;
  std::vector<Eigen::Vector3d> line;  ///< the centreline, a point a metre of its stations
  std::vector<double> bank;           ///< rise over run at the line's points, left side up
  bool crowned = false;               ///< falls by 2 % to both sides of the centreline besides
};

/// @throws std::invalid_argument for a road shorter than 20 m.
CurvedRoad make_curved_road(const CurvedRoadOptions& options);

}  // namespace camber::test
