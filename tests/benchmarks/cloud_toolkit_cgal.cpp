#include "benchmarks/cloud_toolkit_peers.h"

#ifdef CAMBER_HAVE_CGAL

#include <CGAL/AABB_traits.h>
#include <CGAL/AABB_tree.h>
#include <CGAL/AABB_triangle_primitive.h>
#include <CGAL/Simple_cartesian.h>

#include <cmath>

#include "benchmarks/cpu_time.h"

namespace camber::peers {

PeerDistances cgal_mesh_distance(const std::vector<Eigen::Vector3d>& places,
                                 const std::vector<Eigen::Vector3d>& vertices,
                                 const std::vector<std::array<std::uint32_t, 3>>& triangles) {
  using Kernel = CGAL::Simple_cartesian<double>;
  using Iterator = std::vector<Kernel::Triangle_3>::const_iterator;
  using Traits = CGAL::AABB_traits<Kernel, CGAL::AABB_triangle_primitive<Kernel, Iterator>>;
  PeerDistances out;
  out.name = "CGAL, AABB tree";
  const auto point = [&](std::size_t i) {
    return Kernel::Point_3(vertices[i].x(), vertices[i].y(), vertices[i].z());
  };
  std::vector<Kernel::Triangle_3> mesh;
  for (const auto& t : triangles) mesh.emplace_back(point(t[0]), point(t[1]), point(t[2]));
  const double start = bench::cpu_ms();
  CGAL::AABB_tree<Traits> tree(mesh.begin(), mesh.end());
  tree.accelerate_distance_queries();
  for (const Eigen::Vector3d& p : places) {
    out.distances.push_back(std::sqrt(tree.squared_distance(Kernel::Point_3(p.x(), p.y(), p.z()))));
  }
  out.milliseconds = bench::cpu_ms() - start;
  return out;
}

}  // namespace camber::peers

#else

namespace camber::peers {

PeerDistances cgal_mesh_distance(const std::vector<Eigen::Vector3d>&,
                                 const std::vector<Eigen::Vector3d>&,
                                 const std::vector<std::array<std::uint32_t, 3>>&) {
  PeerDistances out;
  out.name = "CGAL (libcgal-dev)";
  return out;
}

}  // namespace camber::peers

#endif
