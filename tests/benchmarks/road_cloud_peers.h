#pragma once

#include <string>
#include <vector>

#include "camber/cloud/road_cloud.h"
#include "camber/geometry/plane.h"

namespace camber::benchmarks {

/// CPU milliseconds of this process since it began.
double cpu_ms();

/// What another library made of a cloud. Times are CPU time of its own calls, after the points were
/// copied into its containers.
struct PeerAnswer {
  std::string name;
  bool available = true;
  std::vector<Plane> planes;
  std::vector<int> labels;  ///< plane of each point, -1: none
  double ms = 0.0;
  double normals_ms = 0.0;  ///< of the normals that it needs, apart
};

/// PCL: one plane by RANSAC or MSAC with a threshold of 5 cm, then least squares over its inliers.
PeerAnswer pcl_plane(const RoadCloud& cloud, bool msac, int max_iterations);

/// CGAL's Efficient RANSAC (Schnabel, Wahl, Klein, CGF 2007) with normals of 24 neighbours; not
/// available where the program was built without CGAL.
PeerAnswer cgal_planes(const RoadCloud& cloud, std::size_t least_points);

}  // namespace camber::benchmarks
