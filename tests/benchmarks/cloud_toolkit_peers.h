#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "camber/cloud/road_cloud.h"

/// The same jobs done with other libraries, on one thread. Times are CPU milliseconds of the job,
/// its index included, conversions of the points left out; negative where the library was not there
/// when this was built (CGAL, nanoflann and Open3D are optional).
namespace camber::peers {

struct PeerDistances {
  std::string name;
  double milliseconds = -1.0;
  std::vector<double> distances;  ///< m
};

PeerDistances flann_nearest(const RoadCloud& from, const RoadCloud& to);
PeerDistances pcl_nearest(const RoadCloud& from, const RoadCloud& to);
PeerDistances nanoflann_nearest(const RoadCloud& from, const RoadCloud& to);
PeerDistances open3d_nearest(const RoadCloud& from, const RoadCloud& to);
PeerDistances cgal_mesh_distance(const std::vector<Eigen::Vector3d>& places,
                                 const std::vector<Eigen::Vector3d>& vertices,
                                 const std::vector<std::array<std::uint32_t, 3>>& triangles);
PeerDistances open3d_mesh_distance(const std::vector<Eigen::Vector3d>& places,
                                   const std::vector<Eigen::Vector3d>& vertices,
                                   const std::vector<std::array<std::uint32_t, 3>>& triangles);

/// PCL's NormalEstimation, k neighbours.
double pcl_normals(const RoadCloud& cloud, int k, std::vector<Eigen::Vector3f>& normals);
/// nanoflann's neighbours, the closed-form eigenvectors of Eigen; the sign is left free.
double nanoflann_normals(const RoadCloud& cloud, int k, std::vector<Eigen::Vector3f>& normals);
/// Open3D's EstimateNormals, its fast form; the sign is left free.
double open3d_normals(const RoadCloud& cloud, int k, std::vector<Eigen::Vector3f>& normals);
/// PCL's VoxelGrid; `count` gets the number of points left.
double pcl_voxel_grid(const RoadCloud& cloud, float size, std::size_t& count);
/// PCL's StatisticalOutlierRemoval; `kept` gets the indices.
double pcl_statistical(const RoadCloud& cloud, int k, double deviations, std::vector<int>& kept);
/// PCL's ProgressiveMorphologicalFilter with its default windows and slopes; 1 for ground.
double pcl_morphological(const RoadCloud& cloud, std::vector<int>& labels);

}  // namespace camber::peers
