#include "benchmarks/cloud_toolkit_peers.h"

#ifdef CAMBER_HAVE_OPEN3D

#include <omp.h>
#include <open3d/core/Tensor.h>
#include <open3d/geometry/PointCloud.h>
#include <open3d/t/geometry/RaycastingScene.h>

#include "benchmarks/cpu_time.h"

namespace camber::peers {
namespace {

open3d::geometry::PointCloud to_open3d(const RoadCloud& cloud) {
  open3d::geometry::PointCloud out;
  out.points_.reserve(cloud.size());
  for (const Eigen::Vector3f& p : cloud.points) out.points_.push_back(p.cast<double>());
  return out;
}

}  // namespace

PeerDistances open3d_nearest(const RoadCloud& from, const RoadCloud& to) {
  PeerDistances out;
  out.name = "Open3D, ComputePointCloudDistance";
  omp_set_num_threads(1);
  open3d::geometry::PointCloud queries = to_open3d(from), data = to_open3d(to);
  const double start = bench::cpu_ms();
  out.distances = queries.ComputePointCloudDistance(data);
  out.milliseconds = bench::cpu_ms() - start;
  return out;
}

PeerDistances open3d_mesh_distance(const std::vector<Eigen::Vector3d>& places,
                                   const std::vector<Eigen::Vector3d>& vertices,
                                   const std::vector<std::array<std::uint32_t, 3>>& triangles) {
  using open3d::core::Tensor;
  PeerDistances out;
  out.name = "Open3D, RaycastingScene (Embree)";
  const auto as_tensor = [](const std::vector<Eigen::Vector3d>& points) {
    std::vector<float> values;
    values.reserve(3 * points.size());
    for (const Eigen::Vector3d& p : points) {
      for (int axis = 0; axis < 3; ++axis) values.push_back(static_cast<float>(p[axis]));
    }
    return Tensor(values, {static_cast<std::int64_t>(points.size()), 3},
                  open3d::core::Dtype::Float32);
  };
  std::vector<std::uint32_t> indices;
  for (const auto& t : triangles) indices.insert(indices.end(), t.begin(), t.end());
  const Tensor corners = as_tensor(vertices), queries = as_tensor(places);
  const Tensor faces(indices, {static_cast<std::int64_t>(triangles.size()), 3},
                     open3d::core::Dtype::UInt32);
  const double start = bench::cpu_ms();
  open3d::t::geometry::RaycastingScene scene(1);
  scene.AddTriangles(corners, faces);
  const Tensor found = scene.ComputeDistance(queries, 1);
  out.milliseconds = bench::cpu_ms() - start;
  for (const float d : found.ToFlatVector<float>()) out.distances.push_back(d);
  return out;
}

double open3d_normals(const RoadCloud& cloud, int k, std::vector<Eigen::Vector3f>& normals) {
  omp_set_num_threads(1);
  open3d::geometry::PointCloud points = to_open3d(cloud);
  const double start = bench::cpu_ms();
  points.EstimateNormals(open3d::geometry::KDTreeSearchParamKNN(k));
  const double time = bench::cpu_ms() - start;
  normals.clear();
  for (const Eigen::Vector3d& n : points.normals_) normals.push_back(n.cast<float>());
  return time;
}

}  // namespace camber::peers

#else

namespace camber::peers {

PeerDistances open3d_nearest(const RoadCloud&, const RoadCloud&) {
  PeerDistances out;
  out.name = "Open3D (libopen3d-dev)";
  return out;
}

PeerDistances open3d_mesh_distance(const std::vector<Eigen::Vector3d>&,
                                   const std::vector<Eigen::Vector3d>&,
                                   const std::vector<std::array<std::uint32_t, 3>>&) {
  PeerDistances out;
  out.name = "Open3D (libopen3d-dev)";
  return out;
}

double open3d_normals(const RoadCloud&, int, std::vector<Eigen::Vector3f>&) { return -1.0; }

}  // namespace camber::peers

#endif
