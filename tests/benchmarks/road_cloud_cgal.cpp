#include "benchmarks/road_cloud_peers.h"

#ifdef CAMBER_HAVE_CGAL

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Shape_detection/Efficient_RANSAC.h>
#include <CGAL/pca_estimate_normals.h>
#include <CGAL/property_map.h>

#include <tuple>

namespace camber::benchmarks {

PeerAnswer cgal_planes(const RoadCloud& cloud, std::size_t least_points) {
  using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
  // The algorithm puts its input in another order: each point carries its index.
  using PointWithNormal = std::tuple<Kernel::Point_3, Kernel::Vector_3, std::size_t>;
  using Points = std::vector<PointWithNormal>;
  using PointMap = CGAL::Nth_of_tuple_property_map<0, PointWithNormal>;
  using NormalMap = CGAL::Nth_of_tuple_property_map<1, PointWithNormal>;
  using Traits =
      CGAL::Shape_detection::Efficient_RANSAC_traits<Kernel, Points, PointMap, NormalMap>;
  using Ransac = CGAL::Shape_detection::Efficient_RANSAC<Traits>;
  using PlaneShape = CGAL::Shape_detection::Plane<Traits>;

  PeerAnswer answer;
  answer.name = "CGAL Efficient RANSAC";
  Points points;
  points.reserve(cloud.size());
  for (const Eigen::Vector3f& p : cloud.points) {
    points.emplace_back(Kernel::Point_3(static_cast<double>(p.x()), static_cast<double>(p.y()),
                                        static_cast<double>(p.z())),
                        Kernel::Vector_3(0.0, 0.0, 1.0), points.size());
  }
  double start = cpu_ms();
  CGAL::pca_estimate_normals<CGAL::Sequential_tag>(
      points, 24, CGAL::parameters::point_map(PointMap()).normal_map(NormalMap()));
  answer.normals_ms = cpu_ms() - start;
  start = cpu_ms();
  Ransac ransac;
  ransac.set_input(points);
  ransac.add_shape_factory<PlaneShape>();
  Ransac::Parameters parameters;
  parameters.probability = 0.01;
  parameters.min_points = least_points;
  parameters.epsilon = 0.04;
  parameters.cluster_epsilon = 1.0;
  parameters.normal_threshold = 0.8;
  ransac.detect(parameters);
  answer.ms = cpu_ms() - start;
  answer.labels.assign(cloud.size(), -1);
  for (const auto& shape : ransac.shapes()) {
    const auto* plane = dynamic_cast<const PlaneShape*>(shape.get());
    if (!plane) continue;
    const Kernel::Vector_3 n = plane->plane_normal();
    Plane found{{n.x(), n.y(), n.z()}, plane->d()};
    const int id = static_cast<int>(answer.planes.size());
    answer.planes.push_back(found.oriented(Eigen::Vector3d::UnitZ()));
    for (const std::size_t i : shape->indices_of_assigned_points()) {
      answer.labels[std::get<2>(points[i])] = id;
    }
  }
  return answer;
}

}  // namespace camber::benchmarks

#else

namespace camber::benchmarks {

PeerAnswer cgal_planes(const RoadCloud&, std::size_t) {
  PeerAnswer answer;
  answer.name = "CGAL Efficient RANSAC";
  answer.available = false;
  return answer;
}

}  // namespace camber::benchmarks

#endif
