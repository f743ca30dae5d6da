#include "benchmarks/cloud_toolkit_peers.h"

#ifdef CAMBER_HAVE_NANOFLANN

#include <Eigen/Eigenvalues>
#include <cmath>
#include <nanoflann.hpp>

#include "benchmarks/cpu_time.h"

namespace camber::peers {
namespace {

struct Points {
  const std::vector<Eigen::Vector3f>& places;
  std::size_t kdtree_get_point_count() const { return places.size(); }
  float kdtree_get_pt(std::size_t i, std::size_t axis) const {
    return places[i][static_cast<Eigen::Index>(axis)];
  }
  template <class Box>
  bool kdtree_get_bbox(Box&) const {
    return false;
  }
};
using Tree = nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<float, Points>,
                                                 Points, 3, std::uint32_t>;

}  // namespace

PeerDistances nanoflann_nearest(const RoadCloud& from, const RoadCloud& to) {
  PeerDistances out;
  out.name = "nanoflann";
  const Points points{to.points};
  out.distances.reserve(from.size());
  const double start = bench::cpu_ms();
  Tree tree(3, points);
  tree.buildIndex();
  for (const Eigen::Vector3f& p : from.points) {
    std::uint32_t index = 0;
    float squared = 0.0f;
    tree.knnSearch(p.data(), 1, &index, &squared);
    out.distances.push_back(std::sqrt(static_cast<double>(squared)));
  }
  out.milliseconds = bench::cpu_ms() - start;
  return out;
}

double nanoflann_normals(const RoadCloud& cloud, int k, std::vector<Eigen::Vector3f>& normals) {
  const Points points{cloud.points};
  normals.assign(cloud.size(), Eigen::Vector3f::Zero());
  std::vector<std::uint32_t> index(static_cast<std::size_t>(k));
  std::vector<float> squared(index.size());
  const double start = bench::cpu_ms();
  Tree tree(3, points);
  tree.buildIndex();
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const std::size_t found =
        tree.knnSearch(cloud.points[i].data(), index.size(), index.data(), squared.data());
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    Eigen::Matrix3d moments = Eigen::Matrix3d::Zero();
    for (std::size_t j = 0; j < found; ++j) {
      const Eigen::Vector3d p = (cloud.points[index[j]] - cloud.points[i]).cast<double>();
      sum += p;
      moments += p * p.transpose();
    }
    const double n = static_cast<double>(found);
    solver.computeDirect(moments / n - sum * sum.transpose() / (n * n));
    normals[i] = solver.eigenvectors().col(0).cast<float>();
  }
  return bench::cpu_ms() - start;
}

}  // namespace camber::peers

#else

namespace camber::peers {

PeerDistances nanoflann_nearest(const RoadCloud&, const RoadCloud&) {
  PeerDistances out;
  out.name = "nanoflann (libnanoflann-dev)";
  return out;
}

double nanoflann_normals(const RoadCloud&, int, std::vector<Eigen::Vector3f>&) { return -1.0; }

}  // namespace camber::peers

#endif
